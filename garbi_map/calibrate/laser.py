"""The laser: from stripes on a target to the sheet's parameters, with what is not known about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from garbi_map.calibrate.bundle import (
    Adjusted,
    Bundle,
    Poses,
    Prior,
    StripePoints,
    diagonal_prior,
    stripe_in_rig,
)
from garbi_map.calibrate.linear import solve_laser, solve_laser_paper
from garbi_map.calibrate.scanner import LASER_NAMES, LATENCY, LENS_NAMES, PORT_NAMES, WINDOW_NAMES, Scanner
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.targets import AnyTarget
from garbi_map.calibrate.uncertainty import Spread, spread_at
from garbi_map.calibrate.views import View, corners_of, poses_by
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.rig import Camera, Laser

ONE_PLANE = ("laser.y", "laser.delta", "laser.beta")  # what a sheet that does not turn has
BAND = 0.15  # share of the heights' range that makes one of the paper's two sets


@dataclass(frozen=True)
class LaserCalibration:
    """A laser, how it was found, and what is not known about it.

    hold_out_px, hold_out   rms of stripes that the fit had not used: columns, and m off the sheet
    rms                     m off the sheet, of those that it used
    spreads                 1 sigma at each of the settings' ranges
    distances               (m,) m, of the stripe from the camera at each pose of the target
    """

    scanner: Scanner
    adjusted: Adjusted
    views: list[View]
    stripes: StripePoints
    spreads: list[Spread]
    hold_out_px: float
    hold_out: float
    rms: float
    distances: Floats
    motor: bool

    @property
    def laser(self) -> Laser:
        """What was calibrated."""
        assert self.scanner.laser is not None
        return self.scanner.laser


def calibrate_laser(
    camera: Camera,
    views: Sequence[View],
    stripes: StripePoints,
    target: AnyTarget,
    settings: CalibrateSettings,
    nominal: Laser | None = None,
    motor: bool = True,
    free: Sequence[str] = (),
    prior: Prior | None = None,
) -> LaserCalibration:
    """The laser of a calibrated camera, from poses of the target (one view each) and the stripe on it.

    nominal   what is known beforehand: joint, heights; needed where the laser has a window, with its nominal values
    motor     False: one sheet, whose alpha is the stripes' own and becomes the fixed angle
    free      further names to solve for (laser.window.distance, camera.port.distance, ...)
    prior     covariance of the camera's parameters: they move within it, and it is part of the result

    Raises GarbiError where the stripes do not determine the laser.
    """
    views = list(views)
    if not motor and len(np.unique(stripes.view)) < 2:
        raise GarbiError(
            "one view of the stripe does not determine a sheet that does not turn: show the target at a second distance"
        )
    poses = poses_by(camera, views, target)
    stripes = thinned(stripes, settings.most_stripe_points)
    points = stripe_in_rig(Scanner(camera), poses, stripes)
    start = first_laser(points, stripes, settings, nominal, motor)
    scanner = Scanner(camera, start)
    if settings.method == "refined":
        names = free_names(stripes, motor, free, prior)
    elif start.window is not None:
        raise GarbiError(f"method {settings.method}: linear methods know no laser window; use refined")
    else:
        names = ()
    unknown = [name for name in names if name not in scanner.values()]
    if unknown:
        raise GarbiError(f"{unknown[0]}: no such parameter here; there are {', '.join(scanner.values())}")
    height = nominal.z if nominal is not None else camera.position[2]
    known = {f"laser.{name}": (0.0, settings.prior_tilt) for name in ("beta", "theta", "gamma")}
    known |= {"laser.z": (height, settings.prior_height), LATENCY: (0.0, settings.prior_latency)}
    priors = [diagonal_prior(known)] if motor else []
    if prior is not None:
        priors.append(prior)
    bundle = Bundle(scanner, poses, names, corners_of(views, target), stripes, priors)
    adjusted = bundle.fit()
    _refuse_bad_fit(adjusted, settings)
    found = adjusted.scanner
    far = np.linalg.norm(points, axis=1)
    distances = np.array([np.median(far[stripes.view == i]) for i in np.unique(stripes.view)])
    spreads = [spread_at(found, names, adjusted.covariance, depth, not motor) for depth in settings.ranges]
    if settings.method == "refined":
        _refuse_undetermined(spreads, distances, settings)
    held = _hold_out(bundle, adjusted)
    good = adjusted.stripe_good
    inside = off_plane(found, adjusted.poses, stripes)[good]
    return LaserCalibration(
        found, adjusted, views, stripes, spreads, *held, float(np.sqrt((inside**2).mean())), distances, motor
    )


def free_names(stripes: StripePoints, motor: bool, free: Sequence[str], prior: Prior | None) -> tuple[str, ...]:
    """What is solved for: the sheet, the latency where the laser is seen to turn both ways, and what was asked for."""
    names = list(LASER_NAMES if motor else ONE_PLANE)
    if motor and latency_observable(stripes):
        names.append(LATENCY)
    allowed = (*WINDOW_NAMES, *LENS_NAMES, *PORT_NAMES, *LASER_NAMES, LATENCY)
    names += [name for name in free if name not in names or name not in allowed]
    if prior is not None:
        names += [name for name in prior.names if name not in names]
    return tuple(names)


def latency_observable(stripes: StripePoints) -> bool:
    """Turning one way only, latency is the same as delta."""
    fast = np.abs(stripes.rate) > 0.2 * max(float(np.abs(stripes.rate).max()), 1e-6)
    forward = (stripes.rate[fast] > 0).mean() if fast.any() else 0.0
    return bool(0.1 < forward < 0.9) and float(np.abs(stripes.rate).max()) > 1e-3


def thinned(stripes: StripePoints, most: int) -> StripePoints:
    """At most so many points, spread evenly."""
    count = len(stripes.view)
    return stripes if count <= most else stripes.part(np.linspace(0, count - 1, most).astype(int))


def first_laser(
    points: Floats, stripes: StripePoints, settings: CalibrateSettings, nominal: Laser | None, motor: bool
) -> Laser:
    """A laser to begin with, from points (n, 3) of the stripe, rig frame."""
    good = np.isfinite(points).all(axis=1)
    if good.sum() < 3 * settings.least_stripe:
        raise GarbiError(
            f"the stripe was found on the target in {int(good.sum())} rows only: nothing follows from them"
        )
    if nominal is not None and nominal.window is not None:
        return _turned_to(points[good], stripes.alpha[good], nominal) if motor else nominal
    if not motor:
        return _one_plane(points[good], nominal, float(stripes.alpha[0]))
    if settings.method == "paper":
        return _by_paper(points[good], stripes.alpha[good], nominal)
    for _ in range(4):
        found = solve_laser(points[good], stripes.alpha[good])
        off = np.abs(found.off_sheet(points, stripes.alpha))
        good &= off < 4.0 * 1.4826 * max(float(np.median(off[good])), 1e-9)
    if settings.method == "refined" and abs(found.z) > 2.0 * settings.prior_height:
        found = replace(found, z=0.0 if nominal is None else nominal.z)  # beta is near zero: the solve cannot know
    return found if nominal is None else replace(found, joint=nominal.joint)


def _turned_to(points: Floats, alpha: Floats, nominal: Laser) -> Laser:
    """The nominal laser with the delta that explains the points best."""
    tried = [replace(nominal, delta=nominal.delta + turn) for turn in np.linspace(-np.pi, np.pi, 721)]
    off = [np.nan_to_num(np.abs(laser.off_sheet(points, alpha)), nan=2.0) for laser in tried]
    ahead = [np.median(np.cos(alpha + laser.delta)) for laser in tried]
    score = [float(np.median(value)) + (1.0 if front < 0 else 0.0) for value, front in zip(off, ahead, strict=True)]
    return tried[int(np.argmin(score))]


def _one_plane(points: Floats, nominal: Laser | None, angle: float) -> Laser:
    base = nominal or Laser(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    centre = np.median(points, axis=0)
    good = np.ones(len(points), bool)
    for _ in range(4):
        centre = points[good].mean(axis=0)
        normal = np.linalg.svd(points[good] - centre, full_matrices=False)[2][2]
        off = np.abs((points - centre) @ normal)
        good = off <= 4.0 * 1.4826 * max(float(np.median(off)), 1e-9)
    own = base.axis.T @ (normal if normal[1] > 0 else -normal)
    if abs(own[1]) < 0.2:
        raise GarbiError("the sheet lies across the view's up direction: turn the camera, so that rows cross the sheet")
    beta, delta = -np.arcsin(own[2]), np.arctan2(-own[0], own[1]) - angle
    normal = base.axis @ own
    x, z = base.x, base.z
    y = float((normal @ centre - normal[0] * x - normal[2] * z) / normal[1])
    return replace(base, y=y, delta=float(delta), beta=float(beta), fixed_angle=angle)


def _by_paper(points: Floats, alpha: Floats, nominal: Laser | None) -> Laser:
    low, high = np.percentile(points[:, 2], [2, 98])
    width = BAND * (high - low)
    sets = []
    for part in (points[:, 2] < low + width, points[:, 2] > high - width):
        if part.sum() < 8:
            raise GarbiError("method paper: the stripe is not seen at two heights of the target")
        sets.append((points[part], alpha[part]))
    found = solve_laser_paper(sets[0], sets[1])
    return found if nominal is None else replace(found, joint=nominal.joint)


def off_plane(scanner: Scanner, poses: Poses, stripes: StripePoints) -> Floats:
    """How far (n,) m the stripe on the target lies from the sheet."""
    laser = scanner.laser
    assert laser is not None
    points = stripe_in_rig(scanner, poses, stripes)
    return laser.distance(points, stripes.alpha + scanner.latency * stripes.rate)


def _hold_out(bundle: Bundle, adjusted: Adjusted) -> tuple[float, float]:
    """Rms px and m of every second image's stripes, fitted without them."""
    assert bundle.stripes is not None
    if len(adjusted.free) == 0:
        return float("nan"), float("nan")
    columns, metres = [], []
    side = _half(bundle.stripes)
    for half in (0, 1):
        learn = bundle.stripes.part(side == half)
        kept = bundle.stripes.part((side != half) & adjusted.stripe_good)
        again = Bundle(
            adjusted.scanner, adjusted.poses, bundle.free, bundle.corners, learn, bundle.priors, list(bundle.sigma)
        ).fit()
        judge = Bundle(again.scanner, again.poses, (), bundle.corners, kept)
        columns.append(judge.residuals(again.scanner, again.poses)[1])
        metres.append(off_plane(again.scanner, again.poses, kept))
    px, m = np.concatenate(columns), np.concatenate(metres)
    return float(np.sqrt((px**2).mean())), float(np.sqrt((m**2).mean()))


