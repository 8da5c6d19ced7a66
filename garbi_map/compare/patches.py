"""Patches of the seabed that changed, and which of them are one thing that moved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, binary_opening, label, sum_labels
from scipy.stats import norm

from garbi_map.compare.change import Change
from garbi_map.compare.moves import Move, find_move
from garbi_map.compare.settings import CompareSettings

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_AROUND = np.ones((3, 3), bool)
_FARTHER = 0.4
"""What the farthest move counts, as misfit: of like shapes the nearer is the one that moved."""
_FRINGE = 2
"""Cells by which a patch reaches beyond where it is three cells wide."""
_OVERHANG = 3
"""Cells by which a patch grows into what is hidden beside it."""


@dataclass(frozen=True)
class Patch:
    """Something that changed; the frame is that of the first map.

    kind         appeared, vanished, or moved: then lost in one place and gained in another
    place        (x, y) m, where its middle is; of what moved: where it was
    area         m^2
    gained       m^3, and lost, m^3; sigma: 1 sigma of either
    largest      m, the largest rise or fall, with its sign
    detection    m, the level of detection, in the mean of its cells
    move         (x, y) m by which it moved, None for what did not
    label        its number in the raster of patches; of what moved also that of the gain
    """

    number: int
    kind: Literal["appeared", "vanished", "moved"]
    place: tuple[float, float]
    area: float
    gained: float
    lost: float
    sigma: float
    largest: float
    detection: float
    label: tuple[int, ...]
    move: tuple[float, float] | None = None

    @property
    def mean(self) -> float:
        """By how much it rose or fell in the mean of its area, m, without a sign."""
        return (self.gained + self.lost) / self.area

    @property
    def moved(self) -> float | None:
        """How far, m."""
        return None if self.move is None else float(np.hypot(*self.move))


def find_patches(change: Change, settings: CompareSettings) -> tuple[list[Patch], NDArray[np.int32]]:
    """The changed patches, largest volume first, and the raster (rows, columns) of their labels, 0 where unchanged.

    Cells beyond the level of detection that touch are a patch if together they are large enough, three cells wide
    somewhere, and half of that so sure that among all cells, none changed, `false_alarms` such are expected.
    """
    distance, sigma = np.nan_to_num(change.distance), change.sigma
    beyond = np.abs(distance) > np.maximum(change.detection, settings.least_change)
    # a cylinder is as wide as several cells, which are therefore not so many cases
    cases = max(1.0, np.count_nonzero(change.compared) * change.cell**2 / (0.25 * np.pi * settings.cylinder**2))
    surest = float(norm.isf(settings.false_alarms / cases / 2))
    labels = np.zeros(distance.shape, np.int32)
    count = 0
    singles: list[Patch] = []
    for sign in (1.0, -1.0):
        mask = beyond & (sign * distance > 0)
        whole = binary_closing(np.pad(mask, 1), _AROUND)[1:-1, 1:-1] & change.compared
        # a line along the edge of something is what one map saw behind it and the other did not
        core = binary_opening(np.pad(whole, 1), _AROUND)[1:-1, 1:-1]
        joined, found = label(binary_dilation(core, _AROUND, _FRINGE, mask=whole), _AROUND)
        if not found:
            continue
        each = np.arange(1, found + 1)
        sure = mask & (np.abs(distance) > surest * sigma)
        enough = sum_labels(sure, joined, each) * change.cell**2 >= 0.5 * settings.least_area
        enough &= sum_labels(mask, joined, each) * change.cell**2 >= settings.least_area
        for old in each[enough]:
            count += 1
            # under its overhang a new thing hides ground that both maps know: part of the thing nevertheless
            around = change.hidden & (sign * change.rise > 0) & (labels == 0)
            mine = (joined == old) | binary_dilation(joined == old, _AROUND, _OVERHANG, mask=around)
            labels[mine] = count
            singles.append(_single(change, mine, count, "appeared" if sign > 0 else "vanished"))
    patches = _paired(change, labels, singles, settings)
    patches.sort(key=lambda patch: -(patch.gained + patch.lost))
    return [replace(patch, number=number) for number, patch in enumerate(patches, 1)], labels


def _single(change: Change, mine: Mask, number: int, kind: Literal["appeared", "vanished"]) -> Patch:
    row, column = np.nonzero(mine)
    rise, area = change.rise[mine], change.cell**2
    weight = np.abs(rise) / max(np.abs(rise).sum(), 1e-12)
    volume = area * float(rise.sum())
    # what the cells err for themselves averages out, what they share does not
    sigma = area * np.sqrt(change.own[mine].sum() + np.sqrt(change.shared[mine]).sum() ** 2)
    return Patch(
        number=number,
        kind=kind,
        place=(
            change.origin[0] + (float(weight @ column) + 0.5) * change.cell,
            change.origin[1] + (float(weight @ row) + 0.5) * change.cell,
        ),
        area=area * len(row),
        gained=max(volume, 0.0),
        lost=max(-volume, 0.0),
        sigma=float(sigma),
        largest=float(rise[np.argmax(np.abs(rise))]),
        detection=float(np.nanmean(change.detection[mine])),
        label=(number,),
    )


def _paired(change: Change, labels: NDArray[np.int32], singles: list[Patch], settings: CompareSettings) -> list[Patch]:
    """Losses and gains near each other become one thing that moved where its shape is found again; best fits first."""
    gone = [patch for patch in singles if patch.kind == "vanished"]
    new = [patch for patch in singles if patch.kind == "appeared"]
    trials: list[tuple[float, Patch, Patch, Move]] = []
    for old in gone:
        for here in new:
            apart = np.hypot(old.place[0] - here.place[0], old.place[1] - here.place[1])
            alike = min(old.lost, here.gained) / max(old.lost, here.gained, 1e-12)
            if apart > settings.farthest_move or alike < 0.4:
                continue
            move = find_move(change, labels == old.label[0], labels == here.label[0], settings.farthest_move)
            if move is not None:
                near = float(np.hypot(*move.shift)) / settings.farthest_move
                trials.append((move.misfit + _FARTHER * near, old, here, move))
    taken: set[int] = set()
    out = []
    for _, old, here, move in sorted(trials, key=lambda trial: trial[0]):
        if old.number in taken or here.number in taken:
            continue
        taken |= {old.number, here.number}
        largest = max(old.largest, here.largest, key=abs)
        area = old.area + here.area
        detection = (old.detection * old.area + here.detection * here.area) / area
        out.append(
            Patch(
                0, "moved", move.place, area, here.gained, old.lost, float(np.hypot(old.sigma, here.sigma)),
                largest, detection, (old.label[0], here.label[0]), move.shift,
            )
        )  # fmt: skip
    return out + [patch for patch in singles if patch.number not in taken]
