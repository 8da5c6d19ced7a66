"""Maps as drawings in SVG: a raster inside, axes in metres about it, what its colours mean below."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.axes import BOTTOM, RIGHT, WIDTH, Axes, Tick, decades, ticks
from garbi_map.export.hillshade import fitted, png
from garbi_map.seabed import Seabed, fill_holes

Mask = NDArray[np.bool_]
Colours = NDArray[np.uint8]

VOID = (232, 234, 236)
_GOOD_TO_BAD = np.array([[252, 246, 222], [245, 208, 122], [230, 140, 66], [188, 66, 50], [92, 20, 56]], np.float64)
_LITTLE_TO_MUCH = np.array([[222, 236, 240], [150, 196, 208], [76, 146, 174], [27, 96, 134], [16, 50, 92]], np.float64)
_HOLE, _ONCE = (166, 30, 60), (236, 164, 64)
_CLASSES = (0, 1, 2, 3, 6, 10)
_CLASS_NAMES = ("not seen", "1", "2", "3 to 5", "6 to 9", "10 and more")
_WIDE = 3.5
"""A map is drawn across the whole page when it is so many times longer than high."""
_TALLEST = 460
_PIXELS = 240
"""Of the longer side, about: a cell alone is often empty between two rows of points."""


@dataclass(frozen=True)
class Scale:
    """From values to colours: a ramp over low to high, linear or logarithmic; those beyond take the end's colour."""

    low: float
    high: float
    ramp: NDArray[np.float64]
    logarithmic: bool = False

    def share(self, values: NDArray) -> NDArray[np.float64]:
        """0 at low, 1 at high."""
        values = np.asarray(values, np.float64)
        if self.logarithmic:
            values = np.log(np.maximum(values, 1e-12))
            return np.clip((values - np.log(self.low)) / np.log(self.high / self.low), 0.0, 1.0)
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def colours(self, values: NDArray) -> Colours:
        """sRGB (..., 3); no-data is NaN and grey."""
        at = self.share(np.nan_to_num(values)) * (len(self.ramp) - 1)
        index = np.arange(len(self.ramp))
        colours = np.stack([np.interp(at, index, self.ramp[:, k]) for k in range(3)], -1)
        return np.where(np.isfinite(values)[..., None], colours, VOID).round().astype(np.uint8)

    def ticks(self) -> list[Tick]:
        """Where to write values beside the ramp."""
        return decades(self.low, self.high) if self.logarithmic else ticks(self.low, self.high, 5)


def doubt_scale(low: float, high: float, logarithmic: bool = False) -> Scale:
    """Pale is good, dark is bad."""
    low = max(low, 1e-9) if logarithmic else low
    return Scale(low, max(high, 3 * low if logarithmic else low + 1e-9), _GOOD_TO_BAD, logarithmic)


def amount_scale(high: float) -> Scale:
    """Pale is little, dark is much."""
    return Scale(0.0, max(high, 1e-9), _LITTLE_TO_MUCH)


def band_map(title: str, band: NDArray, gap: float, seabed: Seabed, scale: Scale, unit: str) -> str:
    """A band (rows, columns) of the grid; no-data is NaN, and interpolated where a gap is no wider than `gap` m."""
    values = _closed(band, gap, seabed)
    return _drawn(title, scale.colours(values), _extent(seabed), _ramp(scale, unit))


def sweeps_map(title: str, sweeps: NDArray, gap: float, holes: Mask, seabed: Seabed) -> str:
    """How many sweeps (rows, columns) saw each cell, NaN where none did; holes inside the outline are marked."""
    colours = np.array([_HOLE, _ONCE, *_LITTLE_TO_MUCH[1:]], np.uint8)
    count = _closed(sweeps, gap, seabed)
    hole, _ = fitted(holes.astype(np.float32), seabed.cell, _PIXELS)
    picture = colours[np.searchsorted(_CLASSES, np.round(np.nan_to_num(count)), side="right") - 1]
    picture = np.where(np.isfinite(count)[..., None], picture, np.array(VOID, np.uint8))
    picture = np.where((hole >= 0.5)[..., None], np.array(_HOLE, np.uint8), picture)
    used = [(text, tuple(colours[k])) for k, text in enumerate(_CLASS_NAMES) if _CLASSES[k] <= np.nanmax(sweeps)]
    return _drawn(title, picture, _extent(seabed), _classes(used, "sweeps"))


