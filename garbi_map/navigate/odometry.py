"""A trajectory that somebody else computed, as it is."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.log.records import Odometry
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.span import main_span, within
from garbi_map.navigate.trajectory import Trajectory


def odometry_trajectory(odometry: Odometry, settings: NavigateSettings) -> Trajectory:
    """The poses of /odometry/filtered moved to x = y = 0 at the first, with a covariance that grows on the way.

    Its own covariance, which few sources fill in, is not used. Raises GarbiError where no pose is usable.
    """
    span = main_span([odometry.stamp_ns], settings.longest_gap)
    keep = within(odometry.stamp_ns, *span)
    length = np.linalg.norm(np.nan_to_num(odometry.quaternion[keep]), axis=1)
    keep = keep[np.isfinite(odometry.position[keep]).all(axis=1) & (length > 0.5)]
    if len(keep) == 0:
        raise GarbiError("odometry: no message holds a finite pose; check the topic or leave it out of the topic map")
    position = odometry.position[keep].astype(float)
    seconds = (odometry.stamp_ns[keep] - odometry.stamp_ns[keep[0]]) * 1e-9
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])
    covariance = np.zeros((len(keep), 6, 6))
    diagonal = np.einsum("nii->ni", covariance)
    diagonal[:, :3] = (settings.odometry_noise**2 + settings.odometry_drift**2 * travelled)[:, None]
    diagonal[:, 3:] = (settings.odometry_rotation**2 + settings.odometry_rotation_drift**2 * seconds)[:, None]
    return Trajectory(
        odometry.stamp_ns[keep],
        position - [*position[0, :2], 0.0],
        Rotation.from_quat(odometry.quaternion[keep]).as_quat(),
        covariance,
    )
