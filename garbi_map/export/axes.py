"""Axes of a drawing in SVG: from data to the drawing's units, grid, text. All text is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 860, 62, 16, 26, 44
_MOST_VERTICES = 900

Tick = tuple[float, str]


@dataclass(frozen=True)
class Axes:
    """From data to the drawing's units, with room for what is written about the axes."""

    x: tuple[float, float]
    y: tuple[float, float]
    height: int
    left: int = LEFT
    width: int = WIDTH
    top: int = TOP
    bottom: int = BOTTOM
    parts: list[str] = field(default_factory=list)

    def across(self, x: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Horizontal place of x."""
        share = (np.asarray(x, np.float64) - self.x[0]) / (self.x[1] - self.x[0])
        return self.left + share * (self.width - self.left - RIGHT)

    def down(self, y: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Vertical place of y."""
        share = (np.asarray(y, np.float64) - self.y[0]) / (self.y[1] - self.y[0])
        return self.height - self.bottom - share * (self.height - self.top - self.bottom)

    def grid(
        self, x_label: str, y_label: str, x_ticks: Sequence[Tick] | None = None, y_ticks: Sequence[Tick] | None = None
    ) -> None:
        """Grid lines, ticks with their text (round values where none are given) and names of the axes."""
        floor = self.height - self.bottom
        for value, text in ticks(*self.x, 8 if self.width == WIDTH else 5) if x_ticks is None else x_ticks:
            at = float(self.across(value))
            self.parts.append(f'<path class="g" d="M{at:.1f} {self.top}V{floor}"/>')
            self.write(at, floor + 16, text, "middle")
        for value, text in ticks(min(self.y), max(self.y), 5) if y_ticks is None else y_ticks:
            at = float(self.down(value))
            self.parts.append(f'<path class="g" d="M{self.left} {at:.1f}H{self.width - RIGHT}"/>')
            self.write(self.left - 7, at + 4, text, "end")
        if x_label:
            self.write((self.left + self.width - RIGHT) / 2, self.height - 8, x_label, "middle", "n")
        if y_label:
            at = (self.top + floor) / 2
            self.parts.append(
                f'<text x="14" y="{at}" transform="rotate(-90 14 {at})" text-anchor="middle" class="n">'
                f"{escape(y_label)}</text>"
            )

    def write(self, x: float, y: float, text: str, anchor: str = "start", style: str = "") -> None:
        """Text at a place of the drawing, escaped."""
        kind = f' class="{style}"' if style else ""
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{kind}>{escape(text)}</text>')

    def bar(self, x: float, y: float, width: float, height: float, style: str = "a") -> None:
        """A filled rectangle, in the drawing's units."""
        self.parts.append(
            f'<rect class="{style} b" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
        )

    def svg(self, title: str) -> str:
        """The drawing."""
        return (
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" aria-label="{escape(title)}">'
            f"{''.join(self.parts)}</svg>"
        )


def ticks(low: float, high: float, most: int) -> list[Tick]:
    """Round values in [low, high], at most about `most`, with their text."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw * (1 - 1e-9))
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    return [(float(v), f"{v + 0.0:.{digits}f}") for v in values]


def decades(low: float, high: float) -> list[Tick]:
    """1, 2 and 5 times powers of ten in [low, high], or only 1 and 3 where that is much, with their text."""
    powers = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    steps = (1.0, 2.0, 5.0) if np.log10(high / low) < 2.5 else (1.0,)
    values = [step * 10.0**power for power in powers for step in steps]
    return [(value, f"{value:g}") for value in values if low * 0.999 <= value <= high * 1.001]


def thinned(values: NDArray) -> NDArray:
    """As many entries, evenly, as a drawing can show; first and last among them."""
    return values[np.unique(np.linspace(0, len(values) - 1, min(len(values), _MOST_VERTICES)).astype(int))]


def path_of(points: NDArray[np.float64]) -> str:
    """An SVG path through points (n, 2), begun anew after NaN."""
    good = np.isfinite(points[:, 0]) & np.isfinite(points[:, 1])
    begins = good & ~np.r_[False, good[:-1]]
    return "".join(
        f"{'M' if begin else 'L'}{x:.1f} {y:.1f}" for (x, y), begin in zip(points[good], begins[good], strict=True)
    )