def _half(stripes: StripePoints) -> NDArray[np.int64]:
    """0 or 1 (n,): images in turn, or rows in turn where there is one image only."""
    images = np.unique(stripes.image, return_inverse=True)[1].astype(np.int64)
    return images % 2 if images.max() > 0 else np.arange(len(images)) % 2


def _refuse_bad_fit(adjusted: Adjusted, settings: CalibrateSettings) -> None:
    good = adjusted.stripe_good
    bad = 1.0 - float(good.mean())
    rms = float(np.sqrt((adjusted.stripe[good] ** 2).mean())) if good.any() else np.inf
    if bad > settings.max_outliers or (rms > settings.max_stripe_noise and settings.method == "refined"):
        raise GarbiError(
            f"the stripe does not lie on one sheet through the target ({rms:.1f} px rms, {100 * bad:.0f} % left out): "
            "is it on the target's plane, the target still, and are the encoder's angles those of this laser?"
        )


def _refuse_undetermined(spreads: list[Spread], distances: Floats, settings: CalibrateSettings) -> None:
    worst = max(spread.rms if np.isfinite(spread.rms) else np.inf for spread in spreads)
    alike = np.ptp(distances) < 0.15 * np.median(distances)
    if worst > settings.max_error:
        hint = "show the target at a second distance" if alike else "show more of the stripe, at more angles"
        raise GarbiError(
            f"the stripes do not determine the laser: {1e3 * worst:.1f} mm, 1 sigma, at {max(settings.ranges):g} m; "
            f"{hint}"
        )
