"""Small drawings in SVG: a chart, a histogram, bars on a timeline. All text is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 860, 62, 16, 26, 44
_MOST_VERTICES = 900


@dataclass(frozen=True)
class Line:
    """A curve: x (n,), y (n,), gaps where NaN; band (n,) half the width of a shade about it."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: str = "a"
    band: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Axes:
    """From data to the drawing's units."""

    x: tuple[float, float]
    y: tuple[float, float]
    height: int
    left: int = LEFT
    parts: list[str] = field(default_factory=list)

    def across(self, x: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Horizontal place of x."""
        share = (np.asarray(x, np.float64) - self.x[0]) / (self.x[1] - self.x[0])
        return self.left + share * (WIDTH - self.left - RIGHT)

    def down(self, y: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Vertical place of y."""
        share = (np.asarray(y, np.float64) - self.y[0]) / (self.y[1] - self.y[0])
        return self.height - BOTTOM - share * (self.height - TOP - BOTTOM)

    def grid(self, x_label: str, y_label: str, y_ticks: bool = True) -> None:
        """Ticks, grid lines and names of the axes."""
        floor = self.height - BOTTOM
        for value, text in ticks(*self.x, 8):
            at = float(self.across(value))
            self.parts.append(f'<path class="g" d="M{at:.1f} {TOP}V{floor}"/>')
            self.parts.append(f'<text x="{at:.1f}" y="{floor + 16}" text-anchor="middle">{text}</text>')
        for value, text in ticks(min(self.y), max(self.y), 5) if y_ticks else ():
            at = float(self.down(value))
            self.parts.append(f'<path class="g" d="M{self.left} {at:.1f}H{WIDTH - RIGHT}"/>')
            self.parts.append(f'<text x="{self.left - 7}" y="{at + 4:.1f}" text-anchor="end">{text}</text>')
        middle = (self.left + WIDTH - RIGHT) / 2
        self.parts.append(
            f'<text x="{middle}" y="{self.height - 8}" text-anchor="middle" class="n">{escape(x_label)}</text>'
        )
        if y_label:
            at = (TOP + floor) / 2
            self.parts.append(
                f'<text x="14" y="{at}" transform="rotate(-90 14 {at})" text-anchor="middle" class="n">'
                f"{escape(y_label)}</text>"
            )

    def svg(self, title: str) -> str:
        """The drawing."""
        return (
            f'<svg viewBox="0 0 {WIDTH} {self.height}" role="img" aria-label="{escape(title)}">'
            f"{''.join(self.parts)}</svg>"
        )


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round values in [low, high], at most about `most`, with their text."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw * (1 - 1e-9))
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    return [(float(v), f"{v + 0.0:.{digits}f}") for v in values]


def chart(title: str, lines: Sequence[Line], x_label: str, y_label: str, flip: bool = False) -> str:
    """Curves over one pair of axes; flip: y grows downward, as depth does. Empty where nothing is finite."""
    bands = [np.zeros_like(line.y) if line.band is None else line.band for line in lines]
    y = np.concatenate([np.r_[line.y - band, line.y + band] for line, band in zip(lines, bands, strict=True)])
    x = np.concatenate([line.x for line in lines])
    y, x = y[np.isfinite(y)], x[np.isfinite(x)]
    if not len(y) or not len(x):
        return ""
    margin = max(0.06 * float(np.ptp(y)), 1e-4)
    low, high = float(y.min()) - margin, float(y.max()) + margin
    end = max(float(x.max()), float(x.min()) + 1e-3)
    axes = Axes((float(x.min()), end), (high, low) if flip else (low, high), 260)
    axes.grid(x_label, y_label)
    for line, band in zip(lines, bands, strict=True):
        pick = np.unique(np.linspace(0, len(line.x) - 1, min(len(line.x), _MOST_VERTICES)).astype(int))
        across = axes.across(line.x[pick])
        if line.band is not None:
            upper, lower = axes.down(line.y[pick] + band[pick]), axes.down(line.y[pick] - band[pick])
            good = np.isfinite(upper)
            outline = np.r_[np.c_[across, upper][good], np.c_[across, lower][good][::-1]]
            axes.parts.append(f'<path class="{line.style} f" d="{_path(outline)}Z"/>')
        axes.parts.append(f'<path class="{line.style} l" d="{_path(np.c_[across, axes.down(line.y[pick])])}"/>')
    for number, line in enumerate(lines):
        at = LEFT + 12 + 190 * number
        axes.parts.append(f'<path class="{line.style} l" d="M{at} {TOP - 14}h22"/>')
        axes.parts.append(f'<text x="{at + 28}" y="{TOP - 10}">{escape(line.label)}</text>')
    return axes.svg(title)


def histogram(title: str, values: NDArray, x_label: str, bins: int = 48) -> str:
    """How often values occur, up to 2.5 times their 95th percentile; that and the median are marked.

    Empty where nothing is finite.
    """
    values = np.asarray(values, np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    median, p95 = np.percentile(values, [50, 95])
    count, edges = np.histogram(values, bins, (0.0, max(2.5 * float(p95), 1e-9)))
    share = 100 * count / len(values)
    axes = Axes((0.0, float(edges[-1])), (0.0, 1.12 * float(share.max())), 240)
    axes.grid(x_label, "% of cells")
    floor = float(axes.down(0.0))
    for left, right, height in zip(edges[:-1], edges[1:], share, strict=True):
        x0, x1, y = float(axes.across(left)), float(axes.across(right)), float(axes.down(height))
        axes.parts.append(
            f'<rect class="a b" x="{x0 + 0.5:.1f}" y="{y:.1f}" width="{x1 - x0 - 1:.1f}" height="{floor - y:.1f}"/>'
        )
    for value, name, side in ((median, "median", "end"), (p95, "95 %", "start")):
        at = float(axes.across(value))
        axes.parts.append(f'<path class="m" d="M{at:.1f} {TOP}V{floor:.1f}"/>')
        axes.parts.append(f'<text x="{at:.1f}" y="{TOP - 4}" text-anchor="{side}">{name} {value:.3g}</text>')
    return axes.svg(title)


def timeline(title: str, spans: Sequence[tuple[str, float, float, str]]) -> str:
    """Bars (lane, begin, end in seconds, "good" or "lost"), a row for each lane. Empty without spans."""
    if not spans:
        return ""
    lanes = list(dict.fromkeys(span[0] for span in spans))
    low, high = min(span[1] for span in spans), max(span[2] for span in spans)
    axes = Axes((low, max(high, low + 1e-3)), (0.0, 1.0), TOP + BOTTOM + 24 * len(lanes), left=190)
    axes.grid("s since the begin of the log", "", y_ticks=False)
    for number, lane in enumerate(lanes):
        shown = lane if len(lane) <= 28 else lane[:27] + "…"
        axes.parts.append(f'<text x="182" y="{TOP + 24 * number + 16}" text-anchor="end">{escape(shown)}</text>')
    for lane, begin, end, state in spans:
        x0, x1 = float(axes.across(begin)), float(axes.across(end))
        y = TOP + 24 * lanes.index(lane) + 5
        style = "w" if state == "lost" else "a"
        width = max(x1 - x0 - 0.8, 0.8)
        axes.parts.append(f'<rect class="{style} b" x="{x0:.1f}" y="{y}" width="{width:.1f}" height="14"/>')
    return axes.svg(title)


def _path(points: NDArray[np.float64]) -> str:
    """An SVG path through points (n, 2), begun anew after NaN."""
    good = np.isfinite(points[:, 0]) & np.isfinite(points[:, 1])
    begins = good & ~np.r_[False, good[:-1]]
    return "".join(
        f"{'M' if begin else 'L'}{x:.1f} {y:.1f}" for (x, y), begin in zip(points[good], begins[good], strict=True)
    )
