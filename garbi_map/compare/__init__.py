"""What changed between two seabed maps, and how sure that is."""

from typing import TYPE_CHECKING, Any

from garbi_map.compare.settings import CompareSettings

if TYPE_CHECKING:
    from garbi_map.compare.alignment import Alignment, align
    from garbi_map.compare.change import Change, difference
    from garbi_map.compare.maps import MapFolder, open_map_folder
    from garbi_map.compare.patches import Patch, find_patches
    from garbi_map.compare.run import Comparison, compare_maps

_HOME = {
    "Alignment": "alignment",
    "Change": "change",
    "Comparison": "run",
    "MapFolder": "maps",
    "Patch": "patches",
    "align": "alignment",
    "compare_maps": "run",
    "difference": "change",
    "find_patches": "patches",
    "open_map_folder": "maps",
}

__all__ = [
    "Alignment",
    "Change",
    "CompareSettings",
    "Comparison",
    "MapFolder",
    "Patch",
    "align",
    "compare_maps",
    "difference",
    "find_patches",
    "open_map_folder",
]


def __getattr__(name: str) -> Any:
    """The public names, imported when they are asked for: the configuration needs the settings alone."""
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(name)
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
