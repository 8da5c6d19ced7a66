"""What was seen of the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.bundle import Bundle, Corners, Poses
from garbi_map.calibrate.scanner import Scanner
from garbi_map.calibrate.targets import AnyTarget
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.rig import Camera


@dataclass(frozen=True)
class View:
    """The target at one pose: numbers (k,) of its points, pixel (k, 2), blur (1 sigma of edges, px)."""

    name: str
    number: NDArray[np.int64]
    pixel: Floats
    blur: float = 1.0

    def part(self, which: NDArray) -> View:
        """Some of its points."""
        return replace(self, number=self.number[which], pixel=self.pixel[which])


def corners_of(views: Sequence[View], target: AnyTarget) -> Corners:
    """All corners of the views, in their order."""
    number = np.concatenate([view.number for view in views])
    which = np.repeat(np.arange(len(views)), [len(view.number) for view in views])
    return Corners(which, target.points[number], np.concatenate([view.pixel for view in views]))


def poses_by(camera: Camera, views: Sequence[View], target: AnyTarget) -> Poses:
    """Camera <- target for each view, from a camera that is about right. Raises GarbiError where a view has no pose."""
    import cv2

    rotation, translation = [], []
    for view in views:
        points = target.points[view.number]
        origin, direction = camera.rays(*view.pixel.T)
        good = np.isfinite(direction[:, 2])
        if good.sum() < 6:
            raise GarbiError(f"{view.name}: the target lies where the starting camera cannot see")
        flat = direction[good, :2] / direction[good, 2:]
        method = cv2.SOLVEPNP_IPPE if target.planar else cv2.SOLVEPNP_SQPNP
        world = points[good] - points[0]
        found, turn, shift = cv2.solvePnP(np.ascontiguousarray(world), flat, np.eye(3), None, flags=method)
        if not found or not np.isfinite(shift).all():
            raise GarbiError(f"{view.name}: no pose of the target explains what is seen")
        turned = Rotation.from_rotvec(turn.ravel())
        rotation.append(turned)
        translation.append(shift.ravel() + np.nanmean(origin, axis=0) - turned.apply(points[0]))
    start = Poses(Rotation.concatenate(rotation), np.array(translation))
    return Bundle(Scanner(camera), start, (), corners_of(views, target)).fit().poses
