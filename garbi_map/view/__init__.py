"""Everything seen: the recording of a map, and logs as they are."""

from garbi_map.view.record import record_map

__all__ = ["record_map"]
