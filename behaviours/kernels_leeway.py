"""Compiled rehearsal of turning into the current: how near would what stands come while the water carries the vehicle."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from behaviours.kernels_charts import FAR
from behaviours.kernels_plan import SLACK
from behaviours.kernels_rollout import _at, moved_on
from garbi_map.log.records import Floats

TURNED = 0.25  # rad from the heading that was to be reached, where the turn passes into steering


@njit(cache=True, nogil=True)
def carried(
    state: Floats,
    current: Floats,
    first: Floats,
    lead: int,
    escapes: Floats,
    step: float,
    count: int,
    model: Floats,
    occupied: NDArray[np.float32],
    unseen: NDArray[np.float32],
    low: NDArray[np.int64],
    voxel: float,
    circles: Floats,
    radius: float,
    most: float,
) -> Floats:
    """(m, 3) of each escape: least gap between hull and what stands, m; by how much, m, the hull would get deeper into
    unseen water than it is and than safety lets by; and the mean gap, m.

    state      (6,) x y m, heading rad, surge and sway over ground m/s, yaw rate rad/s
    current    (2,) m/s, odom
    first      (2,) surge m/s and yaw rad/s for the first `lead` steps
    escapes    (m, 4) then: surge while it turns, yaw rate, heading to turn to (rad; nan: none), surge from then on
    step, count  s, number of steps
    model      (4,) lag of surge s, of yaw s, of sway s, share of surge times yaw rate that becomes sway
    occupied, unseen, low, voxel  (nx, ny) m, one height of Charts
    circles    (k,) m along the hull, of discs of that radius that cover it; most: m of gap that count for the mean
    """
    found = np.empty((len(escapes), 3))
    for m in range(len(escapes)):
        x, y, heading, surge, sway, rate = state
        nearest, mean, outset, deepest, turning = FAR, 0.0, FAR, FAR, not math.isnan(escapes[m, 2])
        for n in range(count + 1):
            cos, sin = math.cos(heading), math.sin(heading)
            gap = FAR
            for k in range(len(circles)):
                px, py = x + cos * circles[k], y + sin * circles[k]
                gap = min(gap, _at(occupied, voxel, low, px, py, FAR) - radius - 0.5 * voxel)
                deepest = min(deepest, _at(unseen, voxel, low, px, py, FAR) - radius)
            nearest, mean = min(nearest, gap), mean + min(gap, most) / (count + 1)
            if n == 0:
                outset = min(deepest, -SLACK)
            wanted_surge, wanted_rate = first[0], first[1]
            if n >= lead:
                wanted_surge, wanted_rate = escapes[m, 0], escapes[m, 1]
                if not math.isnan(escapes[m, 2]):
                    off = (escapes[m, 2] - heading + math.pi) % (2 * math.pi) - math.pi
                    turning = turning and abs(off) > TURNED
                    if not turning:
                        wanted_surge, wanted_rate = escapes[m, 3], 0.8 * off
            x, y, heading, surge, sway, rate = moved_on(
                x, y, heading, surge, sway, rate, wanted_surge, wanted_rate, current, step, model
            )
        found[m, 0], found[m, 1], found[m, 2] = nearest, max(outset - deepest, 0.0), mean
    return found
