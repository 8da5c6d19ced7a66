"""The object that is held to: chosen, fitted once, then followed from profile to profile by registration."""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.fit import Cylinder, Plane, fit_cylinder, fit_plane
from behaviours.patch import Patch
from behaviours.registration import Placed, Registration
from behaviours.settings import HoldSettings
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats

PER_PROFILE = 40
GATE = (0.8, 0.6)  # m aside and up or down from where the object is looked for
THICK = {
    "plane": (0.25, 0.6),
    "cylinder": (0.6,),
    "patch": (0.6,),
}  # m behind the nearest that may belong to the object
NEAREST = 5  # percentile of the ranges: below it is snow
PASS = {"plane": 1.5, "cylinder": 1.5, "patch": 3.0}  # s of profiles that show enough of it
REFINE_NS = 9_000_000_000
SHOWS = 0.3  # share of a profile's points on the object that show it
STEP = 0.03  # m or rad, over which the range's change is taken
AXES = np.eye(3)
RETRY_NS = 500_000_000


@dataclass(frozen=True)
class Relative:
    """How the object lies, from the vehicle.

    range     m from the rig along the view; slope (3,) and swing (3,) m/rad: by which it changes as the
              vehicle moves and turns, axes of base_link
    yaw, pitch  rad by which the bow has to turn to face the object; axes: those that the object fixes
    moved     (3,) m by which the vehicle has moved since the object was taken, ahead, to port and up; told (3,) where the
              object tells
    velocity  (3,) m/s relative to it, axes of base_link
    age       s of the newest profile that shows it
    """

    range: float
    slope: Floats
    swing: Floats
    yaw: float
    pitch: float
    axes: tuple[str, ...]
    moved: Floats
    told: tuple[bool, ...]
    velocity: Floats
    age: float


