"""Everything seen: the recording of a map, logs as they are, decisions, and work while it runs."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from garbi_map.view.record import record_map

__all__ = ["record_map"]


def __getattr__(name: str) -> Any:
    """The public names, imported when they are asked for: a viewer must start before anything heavy is imported."""
    if name == "record_map":
        from garbi_map.view.record import record_map

        return record_map
    raise AttributeError(name)
