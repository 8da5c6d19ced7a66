"""An attitude that comes on a topic of its own, brought together with the IMU's messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from garbi_map.log.records import Attitude, Imu

LONGEST_GAP = 500_000_000
"""ns; across a longer silence of the attitude nothing is interpolated."""


def with_attitude(imu: Imu | None, attitude: Attitude) -> Imu:
    """The IMU with the attitude interpolated to its stamps (on great circles; NaN beyond the attitude's ends and in its
    gaps). Without an IMU the attitude alone, rates and forces NaN: the navigation takes rates from it."""
    count = len(attitude.stamp_ns)
    turns = attitude.quaternion / np.linalg.norm(attitude.quaternion, axis=1, keepdims=True)
    if imu is None:
        nothing = np.full((count, 3), np.nan)
        return Imu(attitude.stamp_ns, attitude.arrival_ns, nothing, nothing, turns, np.zeros((count, 3, 3)))
    found = np.full((len(imu.stamp_ns), 4), np.nan)
    if count > 1:
        from scipy.spatial.transform import Rotation, Slerp

        after = np.clip(np.searchsorted(attitude.stamp_ns, imu.stamp_ns), 1, count - 1)
        first, last = attitude.stamp_ns[after - 1], attitude.stamp_ns[after]
        inside = (first <= imu.stamp_ns) & (imu.stamp_ns <= last) & (last - first <= LONGEST_GAP)
        start = attitude.stamp_ns[0]
        between = Slerp((attitude.stamp_ns - start) * 1e-9, Rotation.from_quat(turns))
        found[inside] = between((imu.stamp_ns[inside] - start) * 1e-9).as_quat()
    return replace(imu, attitude=found, attitude_covariance=np.zeros((len(found), 3, 3)))
