"""What the behaviours are asked about: everything that is known at one moment."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from behaviours.moving import Mover
from behaviours.space import Corridor, Nearby, Space
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats


@dataclass(frozen=True)
class Situation:
    """One moment. profiles: those that became known since the last one; movers, undecided: what moves, and what may;
    troubles: of the input, in words; current: (2,) m/s, odom, as far as it is known."""

    now_ns: int
    pose: Pose
    profiles: list[Profile]
    space: Space
    nearby: Nearby
    corridor: Corridor
    movers: list[Mover]
    troubles: list[str]
    current: Floats = field(default_factory=lambda: np.zeros(2))
    undecided: list[Mover] = field(default_factory=list)

    def clearer_side(self, before: float) -> float:
        """+1 to port, -1 to starboard: where more water ahead is known to be free; the side before unless clearly less."""
        from behaviours import kernels

        x = np.arange(0.5, 2.6, 0.2)
        free = []
        for side in (1.0, -1.0):
            points = np.array([[a, side * b, c] for a in x for b in (0.3, 0.6, 0.9, 1.2) for c in (-0.2, 0.1)])
            states = self.space.state(points @ self.pose.rotation.T + self.pose.position)
            free.append(float(np.mean(states == kernels.FREE) - 2 * np.mean(states == kernels.OCCUPIED)))
        if abs(free[0] - free[1]) < 0.1:
            return before
        return 1.0 if free[0] > free[1] else -1.0
