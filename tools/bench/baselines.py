"""Other ways to place the sweeps of a dive, to be printed beside the map's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.navigate import Trajectory, place
from garbi_map.register.front_end import ScanToMap
from garbi_map.register.settings import FrontEndSettings
from garbi_map.sweep.store import SweepStore

Floats = NDArray[np.float64]

_VOXEL = 0.01
"""m, to which sweeps are thinned."""
_GATE = 0.05
"""m, of a correspondence."""
_BEFORE = 8
"""Sweeps that a new one is laid on."""
_OVERLAP = 0.3
"""Least share of a sweep's points that lie within the gate of an earlier one's, for a loop to be tried."""


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


def kiss_icp(store: SweepStore, navigation: Trajectory, mount: Mount) -> Trajectory:
    """kiss-icp in centimetres, sweeps de-skewed by the navigation filter, the last correction as the guess."""
    front_end = ScanToMap(FrontEndSettings())
    corrections = [np.eye(4)]
    for points in _deskewed(store, navigation, mount):
        corrections.append(front_end.align(points, corrections[-1]))
        front_end.insert(points, corrections[-1])
    return _moved(navigation, _middles(store), np.array(corrections[1:]))


def gicp_pose_graph(store: SweepStore, navigation: Trajectory, mount: Mount) -> Trajectory:
    """small_gicp's GICP of each sweep, de-skewed by the navigation filter, against the last ones; then of all pairs that
    overlap, and Open3D's pose graph over them."""
    import open3d as o3d
    import small_gicp

    def laid(source: Floats, target: Floats, guess: Floats) -> tuple[Floats, Floats]:
        found = small_gicp.align(
            target, source, guess, registration_type="GICP", max_correspondence_distance=_GATE,
            downsampling_resolution=_VOXEL, num_threads=1, max_iterations=40, rotation_epsilon=1e-5,
            translation_epsilon=1e-5,
        )  # fmt: skip
        return np.asarray(found.T_target_source), np.asarray(found.H)

    registration = o3d.pipelines.registration
    clouds = list(_deskewed(store, navigation, mount))
    graph = registration.PoseGraph()
    poses: list[Floats] = []
    moved: list[Floats] = []
    for k, cloud in enumerate(clouds):
        pose = poses[-1] if poses else np.eye(4)
        if k:
            pose, _ = laid(cloud, np.concatenate(moved[-_BEFORE:]), pose)
        poses.append(pose)
        moved.append(cloud @ pose[:3, :3].T + pose[:3, 3])
        graph.nodes.append(registration.PoseGraphNode(pose))
    for second in range(1, len(clouds)):
        for first in range(second):
            reach = cKDTree(moved[first]).query(moved[second], distance_upper_bound=_GATE)[0]
            neighbours = second == first + 1
            if not neighbours and (reach < np.inf).mean() < _OVERLAP:
                continue
            guess = np.linalg.inv(poses[first]) @ poses[second]
            between, information = laid(clouds[second], clouds[first], guess)
            graph.edges.append(
                registration.PoseGraphEdge(second, first, between, information, uncertain=not neighbours)
            )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(max_correspondence_distance=_GATE, reference_node=0),
    )
    return _moved(navigation, _middles(store), np.array([node.pose for node in graph.nodes]))


def _deskewed(store: SweepStore, navigation: Trajectory, mount: Mount) -> list[Floats]:
    """Each sweep's points (n, 3) as the navigation filter places them, one to a voxel."""
    out = []
    for sweep in store:
        points = place(sweep, navigation.at(sweep.stamp_ns).mounted(mount))
        voxel = np.floor(points / _VOXEL).astype(np.int64)
        out.append(points[np.unique(voxel, axis=0, return_index=True)[1]])
    return out


def _middles(store: SweepStore) -> NDArray[np.int64]:
    return np.array([(entry.begin_ns + entry.end_ns) // 2 for entry in store.entries], np.int64)


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