class Target:
    """Profiles in; `now` puts the object relative to the present pose. `jump`: m by which what is seen now is nearer than
    the object, None: it is not; `since_ns`: when that began. `takes`: how often an object was taken; `place` (3,) m, odom:
    where it was seen last."""

    def __init__(self, settings: HoldSettings, eye: Floats) -> None:
        self.settings, self.eye = settings, eye
        self._seen: deque[tuple[int, Floats]] = deque()  # points in odom
        self.takes = 0
        self.place: Floats | None = None
        self.forget()

    def forget(self) -> None:
        """What was seen does not count any more."""
        self._seen.clear()
        self.place = None
        self.drop()

    def drop(self) -> None:
        """The object is none any more: take another one from what is seen."""
        self._surface: Plane | Cylinder | Patch | None = None
        self._registration: Registration | None = None
        self._tried_ns = self._followed_ns = 0
        self._first = np.zeros(3)
        self._gathered: list[Floats] = []
        self._taken_ns, self._refined = 0, False
        self.jump: float | None = None
        self.since_ns = 0

    def see(self, profile: Profile) -> None:
        """Take in a profile, thinned."""
        points = profile.points[np.isfinite(profile.points).all(1)]
        points = points[:: max(len(points) // PER_PROFILE, 1)]
        if len(points):
            self._seen.append((profile.stamp_ns, points))
            self._follow(profile.pose, points)
        while self._seen and not 0 <= profile.stamp_ns - self._seen[0][0] <= self.settings.window * 1e9:
            self._seen.popleft()

    def _follow(self, pose: Pose, points: Floats) -> None:
        if self._registration is None or self._surface is None:
            return
        self._registration.carry(pose)
        points = pose.to_base(points)
        points = points[self._about(points - self.eye)]
        if len(points) < 5:
            return
        placed = self._registration.at(pose)
        eye = placed.position + placed.rotation @ self.eye
        expected = self._surface.from_here(eye, placed.rotation)[0]
        off, _ = self._surface.off(np.vstack([eye, points @ placed.rotation.T + placed.position]))
        reach = points[:, 0] - self.eye[0]
        nearer = (off[1:] * np.sign(off[0]) > self.settings.jump) & (reach < expected)
        if nearer.mean() > 0.5:
            self.since_ns = self.since_ns if self.jump is not None else pose.stamp_ns
            self.jump = expected - float(np.median(reach[nearer]))
        elif self._registration.see(points, self._surface, 4.0 * self.settings.tolerance) > SHOWS:
            self._followed_ns, self.jump = pose.stamp_ns, None
            self.place = np.median(pose.position + points @ pose.rotation.T, axis=0)
            self._refine(pose, points)

    def _refine(self, pose: Pose, points: Floats) -> None:
        """A patch is made again, once, from the passes that were registered to its first view."""
        if not isinstance(self._surface, Patch) or self._registration is None or self._refined:
            return
        placed = self._registration.at(pose)
        self._gathered.append(points @ placed.rotation.T + placed.position)
        if pose.stamp_ns - self._taken_ns > REFINE_NS:
            with contextlib.suppress(ValueError):
                self._surface = Patch(np.concatenate(self._gathered), placed.position + placed.rotation @ self.eye)
            self._refined, self._gathered = True, []

    def _about(self, points: Floats) -> np.ndarray:
        return (points[:, 0] > 0.2) & (np.abs(points[:, 1]) < GATE[0]) & (np.abs(points[:, 2]) < GATE[1])

    def now(self, pose: Pose) -> Relative | None:
        """None: there is no object, or nothing has shown it for longer than `lost`."""
        if self._surface is None and abs(pose.stamp_ns - self._tried_ns) >= RETRY_NS:
            self._tried_ns = pose.stamp_ns
            self._take(pose)
        if self._registration is None:
            return None
        found = self._now(pose)
        return found if np.isfinite(found.range) else None

    def _now(self, pose: Pose) -> Relative:
        assert self._registration is not None and self._surface is not None
        placed = self._registration.at(pose)
        eye = placed.position + placed.rotation @ self.eye
        reach, yaw, pitch = self._surface.from_here(eye, placed.rotation)
        fixes = ["yaw"]  # a pipe fixes no pitch about itself; turning to a patch's middle keeps it in view
        if isinstance(self._surface, Plane):
            fixes = [name for name, told in (("yaw", placed.told[5]), ("pitch", placed.told[4])) if told]
        slope = [-1.0, *(self._change(placed, shift, np.zeros(3)) for shift in STEP * AXES[1:])]
        swing = [self._change(placed, np.zeros(3), turn) for turn in STEP * AXES[1:]]
        return Relative(
            reach,
            np.array(slope),
            np.array([0.0, *swing]),
            yaw,
            pitch,
            tuple(fixes),
            (placed.position - self._first) @ placed.rotation,
            tuple(bool(one) for one in placed.told[:3]),
            placed.velocity,
            (pose.stamp_ns - self._followed_ns) * 1e-9,
        )

    def _change(self, placed: Placed, shift: Floats, turn: Floats) -> float:
        """Of the range with a shift (3,) m or a turn (3,) rad, axes of base_link; never more than the step itself."""
        assert self._surface is not None
        ranges = []
        for way in (-1.0, 1.0):
            rotation = placed.rotation @ Rotation.from_rotvec(way * turn).as_matrix()
            eye = placed.position + placed.rotation @ (way * shift) + rotation @ self.eye
            ranges.append(self._surface.from_here(eye, rotation)[0])
        change = (ranges[1] - ranges[0]) / (2 * STEP)
        return float(np.clip(change, -1.5, 1.5)) if np.isfinite(change) else 0.0

    def _take(self, pose: Pose) -> None:
        """The object among the points of the window: the one that was chosen, or the nearest."""
        settings = self.settings
        if not self._seen or self._seen[-1][0] - self._seen[0][0] < PASS[settings.target] * 1e9:
            return
        odom = np.concatenate([one for _, one in self._seen])
        surface = None
        for points in self._choices(odom, pose):
            if surface is None and len(points) >= settings.least_points:
                surface = self._fit(points, pose.position + pose.rotation @ self.eye)
        if surface is None:
            return
        if isinstance(surface, Plane) and abs(float(surface.normal @ pose.rotation[:, 0])) < 0.3:
            return  # seen so much aslant that it is no wall ahead but ground or a side
        self._surface, self._registration = surface, Registration(pose)
        self._first, self._followed_ns = pose.position.copy(), self._seen[-1][0]
        self._taken_ns = pose.stamp_ns
        self.takes += 1

    def _choices(self, odom: Floats, pose: Pose) -> list[Floats]:
        """Of points (n, 3), odom, those that may be the object: about the place that was chosen, or the nearest ahead."""
        if self.settings.at is not None:
            return [odom[np.linalg.norm(odom - np.array(self.settings.at), axis=1) < GATE[0]]]
        points = pose.to_base(odom) - self.eye
        about = self._about(points)
        if not about.any():
            return []
        nearest = np.percentile(points[about, 0], NEAREST)
        return [odom[about & (points[:, 0] < nearest + thick)] for thick in THICK[self.settings.target]]

    def _fit(self, points: Floats, eye: Floats) -> Plane | Cylinder | Patch | None:
        settings = self.settings
        if settings.target == "patch":
            try:
                return Patch(points, eye)
            except ValueError:
                return None
        fit = fit_plane(points, settings.tolerance)
        if settings.target == "cylinder":
            return (
                cylinder
                if (cylinder := fit_cylinder(points, eye, settings.tolerance)) and cylinder.share > 0.5
                else None
            )
        if fit is None or fit.share < 0.5 or fit.spread[0] < settings.least_spread:
            return None
        return fit
