"""Which sheet a calibration's own stripes support: the models of sheet_models.py, at several angles of the laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.bundle import stripe_in_rig
from garbi_map.calibrate.laser import LaserCalibration
from garbi_map.calibrate.sheet_models import SheetTest, compare_sheets
from garbi_map.log.records import Floats

SHARES = (0.2, 0.5, 0.8)  # of the sweep, where the sheet is looked at
WIDTH = 0.03  # share of the sweep to either side whose stripes are turned to one angle
LEAST_POSES = 4  # of the target: with fewer, what is common to a pose cannot be told from the sheet's shape
MOST = 240  # points of an angle


@dataclass(frozen=True)
class SheetAt:
    """The test at an angle of the encoder, rad."""

    alpha: float
    test: SheetTest


def sheets_of(found: LaserCalibration) -> list[SheetAt]:
    """The test at up to three angles; empty where too few poses of the target were lit there.

    The points are where the rays meet the target, which the laser's model has hardly moved; those of nearby angles are
    turned about its axis to one. A pose of the target is a group.
    """
    stripes, laser = found.stripes, found.laser
    good = found.adjusted.stripe_good
    points = stripe_in_rig(found.scanner, found.adjusted.poses, stripes)
    alpha = stripes.alpha + found.scanner.latency * stripes.rate
    low, high = float(alpha.min()), float(alpha.max())
    tests = []
    for share in SHARES if found.motor else (0.5,):
        middle = low + share * (high - low)
        near = good & (np.abs(alpha - middle) <= WIDTH * (high - low) + 1e-9)
        if len(np.unique(stripes.view[near])) < LEAST_POSES:
            continue
        kept = np.flatnonzero(near)
        kept = kept[np.linspace(0, len(kept) - 1, min(MOST, len(kept))).astype(int)]
        turned = _turned(points[kept], middle - alpha[kept], laser.axis[:, 2], laser.apex)
        tests.append(SheetAt(middle, compare_sheets(turned, stripes.view[kept], laser.apex)))
    return tests


def _turned(points: Floats, angle: Floats, axis: Floats, apex: Floats) -> Floats:
    return np.asarray(Rotation.from_rotvec(angle[:, None] * axis).apply(points - apex) + apex)


def sheet_lines(sheets: list[SheetAt]) -> list[str]:
    """The outcome in words, a line each."""
    if not sheets:
        return [f"sheet: not tested, {LEAST_POSES} poses of the target at one angle are needed"]
    return [
        f"sheet at {np.degrees(sheet.alpha):.1f} degrees: {sheet.test.supported}; {sheet.test.evidence}"
        for sheet in sheets
    ]


def bent(sheets: list[SheetAt]) -> bool:
    """Whether at most of the angles a plane is not what the points support."""
    return 2 * sum(sheet.test.supported != "plane" for sheet in sheets) > len(sheets)
