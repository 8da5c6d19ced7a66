"""Where a map is weak, in words and as masks: seen once, unsure, not seen at all, sweeps that disagree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register.agreement import Agreement
from garbi_map.seabed import Seabed
from garbi_map.words import length, percent

Mask = NDArray[np.bool_]

_BRIDGE = 0.1
"""m; an inlet of the map's outline that is narrower than twice this counts as a hole in it."""
_WORTH_A_LINE = 0.002
"""Least share of the cells that is worth a line."""
_UNSURE = 3.0
"""Times the median uncertainty of a cell that is called much."""
_APART = 5.0
"""Times the median distance of sweeps that is called much: more than three sigma."""
_BESIDE = 0.01
"""m; the points of a sweep are farther apart than cells are wide, so that what saw a cell's neighbour saw the cell."""
_FEW_POINTS, _ASKED_SHARE = 5, 0.95
"""IHO S-44 and the surveyors who follow it ask for five soundings in 95 % of the cells."""

_SIDES = (("south-west corner", "southern edge", "south-east corner"), ("western edge", "middle", "eastern edge"),
          ("north-west corner", "northern edge", "north-east corner"))  # fmt: skip
_BANDS = ("southern third", "middle from west to east", "northern third")
_COLUMNS = ("western third", "middle from south to north", "eastern third")


def weak_places(seabed: Seabed, agreement: Agreement, widest_hole: float) -> list[str]:
    """One line for each way in which the map is weak: how much of it and where; north is y of the map."""
    known = seabed.known
    inside = outline(seabed)
    lines = []

    def tell(mask: Mask, among: Mask, text: str, why: str = "") -> None:
        share = _share(mask, among)
        if share >= _WORTH_A_LINE:
            shown = f"{percent(share)} of the area ({area(mask, seabed)})"
            lines.append(f"{shown} {text}, {where(mask, among, inside)}{why}.")

    tell(known & (sweeps_about(seabed) < 2), known, "was seen by one sweep only", ": nothing checks the path there")
    limit = _UNSURE * float(np.median(seabed.uncertainty[known]))
    unsure = np.zeros_like(known)
    unsure[known] = seabed.uncertainty[known] > limit
    tell(unsure, known, f"is less sure than {length(limit)} (three times the median, 1 sigma)")
    holes = holes_inside(seabed, inside, widest_hole)
    tell(holes, inside, "inside the outline was not seen", _largest(holes, seabed))
    lines += _apart(seabed, agreement, inside)
    few = known & (seabed.density < _FEW_POINTS)
    share = _share(few, known)
    if share > 1 - _ASKED_SHARE:
        lines.append(
            f"{percent(share)} of the cells of {length(seabed.cell)} hold fewer than {_FEW_POINTS} points "
            f"(surveyors ask for {_FEW_POINTS} in {percent(_ASKED_SHARE)} of them), {where(few, known, inside)}."
        )
    return lines


def sweeps_about(seabed: Seabed) -> NDArray[np.int32]:
    """(rows, columns) the sweeps that saw a cell, or one within a centimetre of it; 0 where it holds nothing itself."""
    import cv2

    reach = round(_BESIDE / seabed.cell)
    count = cv2.dilate(np.minimum(seabed.sweeps, 60_000).astype(np.uint16), np.ones((2 * reach + 1,) * 2, np.uint8))
    return np.where(seabed.known, count, 0).astype(np.int32)


