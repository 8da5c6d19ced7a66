"""Dead reckoning as it is possible live: attitude, rates and specific force, velocity over ground, pressure; forward only.

The accelerometer carries the velocity between pings; each ping corrects it, and slowly the accelerometer's bias with it.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.types import Pose
from garbi_map.log.records import Floats, Mount

GRAVITY, DENSITY = 9.80665, 1025.0
DOWNWARD = np.array([0.0, 0.0, GRAVITY])
KEPT = 1024  # samples that are remembered: ten seconds at 100 Hz
PING, PING_BIAS, DEPTH, DEPTH_SPEED = 0.35, 0.08, 0.25, 0.15  # gains per reading
SETTLE = 0.06  # s, over which the acceleration is averaged
FORGET = 3.0  # s, in which a velocity that nothing confirms fades
JUMP = 0.5  # m/s: a ping farther off is a glitch, unless three in a row say so


class LiveNavigation:
    """Readings in, poses out. `last_ns`: newest stamp of attitude or odometry."""

    def __init__(self, mounts: dict[str, Mount]) -> None:
        self._imu = mounts.get("imu_link", Mount())
        self._dvl = mounts.get("dvl_link", Mount())
        self._press = mounts.get("pressure_link", Mount())
        self._imu_turn = Rotation.from_quat(self._imu.quaternion).as_matrix()
        self._dvl_turn = Rotation.from_quat(self._dvl.quaternion).as_matrix()
        self.position, self.velocity = np.zeros(3), np.zeros(3)  # odom
        self.rotation, self.rate = np.eye(3), np.zeros(3)
        self._bias = np.zeros(3)
        self._pull = np.zeros(3)  # m/s^2, odom, smoothed
        self._depth0: float | None = None
        self._stamps = np.zeros(KEPT, np.int64)
        self._rows = np.zeros((KEPT, 15))
        self._count = 0
        self.last_ns = self._ping_ns = 0
        self.confirmed_ns = 0
        self._odd = 0
        self.refused = 0

    def imu(self, stamp_ns: int, rate: Floats, force: Floats, attitude: Floats) -> None:
        """rate (3,), force (3,) in imu_link; attitude (4,) xyzw, NaN where there is none."""
        if self.last_ns and not stamp_ns - self.last_ns > 0:
            self.refused += 1
            if self.last_ns - stamp_ns < 1_000_000_000:
                return
            self.last_ns = self._ping_ns = self.confirmed_ns = 0  # the clock was set back: begin anew from here
            self._count = 0
        dt = min((stamp_ns - self.last_ns) * 1e-9, 0.5) if self.last_ns else 0.0
        self.last_ns = stamp_ns
        if isfinite(rate @ rate):
            self.rate = self._imu_turn @ rate
        if attitude @ attitude > 0.25:  # NaN is not
            self.rotation = _turned(attitude) @ self._imu_turn.T
        else:
            self.rotation = self.rotation @ _small_turn(self.rate * dt)
        self._ping_ns = self._ping_ns or stamp_ns
        if stamp_ns - self._ping_ns > 500_000_000:  # without pings the velocity is a guess that fades
            self.velocity = self.velocity * np.exp(-dt / FORGET)
        if isfinite(force @ force) and dt <= 0.1:
            felt = self.rotation @ (self._imu_turn @ force)
            pull = np.minimum(np.maximum(felt - DOWNWARD - self._bias, -2.0), 2.0)
            self.velocity = self.velocity + pull * dt
            self._pull = self._pull + min(dt / SETTLE, 1.0) * (pull - self._pull)
        else:
            self._pull = np.zeros(3)
        self.position = self.position + self.velocity * dt
        self._remember(stamp_ns)

    def dvl(self, stamp_ns: int, velocity: Floats) -> None:
        """velocity (3,) of and in dvl_link; NaN where the instrument says invalid."""
        if not np.isfinite(velocity).all():
            return
        then = self.at(stamp_ns)
        body = self._dvl_turn @ velocity - np.cross(then.rate, self._dvl.translation)
        off = then.rotation @ (body - then.velocity)
        if np.linalg.norm(off) > JUMP and self.confirmed_ns:
            self._odd += 1
            if self._odd < 3:
                return
        first = not self.confirmed_ns or self._odd >= 3
        self._odd = 0
        self.velocity = self.velocity + off * (1.0 if first else PING)
        if not first:
            gap = min(max((stamp_ns - self._ping_ns) * 1e-9, 0.05), 1.0)
            self._bias = np.clip(self._bias - PING_BIAS * off / (gap * 8), -0.3, 0.3)
        self._ping_ns = self.confirmed_ns = stamp_ns
        if not self.last_ns or stamp_ns - self.last_ns > 500_000_000:  # no IMU: pings are the clock
            self.position = self.position + self.velocity * min((stamp_ns - (self.last_ns or stamp_ns)) * 1e-9, 0.5)
            self.last_ns = stamp_ns
            self._remember(stamp_ns)

    def pressure(self, stamp_ns: int, pressure: float) -> None:
        """Absolute pressure, Pa, at pressure_link."""
        if not np.isfinite(pressure):
            return
        then = self.at(stamp_ns)
        height = -pressure / (DENSITY * GRAVITY) - float((then.rotation @ self._press.translation)[2])
        if self._depth0 is None:
            self._depth0 = height - then.position[2]
        off = height - self._depth0 - then.position[2]
        if abs(off) > 0.5:  # a glitch, or the sensor came back after a long silence: creep towards it
            off = 0.02 * np.sign(off)
        self.position = self.position + np.array([0.0, 0.0, DEPTH * off])
        if self.confirmed_ns == 0 or stamp_ns - self.confirmed_ns > 1_000_000_000:
            self.velocity = self.velocity + np.array([0.0, 0.0, DEPTH_SPEED * off])

    def odometry(self, stamp_ns: int, position: Floats, quaternion: Floats) -> None:
        """Somebody else's pose: position (3,), quaternion (4,) xyzw. Taken as it is."""
        if not np.isfinite(position).all() or stamp_ns <= self.last_ns:
            return
        turned = Rotation.from_quat(quaternion).as_matrix()
        if self.last_ns:
            dt = (stamp_ns - self.last_ns) * 1e-9
            self.velocity = (position - self.position) / dt
            self.rate = Rotation.from_matrix(self.rotation.T @ turned).as_rotvec() / dt
        self.position, self.rotation = np.array(position), turned
        self.last_ns = self.confirmed_ns = stamp_ns
        self._remember(stamp_ns)

    def _remember(self, stamp_ns: int) -> None:
        slot = self._count % KEPT
        self._stamps[slot] = stamp_ns
        self._rows[slot, :3] = self.position
        self._rows[slot, 3:12] = self.rotation.ravel()
        self._rows[slot, 12:] = self.velocity
        self._count += 1

    @property
    def known(self) -> bool:
        """Whether there has been anything yet."""
        return self._count > 0

    def now(self, stamp_ns: int) -> Pose:
        """The pose at a moment after the newest reading, carried on for half a second at most."""
        ahead = min(max((stamp_ns - self.last_ns) * 1e-9, 0.0), 0.5)
        turned = self.rotation @ _small_turn(self.rate * ahead)
        return Pose(
            stamp_ns,
            self.position + self.velocity * ahead,
            turned,
            self.rotation.T @ self.velocity,
            self.rate.copy(),
            self.rotation.T @ self._pull,
        )

    def at(self, stamp_ns: int) -> Pose:
        """The pose at a moment that the remembered samples span, held at the old end, carried on at the new."""
        if self._count == 0 or stamp_ns >= self.last_ns:
            return self.now(stamp_ns)
        slot = (self._count - 1) % KEPT
        oldest = max(self._count - KEPT, 0)
        back = self._count - 1
        while back > oldest and self._stamps[slot] > stamp_ns:
            back -= 1
            slot = back % KEPT
        row, after = self._rows[slot], self._rows[(back + 1) % KEPT]
        t0, t1 = int(self._stamps[slot]), int(self._stamps[(back + 1) % KEPT])
        w = min(max((stamp_ns - t0) / max(t1 - t0, 1), 0.0), 1.0)
        mixed = row * (1 - w) + after * w
        rotation = mixed[3:12].reshape(3, 3)
        rotation = rotation * (1.5 - 0.5 * (rotation * rotation).sum(0))  # neighbours: one Newton step is enough
        return Pose(stamp_ns, mixed[:3], rotation, rotation.T @ mixed[12:], self.rate.copy())


def _small_turn(vector: Floats) -> Floats:
    angle = float(np.sqrt(vector @ vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-12:
        return np.eye(3) + cross
    return np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / angle**2 * (cross @ cross)


def _turned(quaternion: Floats) -> Floats:
    """The matrix (3, 3) of a quaternion (4,) xyzw of any length; scipy's is ten times slower for a single one."""
    x, y, z, w = (quaternion / np.sqrt(quaternion @ quaternion)).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
