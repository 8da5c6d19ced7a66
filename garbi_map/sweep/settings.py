"""Settings of the sweep room."""

from garbi_map.settings import Settings


class SweepSettings(Settings):
    """Every field says its unit."""
