"""The camera: from views of a target to intrinsics, distortion and port, with what is not known about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from garbi_map.calibrate.bundle import Adjusted, Bundle, Poses, Prior
from garbi_map.calibrate.linear import solve_camera
from garbi_map.calibrate.scanner import LENS_NAMES, PORT_NAMES, Scanner
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.targets import AnyTarget
from garbi_map.calibrate.views import View, corners_of, poses_by
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.rig import Camera

FORWARD = (-0.5, 0.5, -0.5, 0.5)  # rig <- a camera that looks along X
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class CameraCalibration:
    """A camera, how it was found, and hold_out (rms px per corner that no fit had used, pose excepted)."""

    camera: Camera
    adjusted: Adjusted
    views: list[View]
    hold_out: float

    @property
    def in_sample(self) -> float:
        """Rms of a corner, px: the length of its residual, outliers left out."""
        return rms_length(self.adjusted.corner[self.adjusted.corner_good])

    @property
    def distances(self) -> Floats:
        """(m,) from the camera to the target's origin, m."""
        return np.linalg.norm(self.adjusted.poses.translation, axis=1)


def rms_length(residual: Floats) -> float:
    """Root mean square length of residuals (n, 2)."""
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def calibrate_camera(
    views: Sequence[View],
    target: AnyTarget,
    size: tuple[int, int],
    settings: CalibrateSettings,
    start: Camera | None = None,
    free: Sequence[str] | None = None,
    priors: Sequence[Prior] = (),
) -> CameraCalibration:
    """The camera that the views show; size: width and height, px.

    start    a camera that is about right, with its port if it has one; None: found from the views, without a port
    free     names of what is solved for (camera.alpha_u, ..., camera.port.distance, ...); None: intrinsics and the
             distortion of the settings, the port held

    Raises GarbiError where the views do not determine it.
    """
    views = list(views)
    if len(views) > settings.most_views:
        views = [views[i] for i in np.linspace(0, len(views) - 1, settings.most_views).astype(int)]
    if not views:
        raise GarbiError("the target was found in no image")
    solved = tuple(free) if free is not None else (*LENS_NAMES[:4], *(f"camera.{term}" for term in settings.distortion))
    unknown = [name for name in solved if name not in LENS_NAMES + PORT_NAMES]
    if unknown:
        raise GarbiError(f"{unknown[0]}: no such parameter of a camera; {', '.join(LENS_NAMES + PORT_NAMES)}")
    if any(name in PORT_NAMES for name in solved) and (start is None or start.port is None):
        raise GarbiError("a port is to be solved for: give its nominal values in the rig file, camera.port")
    if target.planar and len(views) < 3 and any(name in LENS_NAMES for name in solved):
        raise GarbiError(
            f"{len(views)} view{'s' * (len(views) > 1)} of a flat target cannot determine a camera: "
            "show it in three or more, tilted and at several distances"
        )
    camera = start if start is not None else first_camera(views, target, size)
    poses = poses_by(camera, views, target)
    adjusted = Bundle(Scanner(camera), poses, solved, corners_of(views, target), priors=priors).fit()
    refuse_undetermined(adjusted, views, settings)
    return CameraCalibration(adjusted.scanner.camera, adjusted, views, hold_out(adjusted, views, target, priors))


def first_camera(views: Sequence[View], target: AnyTarget, size: tuple[int, int]) -> Camera:
    """A pinhole to begin with: the paper's linear solve, or Zhang's focal length for flat targets (PAMI 22, 2000)."""
    width, height = size
    if not target.planar:
        richest = max(views, key=lambda view: len(view.number))
        found = solve_camera(target.points[richest.number], richest.pixel)
        intrinsics = (found.alpha_u, found.alpha_v, found.u0, found.v0)
        if not (0 < found.u0 < width and 0 < found.v0 < height):
            intrinsics = (found.alpha_u, found.alpha_v, (width - 1) / 2, (height - 1) / 2)
    else:
        focal = _flat_focal(views, target, size)
        intrinsics = (focal, focal, (width - 1) / 2, (height - 1) / 2)
    return Camera("camera_optical_frame", width, height, *intrinsics, NO_DISTORTION, (0.0, 0.0, 0.0), FORWARD)


