"""Small drawings in SVG: a chart, a histogram, bars on a timeline. All text is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.axes import BOTTOM, LEFT, TOP, WIDTH, Axes, decades, path_of, thinned

_LETTER = 6.5
"""Usual width of a letter."""


@dataclass(frozen=True)
class Line:
    """A curve: x (n,), y (n,), gaps where NaN; band (n,) half the width of a shade about it."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: str = "a"
    band: NDArray[np.float64] | None = None


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
        y, half = thinned(line.y), thinned(band)
        across = axes.across(thinned(line.x))
        if line.band is not None:
            upper, lower = axes.down(y + half), axes.down(y - half)
            good = np.isfinite(upper)
            outline = np.r_[np.c_[across, upper][good], np.c_[across, lower][good][::-1]]
            axes.parts.append(f'<path class="{line.style} f" d="{path_of(outline)}Z"/>')
        axes.parts.append(f'<path class="{line.style} l" d="{path_of(np.c_[across, axes.down(y)])}"/>')
    for number, line in enumerate(lines):
        at = LEFT + 12 + 190 * number
        axes.parts.append(f'<path class="{line.style} l" d="M{at} {TOP - 14}h22"/>')
        axes.write(at + 28, TOP - 10, line.label)
    return axes.svg(title)


def histogram(title: str, values: NDArray, x_label: str, width: int = WIDTH, bins: int = 48) -> str:
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
    axes = Axes((0.0, float(edges[-1])), (0.0, 1.12 * float(share.max())), 240, width=width)
    axes.grid(x_label, "% of cells")
    floor = float(axes.down(0.0))
    for left, right, height in zip(edges[:-1], edges[1:], share, strict=True):
        x0, x1, y = float(axes.across(left)), float(axes.across(right)), float(axes.down(height))
        axes.bar(x0 + 0.5, y, x1 - x0 - 1, floor - y)
    for value, name, side in ((median, "median", "end"), (p95, "95 %", "start")):
        at = float(axes.across(value))
        axes.parts.append(f'<path class="m" d="M{at:.1f} {TOP}V{floor:.1f}"/>')
        axes.write(at, TOP - 4, f"{name} {value:.3g}", side)
    return axes.svg(title)


def histograms(title: str, entries: Sequence[tuple[str, NDArray, str]], x_label: str, bins: int = 60) -> str:
    """How often positive values occur, on a logarithmic axis: (label, values, style) each, one curve over the other.

    Empty where nothing is positive and finite.
    """
    kept = [(label, np.log10(values[np.isfinite(values) & (values > 0)]), style) for label, values, style in entries]
    everything = np.concatenate([values for _, values, _ in kept]) if kept else np.empty(0)
    if not len(everything):
        return ""
    low, high = np.percentile(everything, [0.5, 99.9])
    edges = np.linspace(low, max(high, low + 0.5), bins + 1)
    shares = [100 * np.histogram(values, edges)[0] / max(len(values), 1) for _, values, _ in kept]
    axes = Axes((float(edges[0]), float(edges[-1])), (0.0, 1.12 * float(max(share.max() for share in shares))), 240)
    axes.grid(x_label, "% of pairs", [(float(np.log10(value)), text) for value, text in decades(*10 ** edges[[0, -1]])])
    across = np.repeat(axes.across(edges), 2)
    least = min((float(np.median(values)) for _, values, _ in kept if len(values)), default=0.0)
    for (label, values, style), share in zip(kept, shares, strict=True):
        steps = np.c_[across, axes.down(np.r_[0.0, np.repeat(share, 2), 0.0])]
        axes.parts.append(
            f'<path class="{style} f" d="{path_of(steps)}Z"/><path class="{style} l" d="{path_of(steps)}"/>'
        )
        if not len(values):
            continue
        middle = float(np.median(values))
        at = float(axes.across(np.clip(middle, *axes.x)))
        axes.parts.append(f'<path class="m" d="M{at:.1f} {TOP}V{axes.height - axes.bottom}"/>')
        text = f"{label}: median {10**middle:.2g}"
        room = _LETTER * len(text)
        if middle <= least:
            axes.write(max(at, room), TOP - 6, text, "end")
        else:
            axes.write(min(at, WIDTH - room), TOP - 6, text)
    return axes.svg(title)


def timeline(title: str, spans: Sequence[tuple[str, float, float, str]]) -> str:
    """Bars (lane, begin, end in seconds, "good", "lost" or "absent"), a row for each lane. Empty without spans."""
    if not spans:
        return ""
    lanes = list(dict.fromkeys(span[0] for span in spans))
    low, high = min(span[1] for span in spans), max(span[2] for span in spans)
    axes = Axes((low, max(high, low + 1e-3)), (0.0, 1.0), TOP + BOTTOM + 24 * len(lanes), left=190)
    axes.grid("s since the begin of the log", "", y_ticks=())
    for number, lane in enumerate(lanes):
        axes.write(182, TOP + 24 * number + 16, lane if len(lane) <= 28 else lane[:27] + "…", "end")
    for lane, begin, end, state in spans:
        x0, x1 = float(axes.across(begin)), float(axes.across(end))
        y = TOP + 24 * lanes.index(lane) + 5
        if state == "absent":
            axes.parts.append(f'<path class="m" d="M{x0:.1f} {y + 7}H{x1:.1f}"/>')
            axes.write((x0 + x1) / 2, y + 11, "not in the log", "middle", "h")
        else:
            axes.bar(x0, y, max(x1 - x0 - 0.8, 0.8), 14, "w" if state == "lost" else "a")
    return axes.svg(title)
