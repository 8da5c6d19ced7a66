"""Colours of the growing map, and how far its points lie from the finished one."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.palette import depth_colours, height_range
from garbi_map.seabed import Seabed

_HEAT = np.array([[58, 62, 134], [96, 50, 140], [168, 54, 104], [228, 94, 62], [250, 172, 52], [250, 242, 164]], float)
_EITHER = np.array([[60, 120, 240], [226, 226, 222], [232, 84, 64]], float)
_GOLDEN = 0.61803398875  # of a turn in hue between neighbouring numbers: none of the next dozen looks the same


@dataclass(frozen=True)
class FinishedMap:
    """The finished grid to look points up in; the ramps of colour span all but its outermost cells.

    depths      what the depth ramp spans, `map` z, m
    weakest     1 sigma at the bright end of the uncertainty ramp, m
    brightest   intensity that is drawn white, 0..255
    off         m off the surface at the ends of the residual's ramp
    span_ns     begin and end of the dive
    slope       (2, rows, columns) of the surface along y and x; 0 where a neighbour is missing
    """

    seabed: Seabed
    depths: tuple[float, float]
    weakest: float
    brightest: float
    off: float
    span_ns: tuple[int, int]
    slope: NDArray[np.float64]

    @classmethod
    def of(cls, seabed: Seabed, span_ns: tuple[int, int]) -> FinishedMap:
        """The ramps that suit a seabed."""
        known = seabed.known
        return cls(
            seabed,
            height_range(seabed.elevation),
            max(float(np.percentile(seabed.uncertainty[known], 98)), 1e-6),
            max(float(np.percentile(seabed.intensity[known], 98)), 1.0),
            max(3.0 * float(np.nanmedian(seabed.standard_deviation[known])), 1e-4),
            span_ns,
            _slope(seabed),
        )

    def cells(self, points: NDArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Flat cell (n,) of points (n, 3), and whether it holds a measurement (n,)."""
        rows, columns = self.seabed.elevation.shape
        column = np.floor((points[:, 0] - self.seabed.origin[0]) / self.seabed.cell).astype(np.int64)
        row = np.floor((points[:, 1] - self.seabed.origin[1]) / self.seabed.cell).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        flat = np.where(inside, row * columns + column, 0)
        return flat, inside & self.seabed.known.ravel()[flat]

    def beside(self, points: NDArray) -> NDArray:
        """Height (n,) m of points (n, 3) above the finished surface, sloping as it does; NaN where there is none."""
        flat, known = self.cells(points)
        row, column = np.divmod(flat, self.seabed.elevation.shape[1])
        along_x = points[:, 0] - self.seabed.origin[0] - (column + 0.5) * self.seabed.cell
        along_y = points[:, 1] - self.seabed.origin[1] - (row + 0.5) * self.seabed.cell
        y, x = (slope.ravel()[flat] for slope in self.slope)
        return np.where(known, points[:, 2] - self.seabed.elevation.ravel()[flat] - y * along_y - x * along_x, np.nan)

    def belongs(self, points: NDArray, band: float) -> NDArray[np.bool_]:
        """Which points (n,) lie within `band` m and four standard deviations of the finished surface."""
        flat, known = self.cells(points)
        spread = np.nan_to_num(self.seabed.standard_deviation.ravel()[flat])
        off = np.abs(points[:, 2] - np.nan_to_num(self.seabed.elevation.ravel()[flat]))
        return known & (off < band + 4.0 * spread)

    def colours(
        self, points: NDArray, intensity: NDArray, sweep: int, stamp_ns: NDArray[np.int64]
    ) -> dict[str, NDArray[np.uint32]]:
        """Packed colours (n,) of points of a sweep, by the name of the colouring."""
        flat, _ = self.cells(points)
        grey = np.clip(intensity / self.brightest, 0.06, 1.0)[:, None] * 255.0
        return {
            "Depth": packed(depth_colours(points[:, 2], *self.depths)),
            "Intensity": packed(np.repeat(grey, 3, axis=1)),
            "Uncertainty": packed(heat(self.seabed.uncertainty.ravel()[flat] / self.weakest)),
            "Sweep": packed(np.tile(hue(sweep), (len(points), 1))),
            "Age": packed(heat((stamp_ns - self.span_ns[0]) / max(self.span_ns[1] - self.span_ns[0], 1))),
            "Residual": packed(either_side(self.beside(points) / self.off)),
        }


def _slope(seabed: Seabed) -> NDArray[np.float64]:
    if min(seabed.elevation.shape) < 2:
        return np.zeros((2, *seabed.elevation.shape))
    return np.nan_to_num(np.array(np.gradient(seabed.elevation.astype(float), seabed.cell)))


def heat(share: NDArray) -> NDArray[np.uint8]:
    """sRGB (n, 3) of shares (n,), 0 dark to 1 bright; NaN is bright."""
    place = np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0) * (len(_HEAT) - 1)
    steps = np.arange(len(_HEAT))
    return np.stack([np.interp(place, steps, _HEAT[:, k]) for k in range(3)], -1).round().astype(np.uint8)


def either_side(share: NDArray) -> NDArray[np.uint8]:
    """sRGB (n, 3) of shares (n,): blue at -1, pale at 0, red at 1; NaN is pale."""
    place = np.clip(np.nan_to_num(share), -1.0, 1.0)
    return np.stack([np.interp(place, (-1.0, 0.0, 1.0), _EITHER[:, k]) for k in range(3)], -1).round().astype(np.uint8)


def hue(number: int) -> NDArray[np.uint8]:
    """sRGB (3,) of a number; neighbouring numbers are far apart."""
    return np.round(np.array(colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.55, 0.95)) * 255).astype(np.uint8)


def packed(colours: NDArray) -> NDArray[np.uint32]:
    """sRGB (n, 3) as 0xRRGGBBAA (n,)."""
    red, green, blue = np.asarray(colours).astype(np.uint32).T
    return (red << 24) | (green << 16) | (blue << 8) | np.uint32(255)