def _flat_focal(views: Sequence[View], target: AnyTarget, size: tuple[int, int]) -> float:
    import cv2

    centre = (np.array(size) - 1) / 2
    rows, right = [], []
    for view in views:
        homography, _ = cv2.findHomography(target.points[view.number, :2], view.pixel - centre)
        if homography is None:
            continue
        h = homography / np.linalg.norm(homography)
        a, b = h[:, 0], h[:, 1]
        # the images of two directions at right angles and of one length, through the image of the absolute conic
        rows += [a[0] * b[0] + a[1] * b[1], a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    x, y = np.array(rows), np.array(right)
    inverse = float(x @ y / (x @ x)) if len(rows) else 0.0
    focal = 1.0 / np.sqrt(inverse) if inverse > 0 else 0.0
    return float(focal) if 0.2 * size[0] < focal < 20 * size[0] else 1.2 * size[0]


def refuse_undetermined(adjusted: Adjusted, views: Sequence[View], settings: CalibrateSettings) -> None:
    """Raise GarbiError, in one line, where the views leave open what was to be found."""
    camera = adjusted.scanner.camera
    bad = 1.0 - adjusted.corner_good.mean()
    rms = rms_length(adjusted.corner[adjusted.corner_good]) if bad < 1 else np.inf
    if rms > settings.max_corner_noise or bad > 0.3:
        raise GarbiError(
            f"the camera does not explain the corners ({rms:.2f} px rms, {100 * bad:.0f} % left out): "
            "is target.yaml the target that was shown, flat and still?"
        )
    for name, value in (("alpha_u", camera.alpha_u), ("alpha_v", camera.alpha_v)):
        if f"camera.{name}" not in adjusted.free:
            continue
        sigma = adjusted.sigma(f"camera.{name}")
        if not sigma < settings.max_focal_sigma * value:
            far = np.linalg.norm(adjusted.poses.translation, axis=1)
            alike = ", all at one distance," if np.ptp(far) < 0.15 * np.median(far) else ""
            raise GarbiError(
                f"{len(views)} views{alike} do not determine the focal length ({name} {value:.0f} +- {sigma:.0f} px): "
                "tilt the target by 20 to 45 degrees both ways, and show it at several distances"
            )
    if camera.port is not None and not 0.0 < camera.port.distance < 1.0:
        raise GarbiError(f"the port's distance came out as {camera.port.distance:.3f} m: hold it at its measured value")


def hold_out(
    adjusted: Adjusted, views: Sequence[View], target: AnyTarget, priors: Sequence[Prior], least: int = 6
) -> float:
    """Rms px per corner that was not fitted: camera from the other half of the views, the pose from the other corners.

    With fewer than `least` views, the camera is from the other half of the corners of all of them.
    """
    found = []
    for half in (0, 1):
        if len(views) >= least:
            learn = [i for i in range(len(views)) if i % 2 == half]
            camera = _refit(adjusted, [views[i] for i in learn], learn, target, priors).scanner.camera
            test = [view for i, view in enumerate(views) if i % 2 != half]
        else:
            camera = adjusted.scanner.camera
            test = list(views)
        for part in (0, 1):
            shown = [view.part(np.arange(len(view.number)) % 2 == part) for view in test]
            kept = [view.part(np.arange(len(view.number)) % 2 != part) for view in test]
            if len(views) >= least:
                poses, judge = poses_by(camera, shown, target), Scanner(camera)
            else:
                learnt = _refit(adjusted, shown, list(range(len(views))), target, priors)
                poses, judge = learnt.poses, learnt.scanner
            corners = corners_of(kept, target)
            found.append(Bundle(judge, poses, (), corners).residuals(judge, poses)[0])
    residual = np.concatenate(found)
    length = np.linalg.norm(residual, axis=1)
    return rms_length(residual[length < 6 * max(float(np.median(length)), 1e-9)])


def _refit(
    adjusted: Adjusted, views: Sequence[View], which: list[int], target: AnyTarget, priors: Sequence[Prior]
) -> Adjusted:
    poses = Poses(adjusted.poses.rotation[which], adjusted.poses.translation[which])
    return Bundle(adjusted.scanner, poses, adjusted.free, corners_of(views, target), priors=priors).fit()
