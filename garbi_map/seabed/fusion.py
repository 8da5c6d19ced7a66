"""Points become what the cells of the grid remember of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.seabed.cells import CELL, OPEN_CELL, TILE
from garbi_map.seabed.settings import SeabedSettings

_MAX_SPAN = 1 << 13  # tiles along an axis that the points fused at once may span


@dataclass(frozen=True)
class SweptPoints:
    """Points of whole sweeps in `map`, with what their fusion needs.

    placed       (n, 3) float64, m
    sweep        (n,) int32, numbers the sweeps from 0, ascending
    seen         (s,) float64, when each sweep began, s: what follows closely shares errors of its poses
    gradient     (n, 2) float32, slope of the surface at a point, along x and y
    noise        (n,) float32, variance of the elevation by the point's own error, m^2
    pose         (n,) float32, deviation of the elevation by the error of the pose, which the sweep shares, m
    intensity    (n,) float32, 0..255
    """

    placed: NDArray[np.float64]
    sweep: NDArray[np.int32]
    seen: NDArray[np.float64]
    gradient: NDArray[np.float32]
    noise: NDArray[np.float32]
    pose: NDArray[np.float32]
    intensity: NDArray[np.float32]


@dataclass(frozen=True)
class FusedCells:
    """The cells that were hit, in the order of their tiles and of their numbers in a tile.

    tiles    (t, 2) int32, index along x and y of each tile
    counts   (t,) int, cells of each that were hit
    cell     (k,) int16, number in the tile: TILE times the index along x, plus that along y
    memory   (k,) CELL
    """

    tiles: NDArray[np.int32]
    counts: NDArray[np.int64]
    cell: NDArray[np.int16]
    memory: NDArray[np.void]


def fuse(points: SweptPoints, settings: SeabedSettings) -> FusedCells:
    """Fuse points, at least one, sweep by sweep. Raises GarbiError where they are kilometres apart."""
    from garbi_map.seabed import kernels

    index, first, last = kernels.cells_of(points.placed, settings.cell)
    span = last - first + 1
    if span.max() > _MAX_SPAN:
        raise GarbiError(
            f"sweeps span {span.max() * TILE * settings.cell:.0f} m: their trajectory jumps, or seabed.cell is too small"
        )
    order, tiles, begin = kernels.sort_by_cell(index, first, span)
    hit = np.flatnonzero(np.diff(begin))
    memory = np.zeros(len(hit), CELL)
    kernels.fuse_cells(
        order, begin, hit, index, points.placed, points.sweep, points.seen, points.gradient, points.noise, points.pose,
        points.intensity, settings.sigma_floor, settings.cell, settings.pose_memory, np.zeros(1, OPEN_CELL), memory,
    )  # fmt: skip
    tile, cell = np.divmod(hit, TILE * TILE)
    return FusedCells(tiles, np.bincount(tile, minlength=len(tiles)), cell.astype(np.int16), memory)
