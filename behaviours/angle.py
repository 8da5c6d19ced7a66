"""The laser's angle as it is known now: from the encoder's readings that have arrived."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

TURN = 8e-4  # rad, by which the angle has to come back before a pass is over
KEPT = 400  # readings that are remembered


class LiveAngle:
    """Readings in, angles out; never from a reading that has not arrived. `fixed`: a laser without a motor.

    sweep   number of the current pass
    """

    def __init__(self, fixed: float | None, reach: float, stuck: float) -> None:
        self._fixed, self._reach_ns, self._stuck_ns = fixed, round(reach * 1e9), round(stuck * 1e9)
        self._stamps: list[int] = []
        self._angles: list[float] = []
        self._way, self._extreme = 0.0, np.nan
        self._changed_ns = 0
        self.sweep = 0

    def add(self, stamp_ns: int, angle: float) -> None:
        """One reading; those that are no numbers or whose stamps go back are left out."""
        if not np.isfinite(angle) or (self._stamps and stamp_ns <= self._stamps[-1]):
            if self._stamps and stamp_ns < self._stamps[-1] - 1_000_000_000:  # the clock was set back: begin anew
                self._stamps, self._angles = [], []
            else:
                return
        if not self._angles or angle != self._angles[-1]:
            self._changed_ns = stamp_ns
        self._stamps.append(stamp_ns)
        self._angles.append(angle)
        if len(self._stamps) > 2 * KEPT:
            del self._stamps[:KEPT], self._angles[:KEPT]
        self._follow(angle)

    def _follow(self, angle: float) -> None:
        if np.isnan(self._extreme):
            self._extreme = angle
        ahead = self._way * (angle - self._extreme)
        if self._way == 0.0:
            if abs(angle - self._extreme) > TURN:
                self._way, self._extreme = float(np.sign(angle - self._extreme)), angle
        elif ahead > 0.0:
            self._extreme = angle
        elif ahead < -TURN:
            self._way, self._extreme, self.sweep = -self._way, angle, self.sweep + 1

    def stuck(self, stamp_ns: int) -> bool:
        """Whether a motor's encoder reads the same for too long: then no image tells where its points are."""
        return self._fixed is None and stamp_ns - self._changed_ns > self._stuck_ns

    def at(self, stamp_ns: int) -> float:
        """rad; NaN where no reading is near."""
        if self._fixed is not None and not self._stamps:
            return self._fixed
        after = bisect_right(self._stamps, stamp_ns)
        if after == 0 or len(self._stamps) < 2:
            return float("nan")
        if after == len(self._stamps):
            if stamp_ns - self._stamps[-1] > self._reach_ns:
                return float("nan")
            after -= 1
        t0, t1 = self._stamps[after - 1], self._stamps[after]
        if t1 - t0 > 2 * self._reach_ns:
            return float("nan")
        w = (stamp_ns - t0) / (t1 - t0)
        return self._angles[after - 1] * (1 - w) + self._angles[after] * w
