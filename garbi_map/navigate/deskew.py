"""Every profile of a sweep at its own pose."""

from __future__ import annotations

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.sweep.types import Sweep


def place(sweep: Sweep, trajectory_of_rig: Trajectory) -> Floats:
    """The sweep's points (n, 3) in the map frame, m, each profile at the pose map <- rig of its own instant.

    The trajectory may have any stamps: poses in between are interpolated, and held beyond its ends.
    """
    poses = trajectory_of_rig.at(sweep.stamp_ns)
    return _moved(sweep, poses.rotation.as_matrix(), poses.position)


def deskew(sweep: Sweep, trajectory_of_rig: Trajectory, reference_stamp: int) -> Floats:
    """The sweep's points (n, 3) in the rig frame of one instant, m: as if the vehicle had stood still then."""
    poses = trajectory_of_rig.at(sweep.stamp_ns)
    reference = trajectory_of_rig.at(np.array([reference_stamp], np.int64))
    back = reference.rotation[0].inv()
    return _moved(sweep, (back * poses.rotation).as_matrix(), back.apply(poses.position - reference.position[0]))


def _moved(sweep: Sweep, rotation: Floats, translation: Floats) -> Floats:
    from garbi_map.navigate.kernels import place_points

    return place_points(sweep.points, sweep.profile, np.ascontiguousarray(rotation), translation.reshape(-1, 3))