def outline(seabed: Seabed) -> Mask:
    """(rows, columns) the cells inside the map's outline, holes and narrow inlets included."""
    import cv2

    known = seabed.known.astype(np.uint8)
    factor = max(1, -(-max(known.shape) // 1000))  # an outline of a thousand cells is fine enough, and quick
    small = cv2.dilate(known, np.ones((factor, factor), np.uint8))[::factor, ::factor]
    reach = max(1, round(_BRIDGE / seabed.cell / factor))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    padded = np.pad(small, reach + 1)
    closed = cv2.erode(cv2.dilate(padded, disc), disc)
    rims, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros_like(closed), rims, -1, 1, cv2.FILLED)[
        reach + 1 : -reach - 1, reach + 1 : -reach - 1
    ]
    full = np.repeat(np.repeat(filled, factor, 0), factor, 1)[: known.shape[0], : known.shape[1]]
    return (full > 0) | seabed.known


def holes_inside(seabed: Seabed, inside: Mask, widest_hole: float) -> Mask:
    """(rows, columns) cells inside the outline that hold nothing, in gaps wider than `widest_hole` m along x and along y.

    The narrower ones are those that `fill_holes` interpolates.
    """
    reach = round(widest_hole / seabed.cell)
    known = np.pad(seabed.known.astype(np.uint8), reach)
    filled = (_closed(known, reach) | _closed(known.T, reach).T)[reach:, reach:][: inside.shape[0], : inside.shape[1]]
    return inside & ~filled


def where(mask: Mask, among: Mask, inside: Mask) -> str:
    """In words, in which part of the cells `among` those of a mask are: where most are that are not everywhere.

    inside: the cells of the outline, which tells the rim from the middle.
    """
    share, usual = _ninths(mask, among), _ninths(among, among)
    row, column = np.unravel_index(np.argmax(share), share.shape)
    if share[row, column] >= 0.5 and share[row, column] >= 2 * usual[row, column]:
        side = _SIDES[row][column]
        return f"mostly {'at' if 'edge' in side else 'in'} the {side}"
    for axis, names in ((1, _BANDS), (0, _COLUMNS)):
        sums, normal = share.sum(axis=axis), usual.sum(axis=axis)
        best = int(np.argmax(sums))
        if sums[best] >= 0.7 and sums[best] >= 1.6 * normal[best]:
            return f"mostly in the {names[best]}"
    rim = _rim(inside)
    outer, expected = _share(mask & rim, mask), _share(among & rim, among)
    if outer >= 0.6 and outer >= 1.5 * expected:
        return "mostly along the rim"
    return "spread over the map"


def area(mask: Mask, seabed: Seabed) -> str:
    """The area of a mask's cells, in words."""
    square = np.count_nonzero(mask) * seabed.cell**2
    return (
        f"{square:.2g} m²"
        if square >= 0.1
        else f"{1e4 * square:.2g} cm²"
        if square < 0.01
        else f"{1e4 * square:.0f} cm²"
    )


def _apart(seabed: Seabed, agreement: Agreement, inside: Mask) -> list[str]:
    """Where sweeps that overlap lie farther apart than elsewhere."""
    if not len(agreement.after):
        return ["No two sweeps overlap: nothing checks the path anywhere."]
    limit = _APART * agreement.median[1]
    far = agreement.after > limit
    index = np.floor((agreement.place - np.asarray(seabed.origin)) / seabed.cell).astype(int)[:, ::-1]
    good = ((index >= 0) & (index < seabed.known.shape)).all(axis=1)
    overlap, apart = np.zeros(seabed.known.shape, bool), np.zeros(seabed.known.shape, bool)
    overlap[tuple(index[good].T)] = True
    apart[tuple(index[good & far].T)] = True
    share = float(far.mean())
    if share < _WORTH_A_LINE or not apart.any():
        return []
    return [
        f"Sweeps lie more than {length(limit)} apart (five times the median) in {percent(share)} of the places where "
        f"they overlap, {where(apart, overlap, inside)}."
    ]


def _largest(holes: Mask, seabed: Seabed) -> str:
    """The largest hole, as the end of a sentence."""
    import cv2

    count, names, stats, centres = cv2.connectedComponentsWithStats(holes.astype(np.uint8), connectivity=8)
    if count < 2:
        return ""
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    x, y = np.asarray(seabed.origin) + (centres[largest] + 0.5) * seabed.cell
    which = "one hole" if count == 2 else f"{count - 1:,} holes, the largest"
    return f": {which} of {area(names == largest, seabed)} about x = {x:.2f} m, y = {y:.2f} m"


def _share(mask: Mask, among: Mask) -> float:
    return float(np.count_nonzero(mask)) / max(float(np.count_nonzero(among)), 1.0)


def _closed(known: NDArray[np.uint8], gap: int) -> Mask:
    """Known cells, and gaps between them of up to so many cells of a column."""
    import cv2

    line, middle = np.ones((gap + 1, 1), np.uint8), (gap + 1) // 2
    # mirrored, because a line of even length has no middle
    return cv2.erode(cv2.dilate(known, line, anchor=(0, middle)), line, anchor=(0, gap - middle)) > 0


def _ninths(mask: Mask, among: Mask) -> NDArray[np.float64]:
    """(3, 3) share of a mask's cells in each ninth of the box about `among`, southernmost and westernmost first."""
    rows, columns = (np.flatnonzero(among.any(axis=axis)) for axis in (1, 0))
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    counts = [
        [np.count_nonzero(part) for part in np.array_split(band, 3, axis=1)] for band in np.array_split(box, 3, axis=0)
    ]
    return np.array(counts, float) / max(np.count_nonzero(box), 1)


def _rim(inside: Mask) -> Mask:
    """The outer fifth of an area, seen from its edge to its middle."""
    import cv2

    depth = cv2.distanceTransform(np.pad(inside.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return inside & (depth <= 0.2 * depth.max())
