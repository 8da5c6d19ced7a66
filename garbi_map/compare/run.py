"""The whole comparison, from two folders to one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import alone_in, make_folder, remove_leftovers
from garbi_map.compare.alignment import Alignment, align, as_is
from garbi_map.compare.change import Change, difference
from garbi_map.compare.files import write_change_tif, write_changes_csv, write_outlines
from garbi_map.compare.maps import MapFolder, open_map_folder
from garbi_map.compare.patches import Patch, find_patches
from garbi_map.compare.settings import CompareSettings
from garbi_map.errors import GarbiError


@dataclass(frozen=True)
class Comparison:
    """All that was found. labels (rows, columns): the patch that a cell is part of, 0 for none."""

    first: MapFolder
    second: MapFolder
    motion: Alignment
    change: Change
    patches: list[Patch]
    labels: NDArray[np.int32]


def compare_maps(
    first: Path,
    second: Path,
    out: Path,
    settings: CompareSettings,
    aligned: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare two map folders and write what changed into the folder `out`; report.json and report.html come last.

    aligned: the maps have one origin already. Raises GarbiError where a folder is no finished map, where they do not
    show the same site, and where `out` cannot be written or is a map itself.
    """
    from garbi_map.compare.recording import record_change
    from garbi_map.compare.report import about, write_report

    maps = [open_map_folder(path) for path in (first, second)]
    if (out / "seabed.tif").exists():
        raise GarbiError(f"{out}: is a map; give the comparison a folder of its own with -o")
    make_folder(out)
    with alone_in(out):
        remove_leftovers(out)
        progress("alignment")
        motion = (as_is if aligned else align)(maps[0], maps[1], settings.align)
        progress("differences")
        change = difference(maps[0], maps[1], motion, settings)
        patches, labels = find_patches(change, settings)
        found = Comparison(maps[0], maps[1], motion, change, patches, labels)
        progress("files")
        write_change_tif(out / "change.tif", change, labels)
        write_changes_csv(out / "changes.csv", patches, change.reference)
        write_outlines(out, patches, change, labels)
        record_change(out / "compare.rrd", found, about(found))
        write_report(out, found, settings)
    return found
