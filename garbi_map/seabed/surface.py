"""The elevation grid while it grows: sparse tiles of cells whose memories can be merged."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.seabed.cells import CELL, TILE
from garbi_map.seabed.fusion import FusedCells, SweptPoints, fuse
from garbi_map.seabed.settings import SeabedSettings
from garbi_map.seabed.types import JudgedPoints, Seabed

CELL_BYTES = 150
"""Of memory for each cell of a raster while it is made: what the cell remembers, and a few fields at a time."""
_EDGE = 9.0  # times the usual scatter, three sigma: noise hardly does that, an edge in the cell does


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

    def add(self, points: JudgedPoints) -> None:
        """Take in the accepted points of one whole sweep."""
        if len(points.points) == 0:
            return
        swept = SweptPoints(
            points.points,
            np.zeros(len(points.points), np.int32),
            np.array([points.stamp_ns[0] * 1e-9]),
            *(part.astype(np.float32) for part in (points.gradient, points.noise, points.pose, points.intensity)),
        )
        self.take(fuse(swept, self._settings))

    def take(self, fused: FusedCells) -> None:
        """Take in what the cells remember of other sweeps."""
        from garbi_map.seabed import kernels

        slots = np.array([self._slot((a, b)) for a, b in fused.tiles.tolist()], np.int32)
        kernels.merge_cells(
            self._cells,
            np.repeat(slots, fused.counts),
            fused.cell,
            fused.memory,
            self._factor,
            self._settings.pose_memory,
        )

    def merge(self, other: SurfaceGrid) -> None:
        """Take in all that another grid, of the same cell size, no coarser and of other sweeps, has seen."""
        if other._settings.cell != self._settings.cell:
            raise GarbiError(
                f"grids of {self._settings.cell} m and {other._settings.cell} m cells do not merge: set one seabed.cell"
            )
        for index in other._tiles:
            self.take(other._fused(index))

    def finish(self) -> Seabed:
        """The grid as dense rasters over all that was seen; a copy, so that the grid may go on growing.

        Raises GarbiError when nothing was seen.
        """
        if not self._tiles:
            raise GarbiError("no point of the seabed was accepted: there is no map to make")
        factor = coarseness(self._tiles, self._settings)
        if factor > self._factor:
            coarse = SurfaceGrid(self._settings, factor, len(self._tiles))
            coarse.merge(self)
            return coarse.finish()
        cell = self._settings.cell * self._factor
        window = max(3, 2 * round(0.5 * self._settings.agreement_window / cell) + 1)
        bands = _Bands(self._tiles, self._cells)
        return _rasters(bands, (float(bands.corner[0] * cell), float(bands.corner[1] * cell)), cell, window)

    def _fused(self, index: tuple[int, int]) -> FusedCells:
        """One tile."""
        tile = self._cells[self._tiles[index]]
        a, b = np.nonzero(tile["count"])
        number = ((a * TILE + b) * self._factor).astype(np.int16)
        return FusedCells(np.array([index], np.int32), np.array([len(a)]), number, tile[a, b])

    def _slot(self, index: tuple[int, int]) -> int:
        slot = self._tiles.get(index)
        if slot is None:
            slot = self._tiles[index] = len(self._tiles)
            if slot == len(self._cells):
                self._cells = np.concatenate([self._cells, np.zeros_like(self._cells)])
        return slot


class _Bands:
    """The fields of CELL as rasters (rows, columns) over all that was seen, each made anew when it is asked for.

    corner (2,): index of cell (0, 0) along x and y.
    """

    def __init__(self, tiles: dict[tuple[int, int], int], cells: NDArray[np.void]) -> None:
        index = np.array(list(tiles))
        low, side = index.min(axis=0), cells.shape[1]
        span = index.max(axis=0) - low + 1
        self._cells = cells
        self._slot_of = np.full(span, -1, np.int32)
        self._slot_of[tuple((index - low).T)] = list(tiles.values())
        self._first = np.zeros(2, np.int64)
        self._shape = (int(span[1]) * side, int(span[0]) * side)
        hit = self["count"] > 0
        inside = [np.flatnonzero(hit.any(axis=k)) for k in (0, 1)]
        self._first = np.array([along[0] for along in inside])
        self._shape = (int(np.ptp(inside[1])) + 1, int(np.ptp(inside[0])) + 1)
        self.corner = low * side + self._first

    def __getitem__(self, name: str) -> NDArray:
        from garbi_map.seabed import kernels

        raster = np.zeros(self._shape, self._cells.dtype[name])
        kernels.paint(self._cells[name], self._slot_of, self._first, raster)
        return raster


def coarseness(tiles: Iterable[tuple[int, int]], settings: SeabedSettings) -> int:
    """How many cells along a side become one where the raster about these tiles would have more than `max_cells`."""
    index = np.array(list(tiles))
    span = index.max(0) - index.min(0) + 1
    factor = 1
    while np.prod(span) * (TILE // factor) ** 2 > settings.max_cells and factor < TILE:
        factor *= 2
    return factor


def _rasters(bands: _Bands, origin: tuple[float, float], cell: float, window: int) -> Seabed:
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


def excess(bands: _Bands, weight: NDArray[np.float64], window: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
