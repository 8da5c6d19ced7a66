"""What a map is worth, in a few plain sentences and four numbers."""

from __future__ import annotations

import numpy as np

from garbi_map.export.drift import Correction
from garbi_map.export.weak import sweeps_about
from garbi_map.register.agreement import Agreement
from garbi_map.seabed import Seabed
from garbi_map.words import angle, length, percent

_MUCH, _LITTLE = 1.5, 1.1
"""Times by which the distance between sweeps must fall to be called removed, and not the same."""


def plain_verdict(seabed: Seabed, agreement: Agreement, losses: int) -> str:
    """The first thing that a reader sees."""
    known = seabed.known
    sure = f"The height of a cell of {length(seabed.cell)} is known to {length(_middle(seabed))} (1 sigma, median)."
    once = np.count_nonzero(sweeps_about(seabed)[known] < 2) / np.count_nonzero(known)
    weak = f" {percent(once)} of the area was seen by one sweep only, where nothing checks the path." if once else ""
    left = " Something was left out or missing: see below." if losses else ""
    return f"{_drift_removed(agreement)} {sure}{weak}{left}"


def numbers(seabed: Seabed, agreement: Agreement, found: Correction) -> list[tuple[str, str]]:
    """Four numbers, each with what it is."""
    before, after = agreement.median
    overlap = ("–", "between sweeps: none overlap")
    if np.isfinite(after):
        overlap = (length(after), f"between overlapping sweeps, median; {length(before)} by navigation alone")
    return [
        (f"{seabed.area:.3g} m²", f"mapped, in cells of {length(seabed.cell)}"),
        (length(_middle(seabed)), "1 sigma of a cell's height, median"),
        overlap,
        (
            length(found.distance),
            f"of drift found, and {angle(np.rad2deg(found.angle))}, rms against the navigation filter",
        ),
    ]


def _drift_removed(agreement: Agreement) -> str:
    before, after = agreement.median
    if not np.isfinite(after):
        return "No two sweeps overlap, so that the map is as good as the navigation and nothing checks it."
    if before > _MUCH * after:
        return (
            f"The drift was found and removed: overlapping sweeps lie {length(after)} apart; "
            f"navigation alone would leave them {length(before)} apart."
        )
    if after > _LITTLE * before:
        return (
            f"Look twice: overlapping sweeps lie {length(after)} apart, farther than with navigation alone "
            f"({length(before)}); the residual maps show where."
        )
    return f"There was little drift to remove: overlapping sweeps lie {length(after)} apart, {length(before)} before."


def _middle(seabed: Seabed) -> float:
    return float(np.median(seabed.uncertainty[seabed.known]))
