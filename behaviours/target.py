"""The object that is held to: from the points of the last sweep to range, yaw and pitch, relative to the vehicle now."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from behaviours.fit import fit_cylinder, fit_plane
from behaviours.settings import HoldSettings
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats

PER_PROFILE = 40
GATE = (0.8, 0.6)  # m aside and up or down from the view's axis


@dataclass(frozen=True)
class Relative:
    """range m from the rig along the view; yaw, pitch rad by which the bow has to turn to face the object; axes that the
    object fixes besides surge."""

    range: float
    yaw: float
    pitch: float
    axes: tuple[str, ...]


class TargetFit:
    """Profiles in; `now` fits what they showed within the window and puts it relative to the present pose."""

    def __init__(self, settings: HoldSettings, eye: Floats) -> None:
        self.settings, self.eye = settings, eye
        self._seen: deque[tuple[int, Floats]] = deque()

    def forget(self) -> None:
        """What was seen does not count any more."""
        self._seen.clear()

    def see(self, profile: Profile) -> None:
        """Take in a profile, thinned."""
        points = profile.points[np.isfinite(profile.points).all(1)]
        step = max(len(points) // PER_PROFILE, 1)
        if len(points):
            self._seen.append((profile.stamp_ns, points[::step]))

    def now(self, pose: Pose) -> Relative | None:
        """None: there is nothing that the shape fits."""
        settings = self.settings
        while self._seen and pose.stamp_ns - self._seen[0][0] > settings.window * 1e9:
            self._seen.popleft()
        if not self._seen:
            return None
        points = pose.to_base(np.concatenate([one for _, one in self._seen])) - self.eye
        ahead = (points[:, 0] > 0.2) & (np.abs(points[:, 1]) < GATE[0]) & (np.abs(points[:, 2]) < GATE[1])
        points = points[ahead]
        if len(points) < settings.least_points:
            return None
        if settings.target == "cylinder":
            return self._to_cylinder(points)
        return self._to_plane(points)

    def _to_plane(self, points: Floats) -> Relative | None:
        settings = self.settings
        if settings.target == "patch":
            near = np.hypot(points[:, 1], points[:, 2]) < 0.35
            points = points[near]
        tolerance = settings.tolerance * (2.0 if settings.target == "patch" else 1.0)
        plane = fit_plane(points, tolerance)
        if plane is None or plane.share < 0.5:
            return None
        facing = plane.normal if plane.normal[0] > 0 else -plane.normal
        if facing[0] < 0.3:  # seen so much aslant that it is no wall ahead but ground or a side
            return None
        fixes = plane.spread[0] > settings.least_spread and settings.target == "plane"
        return Relative(
            float(facing @ plane.point / facing[0]),
            float(np.arctan2(facing[1], facing[0])) if fixes else 0.0,
            float(-np.arctan2(facing[2], np.hypot(facing[0], facing[1]))) if fixes else 0.0,
            ("yaw", "pitch") if fixes else (),
        )

    def _to_cylinder(self, points: Floats) -> Relative | None:
        cylinder = fit_cylinder(points, np.zeros(3), self.settings.tolerance)
        if cylinder is None or cylinder.share < 0.5:
            return None
        nearest = cylinder.point - (cylinder.point @ cylinder.axis) * cylinder.axis
        distance = float(np.linalg.norm(nearest))
        yaw = float(np.arctan2(nearest[1], nearest[0]))
        return Relative(distance - cylinder.radius, yaw, 0.0, ("yaw",))
