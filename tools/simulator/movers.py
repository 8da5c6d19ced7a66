"""Which points of a sweep came from something that moved: truth for tests and benchmarks alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.sweep import Sweep
from tools.simulator.dive import Dive
from tools.simulator.sensors import START_NS

FAR = 0.006
"""m; a point farther from everything is nobody's: the ray's noise at a silhouette."""


def moved(dive: Dive, sweep: Sweep) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Points (n,) of a sweep on moving bodies, and on the still seabed; with the true poses, each profile at its time."""
    camera = dive.scenario.camera
    mover, still = np.zeros(len(sweep.points), bool), np.zeros(len(sweep.points), bool)
    for number, stamp_ns in enumerate(sweep.stamp_ns):
        time = (int(stamp_ns) - START_NS) * 1e-9 - camera.clock_offset
        position, rotation = dive.rig_pose(time)
        mine = np.flatnonzero(sweep.profile == number)
        placed = rotation.apply(sweep.points[mine]) + position
        ground, body = dive.scene.distances(placed, time)
        still[mine] = (ground < FAR) & (ground <= body)
        mover[mine] = (body < FAR) & (body < ground)
    return mover, still
