"""What the cells of a submap remember, on disk: merged in one order, the same memories give the same map to the byte."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garbi_map.db.submaps import Pose, read_parquet, read_submap, write_parquet
from garbi_map.keys import code_key, digest_of
from garbi_map.seabed import SeabedSettings, SurfaceGrid
from garbi_map.seabed.cells import CELL
from garbi_map.seabed.surface import TILE, coarseness

Tiles = tuple[tuple[int, int, int], ...]
"""Of each tile its index along x and y, and how many of its cells were hit."""


def memory_name(submap: str, pose: Pose, settings: SeabedSettings) -> str:
    """A file name that changes with everything a submap's memory depends on."""
    made_of = (pose.translation.tobytes(), pose.quaternion.tobytes(), settings.model_dump_json(), code_key())
    return f"{submap}-{digest_of(*made_of)}.parquet"


def fuse_submap(source: Path, pose: Pose, settings: SeabedSettings, target: Path) -> Tiles:
    """Fuse the points of a submap at its pose, sweep by sweep, and write what its cells then remember.

    Reads and writes files only, so that any worker can do it. Raises GarbiError.
    """
    import pyarrow as pa

    grid = SurfaceGrid(settings)
    for points in read_submap(source).sweeps(pose):
        grid.add(points)
    tiles = sorted(grid.tiles.items())
    where = [(index, np.flatnonzero(tile["count"].ravel())) for index, tile in tiles]
    hit = [tile.ravel()[cells] for (_, tile), (_, cells) in zip(tiles, where, strict=True)]
    cells = np.concatenate(hit) if hit else np.zeros(0, CELL)
    counts = [len(found) for _, found in where]
    index = np.array([index for index, _ in where], np.int32).reshape(-1, 2)
    columns = {
        "tile_a": np.repeat(index[:, 0], counts),
        "tile_b": np.repeat(index[:, 1], counts),
        "cell": np.concatenate([found for _, found in where]).astype(np.int16) if where else np.zeros(0, np.int16),
        **{name: np.ascontiguousarray(cells[name]) for name in CELL.names or ()},
    }
    write_parquet(target, pa.table(columns))
    return tuple((int(a), int(b), count) for (a, b), count in zip(index, counts, strict=True))


def read_memory(path: Path, settings: SeabedSettings) -> SurfaceGrid:
    """The grid of one submap. Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path)
    cells = np.zeros(len(table["cell"]), CELL)
    for name in CELL.names or ():
        cells[name] = table[name]
    grid = SurfaceGrid(settings)
    changes = (np.diff(table["tile_a"]) != 0) | (np.diff(table["tile_b"]) != 0)
    cuts = np.flatnonzero(changes) + 1
    for rows in np.split(np.arange(len(cells)), cuts) if len(cells) else []:
        tile = np.zeros(TILE * TILE, CELL)
        tile[table["cell"][rows]] = cells[rows]
        grid.put((int(table["tile_a"][rows[0]]), int(table["tile_b"][rows[0]])), tile.reshape(TILE, TILE))
    return grid


def merge_memories(memories: Iterable[tuple[Path, Tiles]], settings: SeabedSettings) -> SurfaceGrid:
    """The grid of many submaps, merged one after the other in the order given.

    One of them is in memory at a time, and of the site no more cells than the finished raster may have.
    """
    memories = list(memories)
    tiles = {(a, b) for _, own in memories for a, b, _ in own}
    grid = SurfaceGrid(settings, coarseness(tiles, settings), len(tiles))
    for path, _ in memories:
        grid.merge(read_memory(path, settings))
    return grid
