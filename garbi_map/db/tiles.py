"""What the cells of a submap remember, on disk: merged in one order, the same memories give the same map to the byte."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.db.submaps import Pose, read_parquet, read_swept, write_parquet
from garbi_map.keys import code_key, digest_of
from garbi_map.seabed import FusedCells, SeabedSettings, SurfaceGrid, fuse
from garbi_map.seabed.cells import CELL
from garbi_map.seabed.surface import coarseness

Tiles = tuple[tuple[int, int, int], ...]
"""Of each tile its index along x and y, and how many of its cells were hit."""


def memory_name(submap: str, pose: Pose, settings: SeabedSettings) -> str:
    """A file name that changes with everything a submap's memory depends on."""
    made_of = (pose.translation.tobytes(), pose.quaternion.tobytes(), settings.model_dump_json(), code_key())
    return f"{submap}-{digest_of(*made_of)}.parquet"


def fuse_submap(source: Path, pose: Pose, settings: SeabedSettings, target: Path) -> Tiles:
    """Fuse the points of a submap at its pose, and write what its cells then remember.

    Reads and writes files only, so that any worker can do it. Raises GarbiError.
    """
    import pyarrow as pa

    fused = fuse(read_swept(source, pose), settings)
    columns: dict[str, NDArray[Any]] = {
        "tile_a": np.repeat(fused.tiles[:, 0], fused.counts),
        "tile_b": np.repeat(fused.tiles[:, 1], fused.counts),
        "cell": fused.cell,
        **{name: np.empty(len(fused.cell), CELL[name]) for name in CELL.names or ()},
    }
    for rows in _pieces(len(fused.cell)):
        for name in CELL.names or ():
            columns[name][rows] = fused.memory[name][rows]
    write_parquet(target, pa.table(columns))
    return tuple((a, b, count) for (a, b), count in zip(fused.tiles.tolist(), fused.counts.tolist(), strict=True))


def read_memory(path: Path) -> FusedCells:
    """What the cells of one submap remember. Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path)
    memory = np.empty(len(table["cell"]), CELL)
    for rows in _pieces(len(memory)):
        for name in CELL.names or ():
            memory[name][rows] = table[name][rows]
    tile = np.column_stack([table["tile_a"], table["tile_b"]])
    begins = np.flatnonzero(np.r_[True, (np.diff(tile, axis=0) != 0).any(axis=1)])
    return FusedCells(tile[begins], np.diff(np.r_[begins, len(tile)]), table["cell"], memory)


def merge_memories(memories: Iterable[tuple[Path, Tiles]], settings: SeabedSettings) -> SurfaceGrid:
    """The grid of many submaps, merged one after the other in the order given.

    One of them is in memory at a time, and of the site no more cells than the finished raster may have.
    """
    memories = list(memories)
    tiles = {(a, b) for _, own in memories for a, b, _ in own}
    grid = SurfaceGrid(settings, coarseness(tiles, settings), len(tiles))
    for path, _ in memories:
        grid.take(read_memory(path))
    return grid


def _pieces(count: int) -> Iterator[slice]:
    """Between rows and columns so many at a time as the processor's cache holds."""
    for begin in range(0, count, 1 << 13):
        yield slice(begin, begin + (1 << 13))
