"""What to do better next time, in plain words."""

from __future__ import annotations

import numpy as np

from garbi_map.calibrate.camera import CameraCalibration
from garbi_map.calibrate.laser import LaserCalibration, latency_observable
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.sheet_test import SheetAt, bent

CELLS = (6, 4)  # of the image, for coverage


def coverage(found: CameraCalibration) -> np.ndarray:
    """Corners in each of the image's cells (rows, columns)."""
    pixel = found.adjusted.scanner.camera
    seen = np.concatenate([view.pixel for view in found.views])
    counts, _, _ = np.histogram2d(seen[:, 1], seen[:, 0], bins=CELLS[::-1], range=[[0, pixel.height], [0, pixel.width]])
    return counts


def camera_advice(found: CameraCalibration) -> list[str]:
    """Advice on a camera's calibration; empty where there is none to give."""
    lines = []
    empty = float((coverage(found) < 3).mean())
    if empty > 0.15:
        lines.append(
            f"{100 * empty:.0f} % of the image never saw the target: show it at the borders and in the corners"
        )
    far = found.distances
    if np.ptp(far) < 0.25 * np.median(far):
        lines.append(f"all views are at about {np.median(far):.2f} m: show the target at a second distance")
    if found.hold_out > 1.5 * found.in_sample:
        lines.append(
            f"corners that were not fitted are off by {found.hold_out:.2f} px, fitted ones by {found.in_sample:.2f}: "
            "more views, or fewer free parameters"
        )
    if found.in_sample > 0.6:
        lines.append(
            "residuals are large: is the target flat, are its squares as long as target.yaml says, is it still?"
        )
    bad = 1.0 - float(found.adjusted.corner_good.mean())
    if bad > 0.05:
        lines.append(f"{100 * bad:.0f} % of the corners were left out as wrong: look at the residuals")
    return lines


def laser_advice(found: LaserCalibration, sheets: list[SheetAt], settings: CalibrateSettings) -> list[str]:
    """Advice on a laser's calibration; empty where there is none to give."""
    lines = []
    far = found.distances
    if np.ptp(far) < 0.25 * np.median(far):
        lines.append(f"the stripe was seen at about {np.median(far):.2f} m only: show the target at a second distance")
    elif max(far) < 0.6 * max(settings.ranges):
        lines.append(
            f"the farthest stripe was at {max(far):.2f} m: show the target nearer to {max(settings.ranges):g} m"
        )
    if found.motor:
        for name in ("beta", "theta", "gamma"):
            if (
                f"laser.{name}" in found.adjusted.free
                and found.adjusted.sigma(f"laser.{name}") > 0.6 * settings.prior_tilt
            ):
                lines.append(
                    f"{name} is not observable from this sweep: what is written is mostly what was assumed (0)"
                )
        if "laser.z" in found.adjusted.free and found.adjusted.sigma("laser.z") > 0.6 * settings.prior_height:
            lines.append("z is not observable, as beta is close to zero: it hardly matters then")
        if not latency_observable(found.stripes):
            lines.append(
                "the laser turned one way only: the encoder's latency cannot be told from delta; sweep both ways"
            )
    if bent(sheets) and found.laser.window is None:
        lines.append(
            "the sheet is not a plane, whatever the residuals: it leaves its housing through a window; give laser.window"
        )
    if found.hold_out_px > 1.5 * found.adjusted.stripe_sigma:
        lines.append(
            "images that were not fitted fit worse: is the sheet a plane? Give laser.window if it leaves a housing"
        )
    bad = 1.0 - float(found.adjusted.stripe_good.mean())
    if bad > 0.05:
        lines.append(f"{100 * bad:.0f} % of the stripe was left out as wrong: look at the residuals")
    return lines
