"""How the vehicle truly moved, at any moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats


@dataclass(frozen=True)
class Kinematics:
    """base_link at n moments: position (n, 3) m, rotation map <- base_link, velocity (n, 3) m/s map, rate (n, 3) rad/s
    body, acceleration (n, 3) m/s^2 map, angular_acceleration (n, 3) rad/s^2 body."""

    position: Floats
    rotation: Rotation
    velocity: Floats
    rate: Floats
    acceleration: Floats
    angular_acceleration: Floats

    def velocity_at(self, arm: Floats) -> Floats:
        """Velocity (n, 3) m/s, map, of a point at arm (3,) m in base_link."""
        return self.velocity + self.rotation.apply(np.cross(self.rate, arm))

    def acceleration_at(self, arm: Floats) -> Floats:
        """Acceleration (n, 3) m/s^2, map, of a point at arm (3,) m in base_link."""
        turning = np.cross(self.angular_acceleration, arm) + np.cross(self.rate, np.cross(self.rate, arm))
        return self.acceleration + self.rotation.apply(turning)


@dataclass(frozen=True)
class Motion:
    """Rows of the integration's history (see hydrodynamics.HISTORY), at equal steps."""

    rows: Floats

    @property
    def end(self) -> float:
        """s since the start, of the last row."""
        return float(self.rows[-1, 0])

    def at(self, time: ArrayLike) -> Kinematics:
        """The motion at times (n,) s: cubic in position, linear in the quaternion.

        Raises ValueError for a moment that has not come yet."""
        rows = self.rows
        own = rows[:, 0]
        t = np.atleast_1d(np.asarray(time, float))
        if len(t) and (t.min() < 0 or t.max() > own[-1] + 1e-9):
            raise ValueError(f"the vehicle has moved for {own[-1]:.3f} s; asked for {t.min():.3f} to {t.max():.3f} s")
        after = np.clip(np.searchsorted(own, t, side="right"), 1, len(own) - 1)
        a, b = rows[after - 1], rows[after]
        h = (b[:, 0] - a[:, 0])[:, None]
        w = (t - a[:, 0])[:, None] / h
        position = (
            a[:, 1:4] * (1 + 2 * w) * (1 - w) ** 2
            + b[:, 1:4] * w**2 * (3 - 2 * w)
            + h * a[:, 8:11] * w * (1 - w) ** 2
            - h * b[:, 8:11] * w**2 * (1 - w)
        )
        blend = a[:, 8:] * (1 - w) + b[:, 8:] * w
        turned = a[:, 4:8] * (1 - w) + b[:, 4:8] * w  # steps are short: a straight line is as good as the great arc
        return Kinematics(
            position,
            Rotation.from_quat(turned),
            blend[:, :3],
            blend[:, 3:6],
            blend[:, 6:9],
            blend[:, 9:12],
        )
