"""What a behaviour may know, and when: profiles, passes and navigation as they become known, never the future.

`Feed` is the one interface; a log, a live recorder and the simulator are behind it alike. `Intake` is what they share: it
takes readings with their arrivals and gives out, up to a moment, what that moment can know.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.angle import LiveAngle
from behaviours.navigation import LiveNavigation
from behaviours.pieces import solid
from behaviours.settings import FeedSettings
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats, Mount, Navigation
from garbi_map.rig import Rig
from garbi_map.stripe import Stripe

BACK_NS = 1_000_000_000  # stamps that stay this far back are a clock that was set, not stragglers


@dataclass(frozen=True)
class Seen:
    """Everything that became known between two decisions.

    pose      of the vehicle now; None before the first reading of navigation
    profiles  in the order in which they became known
    troubles  what was wrong with the input, in words
    """

    now_ns: int
    pose: Pose | None
    profiles: list[Profile] = field(default_factory=list)
    troubles: list[str] = field(default_factory=list)


class Feed(Protocol):
    """Where a behaviour's knowledge comes from."""

    rig: Rig
    mount: Mount

    def until(self, now_ns: int) -> Seen:
        """What became known since the last call, up to now; moments ascend."""
        ...


@dataclass(frozen=True)
class Sighting:
    """A stripe, when it is known, and the laser's angle as it was known by then."""

    stripe: Stripe
    known_ns: int
    alpha: float
    sweep: int
    stuck: bool


class Intake:
    """Readings and stripes in, in any order of stamps; `until` gives out in the order of arrival."""

    def __init__(self, rig: Rig, mounts: dict[str, Mount], settings: FeedSettings) -> None:
        self.rig, self.settings = rig, settings
        self.mount = mounts.get("rig", Mount())
        self._turn = Rotation.from_quat(self.mount.quaternion).as_matrix()
        self.angle = LiveAngle(rig.laser.fixed_angle, settings.encoder_reach, settings.encoder_stuck)
        self.navigation = LiveNavigation(mounts)
        self._pending: list[tuple[int, int, str, tuple[Any, ...]]] = []
        self._number = 0
        self._last_ns = 0
        self._back_since: int | None = None
        self._before: Stripe | None = None
        self._frozen = 0
        self._arrived_ns = 0
        self._heard = False

    def read(self, readings: Navigation) -> None:
        """Readings of some stretch of time."""
        for kind in ("encoder", "imu", "pressure", "dvl", "odometry"):
            record = getattr(readings, kind)
            if record is None:
                continue
            columns = _COLUMNS[kind](record)
            for row, (stamp, arrival) in enumerate(zip(record.stamp_ns, record.arrival_ns, strict=True)):
                self._push(int(arrival), kind, (int(stamp), *(column[row] for column in columns)))

    def sight(self, sighting: Sighting) -> None:
        """A stripe that was found elsewhere, with the angle of its moment."""
        self._push(sighting.known_ns, "stripe", (sighting,))

    def _push(self, arrival: int, kind: str, values: tuple[Any, ...]) -> None:
        heapq.heappush(self._pending, (arrival, self._number, kind, values))
        self._number += 1

    def until(self, now_ns: int) -> Seen:
        """See `Feed`."""
        profiles: list[Profile] = []
        troubles: Counter[str] = Counter()
        while self._pending and self._pending[0][0] <= now_ns:
            arrival, _, kind, values = heapq.heappop(self._pending)
            if kind == "stripe":
                profile = self._profile(values[0], troubles)
                if profile is not None:
                    profiles.append(profile)
            elif kind == "encoder":
                self.angle.add(*values)
            else:
                self._arrived_ns, self._heard = arrival, True
                getattr(self.navigation, kind)(*values)
        if self._heard and now_ns - self._arrived_ns > self.settings.sensor_silent * 1e9:
            troubles["navigation is silent"] += 1
        pose = self.navigation.now(now_ns) if self.navigation.known else None
        return Seen(now_ns, pose, profiles, sorted(troubles))

    def _profile(self, sighting: Sighting, troubles: Counter[str]) -> Profile | None:
        stripe, alpha = sighting.stripe, sighting.alpha
        if self._goes_back(stripe.stamp_ns):
            troubles["image stamps go back"] += 1
            return None
        if self._is_frozen(stripe):
            troubles["the image is frozen"] += 1
            return None
        if sighting.stuck:
            troubles["the encoder is stuck"] += 1
            return None
        if not np.isfinite(alpha):
            troubles["the laser's angle is not known"] += 1
            return None
        if not self.navigation.known:
            self.navigation.imu(stripe.stamp_ns, np.zeros(3), np.full(3, np.nan), np.array([0.0, 0.0, 0.0, 1.0]))
            self._heard = False
        pose = self.navigation.at(stripe.stamp_ns)
        points, _, _ = self.rig.triangulate(stripe.u, stripe.row, alpha)
        depth = self.rig.depth(points)
        good = np.isfinite(points).all(1) & (depth > self.settings.min_range) & (depth < self.settings.max_range)
        if len(depth) and not good.any():
            troubles["no point of the profile is usable"] += 1
        points = self.to_base(points[good]) @ pose.rotation.T + pose.position
        return Profile(
            stripe.stamp_ns,
            sighting.known_ns,
            alpha,
            sighting.sweep,
            stripe.row[good],
            depth[good],
            points,
            stripe.intensity[good].astype(float),
            *solid(stripe.row[good], depth[good], 1.0 / self.rig.camera.alpha_v),
            pose,
        )

    def to_base(self, points: Floats) -> Floats:
        """Points (n, 3) in the rig frame, seen from base_link."""
        return points @ self._turn.T + self.mount.translation

    def _goes_back(self, stamp_ns: int) -> bool:
        if stamp_ns > self._last_ns:
            self._last_ns, self._back_since = stamp_ns, None
            return False
        if self._back_since is None:
            self._back_since = stamp_ns
        if stamp_ns - self._back_since < BACK_NS:
            return True
        self._last_ns, self._back_since = stamp_ns, None
        return False

    def _is_frozen(self, stripe: Stripe) -> bool:
        """The same frame again: noise makes two stripes differ, a driver that hangs repeats them."""
        before, self._before = self._before, stripe
        return (
            before is not None
            and len(stripe.u) > 0
            and np.array_equal(stripe.row, before.row)
            and np.array_equal(stripe.u, before.u)
        )


_COLUMNS: dict[str, Any] = {
    "encoder": lambda record: (record.angle.tolist(),),
    "imu": lambda record: (record.rate, record.specific_force, record.attitude),
    "pressure": lambda record: (record.pressure.tolist(),),
    "dvl": lambda record: (record.velocity,),
    "odometry": lambda record: (record.position, record.quaternion),
}


def shown(profiles: Iterable[Profile]) -> Floats:
    """All points (n, 3) of some profiles, odom."""
    points = [profile.points for profile in profiles]
    return np.concatenate(points) if points else np.empty((0, 3))
