"""The current, from how the vehicle slides: without sway propellers it soon moves abeam with the water."""

from __future__ import annotations

import numpy as np

from behaviours.types import Pose
from garbi_map.log.records import Floats

WAVES = 0.05  # m/s, 1 sigma of what waves add to the sway
CHANGE = 0.003  # m/s per square root of a second, by which a current changes
FASTEST = 0.15  # m/s, 1 sigma of a current of which nothing is known


class Drift:
    """A Kalman filter of two states: `current` (2,) m/s, odom."""

    def __init__(self, skid: float, sway_time: float) -> None:
        """skid, sway_time: see settings.Vehicle."""
        self._slide = skid * sway_time
        self.current: Floats = np.zeros(2)
        self._covariance = np.eye(2) * FASTEST**2
        self._last_ns: int | None = None

    def see(self, pose: Pose) -> None:
        """Sway at one moment; while the vehicle turns it is mostly skid and tells little."""
        seconds = 0.0 if self._last_ns is None else (pose.stamp_ns - self._last_ns) * 1e-9
        self._last_ns = pose.stamp_ns
        if not 0.0 < seconds < 5.0:
            return
        self._covariance += np.eye(2) * CHANGE**2 * seconds
        across = np.array([-np.sin(pose.heading), np.cos(pose.heading)])
        skid = -self._slide * float(pose.velocity[0] * pose.rate[2])
        # Readings of one wave are not independent: ten a second count as one every two seconds.
        variance = (WAVES**2 + skid**2) * 2.0 / seconds
        gain = self._covariance @ across / (across @ self._covariance @ across + variance)
        self.current = self.current + gain * (float(pose.velocity[1]) - skid - across @ self.current)
        self._covariance -= np.outer(gain, across @ self._covariance)