def scattered_map(title: str, place: NDArray, value: NDArray, seabed: Seabed, scale: Scale, unit: str) -> str:
    """Values (m,) at places (m, 2): the mean of each cell of a grid that is coarse enough to hold some."""
    side = max(0.03, max(seabed.known.shape) * seabed.cell / 110)
    rows, columns = (int(np.ceil(round(cells * seabed.cell / side, 6))) for cells in seabed.known.shape)
    index = np.floor((place - np.asarray(seabed.origin)) / side).astype(int)
    good = ((index >= 0) & (index < (columns, rows))).all(axis=1)
    flat = index[good, 1] * columns + index[good, 0]
    count = np.bincount(flat, minlength=rows * columns)
    total = np.bincount(flat, value[good], minlength=rows * columns)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, columns)
    x, y = seabed.origin
    return _drawn(title, scale.colours(mean), (x, x + columns * side, y, y + rows * side), _ramp(scale, unit))


def _closed(band: NDArray, gap: float, seabed: Seabed) -> NDArray[np.float32]:
    """A band as it is drawn, with its narrow gaps closed."""
    values, pixel = fitted(band.astype(np.float32), seabed.cell, _PIXELS)
    return fill_holes(values, round(gap / pixel))[0]


def wide(seabed: Seabed) -> bool:
    """Whether maps of this area want the width of the page."""
    rows, columns = seabed.known.shape
    return columns > _WIDE * rows


def _extent(seabed: Seabed) -> tuple[float, float, float, float]:
    """Least and greatest x and y of the grid as `fitted` leaves it: of whole blocks of cells, m."""
    step = max(1, -(-max(seabed.known.shape) // _PIXELS))
    x, y = seabed.origin
    rows, columns = (-(-cells // step) * step * seabed.cell for cells in seabed.known.shape)
    return x, x + columns, y, y + rows


def _drawn(title: str, picture: Colours, extent: tuple[float, float, float, float], legend: Sequence[str]) -> str:
    """A picture whose row 0 is the south, in axes of metres with equal scales."""
    x0, x1, y0, y1 = extent
    width = WIDTH if x1 - x0 > _WIDE * (y1 - y0) else WIDTH // 2
    left, top = 56, 10
    room = width - left - RIGHT
    scale = min(room / (x1 - x0), _TALLEST / (y1 - y0))
    across, high = (x1 - x0) * scale, (y1 - y0) * scale
    spare = (room - across) / scale / 2
    height = round(high + top + BOTTOM)
    axes = Axes((x0 - spare, x1 + spare), (y0, y1), height, left, width, top, BOTTOM)
    axes.grid("x, m", "y (north), m", ticks(*axes.x, 5), ticks(y0, y1, max(3, round(high / 50))))
    data = b64encode(png(np.ascontiguousarray(picture[::-1, :, ::-1]))).decode()
    axes.parts.append(
        f'<image x="{float(axes.across(x0)):.1f}" y="{top}" width="{across:.1f}" height="{high:.1f}" '
        f'preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'
    )
    axes.parts.append(f'<g transform="translate({left} {height})">{"".join(legend)}</g>')
    return Axes(axes.x, axes.y, height + 40, left, width, parts=axes.parts).svg(title)


def _ramp(scale: Scale, unit: str) -> list[str]:
    """The scale's colours with values below, 240 wide."""
    steps = 60
    shares = (np.arange(steps) + 0.5) / steps
    values = (
        scale.low * (scale.high / scale.low) ** shares
        if scale.logarithmic
        else scale.low + shares * (scale.high - scale.low)
    )
    parts = [
        f'<rect x="{4 * k}" y="4" width="4" height="12" shape-rendering="crispEdges" fill="rgb({r},{g},{b})"/>'
        for k, (r, g, b) in enumerate(scale.colours(values))
    ]
    for value, text in scale.ticks():
        at = 240 * float(scale.share(np.array(value)))
        parts.append(
            f'<path class="m t" d="M{at:.1f} 16v4"/><text x="{at:.1f}" y="32" text-anchor="middle">{text}</text>'
        )
    return [*parts, f'<text x="256" y="14" class="n">{unit}</text>']


def _classes(entries: Sequence[tuple[str, tuple[int, ...]]], unit: str) -> list[str]:
    """Swatches in a row, with what each stands for."""
    parts, at = [], 0.0
    for text, (r, g, b) in entries:
        parts.append(f'<rect x="{at:.0f}" y="6" width="14" height="14" fill="rgb({r},{g},{b})"/>')
        parts.append(f'<text x="{at + 19:.0f}" y="18">{text}</text>')
        at += 34 + 6.6 * len(text)
    return [*parts, f'<text x="{at:.0f}" y="18" class="n">{unit}</text>']
