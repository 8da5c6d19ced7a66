"""Whether what was lost in one place is what was gained in another, and by how much it moved."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, map_coordinates
from scipy.optimize import least_squares

from garbi_map.compare.change import Change

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_TOUCHING = 0.03
"""m; a loss and a gain nearer than this overlap as things, so that between them the thing lies in both maps."""
_WORST = 0.45
"""Misfit, in the thing's own relief, from which on it is another shape."""
_FEWEST = 12
"""Cells of a thing whose shape can be told."""


@dataclass(frozen=True)
class Move:
    """place: (x, y) m, where the thing was; shift: (x, y) m; misfit: rms of what is left over the rms of its relief."""

    place: tuple[float, float]
    shift: tuple[float, float]
    misfit: float


def find_move(change: Change, lost: Mask, gained: Mask, farthest: float) -> Move | None:
    """The shift by which the first map's surface about `lost` is found again in the second's about `gained`.

    Masks (rows, columns). None where the shapes differ.
    """
    box = _box(lost | gained, round(0.05 / change.cell))
    lost, gained = lost[box], gained[box]
    before = change.elevation[box]
    after = before + change.rise[box]
    thing, moved = _things(lost, gained, change.cell)
    row, column = np.nonzero(thing & np.isfinite(before))
    if len(row) < _FEWEST:
        return None
    # the ground under the thing is what the other map shows where it is no more
    ground = np.fmin(before, after)
    base = float(np.nanmedian(ground[thing | moved]))
    height = before[row, column] - base
    relief = float(np.sqrt(np.mean(height**2)))
    filled = np.where(np.isfinite(after), after, base) - base

    def left(shift: Floats) -> Floats:
        found = map_coordinates(filled, [row + shift[1], column + shift[0]], order=1, mode="constant")
        return (found - height) / max(relief, 1e-9)

    start = _centre(moved, filled) - _centre(thing, np.where(np.isfinite(before), before - base, 0.0))
    best = None
    for offset in np.array([[0, 0], [3, 0], [-3, 0], [0, 3], [0, -3]], float):
        fit = least_squares(left, start + offset, loss="soft_l1", f_scale=0.3, diff_step=0.02)
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    misfit = float(np.sqrt(np.median(left(best.x) ** 2)))
    shift = best.x * change.cell
    if misfit > _WORST or np.hypot(*shift) > farthest or np.hypot(*shift) < 0.5 * change.cell:
        return None
    here = _centre(thing, np.where(np.isfinite(before), before - base, 0.0)) + [box[1].start, box[0].start] + 0.5
    place = np.asarray(change.origin) + here * change.cell
    return Move((float(place[0]), float(place[1])), (float(shift[0]), float(shift[1])), misfit)


def _box(mask: Mask, margin: int) -> tuple[slice, slice]:
    spans = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    first, second = (
        slice(max(int(span[0]) - margin, 0), min(int(span[-1]) + margin + 1, side))
        for span, side in zip(spans, mask.shape, strict=True)
    )
    return first, second


def _things(lost: Mask, gained: Mask, cell: float) -> tuple[Mask, Mask]:
    """Which cells the thing covered before and after: with what lies between a loss and a gain that touch."""
    reach = max(1, round(_TOUCHING / cell))
    if not (binary_dilation(lost, iterations=reach) & gained).any():
        return lost, gained
    outline = np.zeros(lost.shape, np.uint8)
    rows, columns = np.nonzero(lost | gained)
    hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
    between = cv2.fillConvexPoly(outline, hull, 1) > 0
    return between & ~gained, between & ~lost


def _centre(mask: Mask, height: Floats) -> Floats:
    """(column, row) of a thing's middle, weighted by its height."""
    row, column = np.nonzero(mask)
    weight = np.maximum(np.abs(height[row, column]), 1e-4)
    return np.array([weight @ column, weight @ row]) / weight.sum()
