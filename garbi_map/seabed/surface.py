"""The elevation grid while it grows: sparse tiles of cells whose memories can be merged."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.seabed.cells import CELL
from garbi_map.seabed.settings import SeabedSettings
from garbi_map.seabed.types import JudgedPoints, Seabed

TILE = 64  # cells along a side of a tile; a power of two, so that tiles coarsen evenly
_EDGE = 9.0  # times the usual scatter, three sigma: noise hardly does that, an edge in the cell does
_MAX_SPAN = 1 << 13  # tiles along an axis that one sweep may span


class SurfaceGrid:
    """Cells about integer multiples of the cell's side, so that any two grids of one cell size merge cell by cell.

    `tiles` maps the index (along x, along y) of a tile to its slot in `cells` (slots, TILE, TILE), first index along x.
    Memory grows with the area seen. A coarse grid, of `factor` cells along a side of each of its own, takes no sweeps, only
    other grids.
    """

    def __init__(self, settings: SeabedSettings, factor: int = 1, room: int = 16) -> None:
        """room: tiles that there is memory for at first."""
        self._settings = settings
        self._factor = factor
        self._tiles: dict[tuple[int, int], int] = {}
        self._cells = np.zeros((room, TILE // factor, TILE // factor), CELL)
        self._entries = np.full(self._cells.shape, -1, np.int32)

    @property
    def tiles(self) -> dict[tuple[int, int], NDArray[np.void]]:
        """The memory (TILE, TILE) of each tile, views."""
        return {index: self._cells[slot] for index, slot in self._tiles.items()}

    def add(self, points: JudgedPoints) -> None:
        """Take in the accepted points of one whole sweep."""
        if len(points.points):
            chosen, begin = np.ones(len(points.points), np.bool_), float(points.stamp_ns[0] * 1e-9)
            self.add_sweep(points.points, chosen, points.gradient, points.noise, points.pose, points.intensity, begin)

    def add_sweep(
        self,
        placed: NDArray[np.float64],
        chosen: NDArray[np.bool_],
        gradient: NDArray[np.float64],
        noise: NDArray[np.float64],
        pose: NDArray[np.float64],
        intensity: NDArray[np.float32],
        seen: float = np.nan,
    ) -> None:
        """Take in the chosen (n,) points (n, 3) in `map` of one whole sweep.

        gradient (n, 2) is the slope of the surface at a point, along x and y; noise (n,) is the variance of its
        elevation by errors of its own, m^2; pose (n,) the deviation by errors that it shares with the sweep, m; seen: when
        the sweep began, s: what follows closely shares errors of its poses.
        """
        from garbi_map.seabed import kernels

        if not chosen.any():
            return
        cell = self._settings.cell
        first, last = kernels.tile_span(placed, chosen, cell, TILE)
        span = last - first + 1
        if span.max() > _MAX_SPAN:
            raise GarbiError(
                f"one sweep spans {span.max() * TILE * cell:.0f} m: its trajectory jumps, or seabed.cell is too small"
            )
        marked = np.zeros(span, np.bool_)
        kernels.mark_tiles(placed, chosen, cell, TILE, first, marked)
        slot_of = np.full(span, -1, np.int32)
        for a, b in np.argwhere(marked):
            slot_of[a, b] = self._slot((int(first[0] + a), int(first[1] + b)))
        kernels.fuse_sweep(
            placed,
            chosen,
            gradient,
            noise,
            pose,
            intensity,
            self._settings.sigma_floor,
            cell,
            first,
            slot_of,
            self._cells,
            self._entries,
            seen,
            self._settings.pose_memory,
        )

    def put(self, index: tuple[int, int], cells: NDArray[np.void]) -> None:
        """Set the memory (TILE, TILE) of a tile to what another grid had there."""
        slot = self._slot(index)  # which may move the cells
        self._cells[slot] = cells

    def merge(self, other: SurfaceGrid) -> None:
        """Take in all that another grid, of the same cell size, no coarser and of other sweeps, has seen."""
        from garbi_map.seabed import kernels

        if other._settings.cell != self._settings.cell:
            raise GarbiError(
                f"grids of {self._settings.cell} m and {other._settings.cell} m cells do not merge: set one seabed.cell"
            )
        for index, tile in other.tiles.items():
            slot = self._slot(index)
            kernels.merge_tile(self._cells[slot], tile, self._factor // other._factor, self._settings.pose_memory)

    def finish(self) -> Seabed:
        """The grid as dense rasters over all that was seen; a copy, so that the grid may go on growing.

        Raises GarbiError when nothing was seen.
        """
        from garbi_map.seabed import kernels

        if not self._tiles:
            raise GarbiError("no point of the seabed was accepted: there is no map to make")
        index = np.array(list(self._tiles))
        low = index.min(0)
        span = index.max(0) - low + 1
        factor = max(self._factor, coarseness(self._tiles, self._settings))
        part, cell = TILE // factor, self._settings.cell * factor
        bands = {name: np.zeros(span * part, CELL.fields[name][0]) for name in CELL.names or () if CELL.fields}
        for (a, b), tile in self.tiles.items():
            coarse = np.zeros((part, part), CELL)
            kernels.merge_tile(coarse, tile, factor // self._factor, self._settings.pose_memory)
            at = (
                slice((a - low[0]) * part, (a - low[0] + 1) * part),
                slice((b - low[1]) * part, (b - low[1] + 1) * part),
            )
            for name, band in bands.items():
                band[at] = coarse[name]
        hit = bands["count"] > 0
        inside = tuple(slice(int(k.min()), int(k.max()) + 1) for k in np.nonzero(hit))
        corner = [float((low[k] * part + inside[k].start) * cell) for k in (0, 1)]
        window = max(3, 2 * round(0.5 * self._settings.agreement_window / cell) + 1)
        cropped = {name: np.ascontiguousarray(bands.pop(name)[inside].T) for name in list(bands)}  # one at a time
        return _rasters(cropped, (corner[0], corner[1]), cell, window)

    def _slot(self, index: tuple[int, int]) -> int:
        slot = self._tiles.get(index)
        if slot is None:
            slot = self._tiles[index] = len(self._tiles)
            if slot == len(self._cells):
                self._cells = np.concatenate([self._cells, np.zeros_like(self._cells)])
                self._entries = np.concatenate([self._entries, np.full_like(self._entries, -1)])
        return slot


def coarseness(tiles: Iterable[tuple[int, int]], settings: SeabedSettings) -> int:
    """How many cells along a side become one where the raster about these tiles would have more than `max_cells`."""
    index = np.array(list(tiles))
    span = index.max(0) - index.min(0) + 1
    factor = 1
    while np.prod(span) * (TILE // factor) ** 2 > settings.max_cells and factor < TILE:
        factor *= 2
    return factor


def _rasters(bands: dict[str, NDArray], origin: tuple[float, float], cell: float, window: int) -> Seabed:
    """Rasters of the merged memories (rows, columns) of cells."""
    known = bands["count"] > 0
    weight = np.where(known, bands["weight"], 1.0)
    noise_excess, disagreement = excess(bands, weight, window)
    variance = disagreement * (noise_excess * bands["noise"] + bands["pose"]) / weight**2
    spread = np.maximum(bands["within"] + bands["between"], 0.0) / weight
    unknown = np.where(known, np.float32(0), np.float32(np.nan))
    return Seabed(
        origin=origin,
        cell=cell,
        elevation=bands["z"].astype(np.float32) + unknown,
        uncertainty=np.sqrt(variance).astype(np.float32) + unknown,
        density=bands["count"],
        standard_deviation=np.sqrt(spread).astype(np.float32) + unknown,
        intensity=bands["intensity"].astype(np.float32) + unknown,
        sweeps=bands["sweeps"],
    )


def excess(
    bands: dict[str, NDArray], weight: NDArray[np.float64], window: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """By what factors the points' noise, and then the sweeps' means, vary more than claimed (Birge ratios), at least 1.

    Summed over a window of cells. The first sees noise and roughness finer than a cell, the second poses that are
    worse than their covariances: for independent sweeps of variances v_s, E[sum W_s (z_s - z)^2] is
    sum W_s v_s - sum W_s^2 v_s / W. A cell far beyond all others, as on a vertical face, speaks for itself only.
    """
    from scipy.ndimage import uniform_filter

    def ratio(seen: NDArray[np.float64], expected: NDArray[np.float64]) -> NDArray[np.float64]:
        asked = expected > 1e-9
        own = np.divide(seen, expected, out=np.zeros_like(seen), where=asked)
        most = _EDGE * max(1.0, float(np.median(own[asked]))) if asked.any() else 1.0
        local = uniform_filter(np.minimum(seen, most * expected), window)
        expected = uniform_filter(expected, window)
        shared = np.divide(local, expected, out=np.ones_like(local), where=expected > 1e-9)
        return np.maximum(np.maximum(shared, np.where(own > most, own, 1.0)), 1.0)

    noise_excess = ratio(bands["within"], bands["within_expected"])
    several = bands["sweeps"] > 1
    expected = noise_excess * (bands["between_noise"] - bands["noise"] / weight)
    expected += bands["between_pose"] - bands["pose"] / weight
    return noise_excess, ratio(np.where(several, bands["between"], 0.0), np.where(several, expected, 0.0))
