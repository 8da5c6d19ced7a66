"""Other ways to place the sweeps of a dive, to be printed beside the map's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.navigate import Trajectory, place
from garbi_map.sweep.store import SweepStore

Floats = NDArray[np.float64]


def placed(store: SweepStore, trajectory: Trajectory, mount: Mount) -> Floats:
    """All points (n, 3) of a store in the map, each by the pose of its own profile."""
    return np.concatenate([place(sweep, trajectory.at(sweep.stamp_ns).mounted(mount)) for sweep in store])


def stock_kiss_icp(store: SweepStore, mount: Mount) -> Trajectory:
    """kiss-icp as it comes: whole sweeps in metres, not de-skewed, its own guess; the range limited to the scanner's."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range = 5.0
    config.data.min_range = 0.1
    config.data.deskew = False
    config.mapping.voxel_size = config.data.max_range / 100.0
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    rotation = Rotation.from_quat(mount.quaternion).as_matrix()
    stamps, poses = [], []
    for sweep in store:
        odometry.register_frame(sweep.points @ rotation.T + mount.translation, np.zeros(len(sweep.points)))
        stamps += [sweep.stamp_ns[0], sweep.stamp_ns[-1]]
        poses += [odometry.last_pose, odometry.last_pose]
    return _rigid(stamps, poses)


def gicp(store: SweepStore, navigation: Trajectory, mount: Mount, against: int = 8) -> Trajectory:
    """Open3D's generalised ICP of each sweep, de-skewed by the navigation filter, against the last `against` ones."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    clouds: list[o3d.geometry.PointCloud] = []
    correction = np.eye(4)
    stamps, moves = [], []
    for sweep in store:
        cloud = o3d.geometry.PointCloud(
            o3d.utility.Vector3dVector(place(sweep, navigation.at(sweep.stamp_ns).mounted(mount)))
        ).voxel_down_sample(0.01)
        if clouds:
            target = o3d.geometry.PointCloud()
            for earlier in clouds[-against:]:
                target += earlier
            found = registration.registration_generalized_icp(
                cloud, target.voxel_down_sample(0.01), 0.05, correction,
                registration.TransformationEstimationForGeneralizedICP(),
                registration.ICPConvergenceCriteria(max_iteration=40),
            )  # fmt: skip
            correction = np.array(found.transformation)
        cloud.transform(correction)
        clouds.append(cloud)
        stamps.append((int(sweep.stamp_ns[0]) + int(sweep.stamp_ns[-1])) // 2)
        moves.append(correction)
    return _moved(navigation, np.array(stamps), np.array(moves))


def _moved(trajectory: Trajectory, stamps: NDArray[np.int64], moves: Floats) -> Trajectory:
    """A trajectory with corrections (k, 4, 4) in the map frame at stamps (k,), linear in between."""
    rotation = Rotation.from_matrix(moves[:, :3, :3]).as_quat()
    still = np.zeros((len(moves), 6, 6))
    centre = trajectory.position.mean(axis=0)
    shift = moves[:, :3, :3] @ centre + moves[:, :3, 3] - centre
    along = Trajectory(stamps, shift, rotation, still).at(trajectory.stamp_ns)
    return Trajectory(
        trajectory.stamp_ns,
        along.rotation.apply(trajectory.position - centre) + centre + along.position,
        (along.rotation * trajectory.rotation).as_quat(),
        trajectory.covariance,
    )


def _rigid(stamps: list[int], poses: list[Floats]) -> Trajectory:
    """One pose for all of a sweep: the same at its first and at its last stamp."""
    matrices = np.array(poses)
    ascending = np.array(stamps, np.int64)
    return Trajectory(
        ascending,
        matrices[:, :3, 3],
        Rotation.from_matrix(matrices[:, :3, :3]).as_quat(),
        np.zeros((len(ascending), 6, 6)),
    )
