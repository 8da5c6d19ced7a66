"""The motor: the laser's angle over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from garbi_map.log.records import Floats
from tools.simulator.scenario import Laser


def laser_angle(laser: Laser, time: ArrayLike) -> Floats:
    """alpha (n,) rad at times (n,) s: a saw-tooth to and fro whose turns are parabolas; constant without a motor."""
    low, high = laser.range
    t = np.atleast_1d(np.asarray(time, float))
    if not laser.motor:
        return np.full_like(t, (low + high) / 2)
    x = np.abs((t / laser.sweep + 0.3) % 2.0 - 1.0)  # 0 and 1 at the turns; a dive begins inside a sweep
    w = max(laser.round / 2, 1e-9)
    x = np.where(x < w, x**2 / (2 * w) + w / 2, x)
    back = 1 - x
    x = np.where(back < w, 1 - (back**2 / (2 * w) + w / 2), x)
    return low + (high - low) * (x - w / 2) / (1 - w)
