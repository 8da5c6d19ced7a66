"""How fit a recorded log is to become a map, from samples spread over it: seconds, whatever its length."""

from garbi_map.health.findings import Finding
from garbi_map.health.health import Health, check_health

__all__ = ["Finding", "Health", "check_health"]
