"""The points of the sweeps as the map grows: thinned, placed and coloured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.palette import depth_colours, height_range
from garbi_map.seabed import Seabed
from garbi_map.view import style

_HEAT = np.array([[20, 24, 60], [70, 40, 120], [160, 50, 100], [225, 90, 60], [250, 170, 50], [250, 240, 160]], float)
_GOLDEN = 0.61803398875


@dataclass(frozen=True)
class Lookup:
    """The finished grid under points: what the colours and residuals of a growing map are made with."""

    seabed: Seabed
    depths: tuple[float, float]
    weakest: float
    brightest: float

    @classmethod
    def of(cls, seabed: Seabed) -> Lookup:
        """The ramps span all but the outermost cells."""
        known = seabed.known
        weakest = float(np.percentile(seabed.uncertainty[known], 98)) if known.any() else 1.0
        brightest = float(np.percentile(seabed.intensity[known], 98)) if known.any() else 255.0
        return cls(seabed, height_range(seabed.elevation), max(weakest, 1e-6), max(brightest, 1.0))

    def cells(self, points: NDArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Flat cell (n,) of points (n, 3), and whether it holds a measurement (n,)."""
        rows, columns = self.seabed.elevation.shape
        column = np.floor((points[:, 0] - self.seabed.origin[0]) / self.seabed.cell).astype(np.int64)
        row = np.floor((points[:, 1] - self.seabed.origin[1]) / self.seabed.cell).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        flat = np.where(inside, row * columns + column, 0)
        return flat, inside & self.seabed.known.ravel()[flat]

    def beside(self, points: NDArray) -> NDArray:
        """Height (n,) m of points (n, 3) above the finished surface; NaN where there is none."""
        flat, known = self.cells(points)
        return np.where(known, points[:, 2] - self.seabed.elevation.ravel()[flat], np.nan)

    def on_surface(self, points: NDArray, band: float) -> NDArray[np.bool_]:
        """Which points (n,) lie within `band` m and four standard deviations of the finished surface."""
        flat, known = self.cells(points)
        spread = np.nan_to_num(self.seabed.standard_deviation.ravel()[flat])
        off = np.abs(points[:, 2] - np.nan_to_num(self.seabed.elevation.ravel()[flat]))
        return known & (off < band + 4.0 * spread)

    def colours(self, points: NDArray, intensity: NDArray, sweep: int) -> dict[str, NDArray[np.uint32]]:
        """Packed colours (n,) by entity path, one for each way of colouring."""
        flat, _ = self.cells(points)
        grey = np.clip(intensity / self.brightest, 0.05, 1.0)[:, None] * 255.0
        return {
            style.BY_DEPTH.path: packed(depth_colours(points[:, 2], *self.depths)),
            style.BY_INTENSITY.path: packed(np.repeat(grey, 3, axis=1)),
            style.BY_UNCERTAINTY.path: packed(heat(self.seabed.uncertainty.ravel()[flat] / self.weakest)),
            style.BY_SWEEP.path: packed(np.tile(sweep_colour(sweep), (len(points), 1))),
        }


def heat(share: NDArray) -> NDArray[np.uint8]:
    """sRGB (n, 3) of shares (n,), 0 dark to 1 bright."""
    place = np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0) * (len(_HEAT) - 1)
    return np.stack([np.interp(place, np.arange(len(_HEAT)), _HEAT[:, k]) for k in range(3)], -1).astype(np.uint8)


def sweep_colour(number: int) -> NDArray[np.uint8]:
    """sRGB (3,); neighbouring numbers are far apart in hue."""
    import colorsys

    return (np.array(colorsys.hsv_to_rgb((number * _GOLDEN) % 1.0, 0.55, 0.95)) * 255).astype(np.uint8)


def packed(colours: NDArray) -> NDArray[np.uint32]:
    """sRGB (n, 3) as 0xRRGGBBAA (n,)."""
    parts = np.asarray(colours).astype(np.uint32)
    return (parts[:, 0] << 24) | (parts[:, 1] << 16) | (parts[:, 2] << 8) | np.uint32(255)


def thinned(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` of the indices 0 .. count - 1, evenly spread."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)


def runs(groups: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index and length of each run of equal values in an ordered array."""
    first = np.flatnonzero(np.r_[True, groups[1:] != groups[:-1]]) if len(groups) else np.empty(0, np.int64)
    return first, np.diff(np.r_[first, len(groups)])
