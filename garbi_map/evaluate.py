"""A map against a known truth. Nothing else in the project reads truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.export.cloud import read_cloud
from garbi_map.log.records import Floats
from garbi_map.navigate.trajectory import Trajectory

ARM = 1.4  # m; an attitude error of one degree counts as 2.5 cm in the alignment: what it does at the bottom
GATES = (0.1, 0.03, 0.03, 0.015, 0.015, 0.015)  # m; points farther from the surface do not take part in a round
LEAST = 0.02  # of the points must be that near, or a round of the alignment is left out: a few fit anything
SAMPLE = 200_000  # points of the cloud that are measured
FAR = 0.010  # m; beyond that a point is wrong
NEAR = 0.005  # m; a place within that of a point is mapped
INTERVAL = 1.0  # s, of the relative pose error


@dataclass(frozen=True)
class Truth:
    """What is known, or None: trajectory, surface (vertices (v, 3), triangles (t, 3)), places seen (s, 3); m."""

    trajectory: Trajectory | None = None
    surface: tuple[Floats, NDArray[np.int32]] | None = None
    seen: Floats | None = None


@dataclass(frozen=True)
class TrajectoryErrors:
    """After the rigid alignment. ate: absolute, rpe: relative over `INTERVAL`; mm and degrees, root mean square."""

    poses: int
    ate_rmse_mm: float
    ate_attitude_deg: float
    rpe_mm: float | None
    rpe_attitude_deg: float | None


@dataclass(frozen=True)
class CloudErrors:
    """Distances of the cloud to the true surface after the alignment; complete: share of the places seen."""

    points: int
    median_mm: float
    rms_mm: float
    rms99_mm: float
    p95_mm: float
    beyond10_percent: float
    complete_percent: float | None


@dataclass(frozen=True)
class Evaluation:
    """All that could be compared; None where the truth or the map lacks it."""

    trajectory: TrajectoryErrors | None
    cloud: CloudErrors | None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def evaluate(made: Path, truth: Truth) -> Evaluation:
    """Compare trajectory.tum and cloud.laz of the folder `made` with the truth.

    The origin of a map is free: first one rigid motion brings trajectory on trajectory, positions and attitudes (a
    short straight path does not fix roll), then point-to-plane steps of the same six numbers the cloud on the surface.
    Raises GarbiError when there is nothing to compare or a file cannot be read.
    """
    rotation, shift = Rotation.identity(), np.zeros(3)
    path = None
    if truth.trajectory is not None:
        path, rotation, shift = _compare_trajectories(read_tum(made / "trajectory.tum"), truth.trajectory)
    cloud = None
    if truth.surface is not None:
        points = rotation.apply(read_cloud(made / "cloud.laz")) + shift
        cloud = compare_cloud(points, *truth.surface, truth.seen)
    if path is None and cloud is None:
        raise GarbiError(f"{made}: the truth has neither a trajectory nor a surface to compare with")
    return Evaluation(path, cloud)


def rigid_alignment(made: Trajectory, true: Trajectory) -> tuple[Rotation, Floats]:
    """The R, t that minimise the distances of R made + t from true at the poses and at arms along their axes.

    Kabsch, A solution for the best rotation to relate two sets of vectors, 1976.
    """
    arms = ARM * np.concatenate([np.eye(3), -np.eye(3)])
    here, there = (
        (pose.position[:, None] + np.stack([pose.rotation.apply(arm) for arm in arms], 1)).reshape(-1, 3)
        for pose in (made, true)
    )
    rotation, _ = Rotation.align_vectors(there - there.mean(0), here - here.mean(0))
    return rotation, there.mean(0) - rotation.apply(here.mean(0))


def _compare_trajectories(made: Trajectory, true: Trajectory) -> tuple[TrajectoryErrors, Rotation, Floats]:
    inside = (made.stamp_ns >= true.stamp_ns[0]) & (made.stamp_ns <= true.stamp_ns[-1])
    if not inside.any():
        raise GarbiError(
            "trajectory.tum and the true trajectory have no time in common: is this the truth of this dive?"
        )
    made = Trajectory(made.stamp_ns[inside], made.position[inside], made.quaternion[inside], made.covariance[inside])
    true = true.at(made.stamp_ns)
    rotation, shift = rigid_alignment(made, true)
    off = true.position - rotation.apply(made.position) - shift
    turned = (true.rotation * (rotation * made.rotation).inv()).magnitude()
    moved, tilted = _relative_errors(made, true)
    errors = TrajectoryErrors(
        len(off),
        1e3 * _rms(np.linalg.norm(off, axis=1)),
        float(np.degrees(_rms(turned))),
        None if not len(moved) else 1e3 * _rms(moved),
        None if not len(moved) else float(np.degrees(_rms(tilted))),
    )
    return errors, rotation, shift


def _relative_errors(made: Trajectory, true: Trajectory) -> tuple[Floats, Floats]:
    """How wrong the motion over every INTERVAL is: metres and radians (k,) (Sturm et al., IROS 2012)."""
    later = np.searchsorted(made.stamp_ns, made.stamp_ns + round(INTERVAL * 1e9))
    first = np.flatnonzero(later < len(later))
    last = later[first]
    motions = []
    for poses in (made, true):
        back = poses.rotation[first].inv()
        motions.append((back.apply(poses.position[last] - poses.position[first]), back * poses.rotation[last]))
    (step_made, turn_made), (step_true, turn_true) = motions
    if not len(first):
        return np.zeros(0), np.zeros(0)
    # the error of the motion seen from the true pose at its end
    off = turn_true.inv().apply(step_made - step_true)
    return np.linalg.norm(off, axis=1), (turn_true.inv() * turn_made).magnitude()


class TrueSurface:
    """A surface, vertices (v, 3) m and triangles (t, 3), that clouds are laid on and measured against."""

    def __init__(self, vertices: Floats, triangles: NDArray[np.int32]) -> None:
        import open3d as o3d

        self._centre = np.round(vertices.mean(0))  # ray casting computes in float32
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            o3d.core.Tensor.from_numpy((vertices - self._centre).astype(np.float32)),
            o3d.core.Tensor.from_numpy(triangles.astype(np.uint32)),
        )

    def aligned(self, points: Floats) -> Floats:
        """Points (n, 3), roughly in the surface's frame, after the rigid motion that lays them on it."""
        import open3d as o3d

        if not len(points):
            raise GarbiError("cloud.laz holds no points to compare")
        points = points - self._centre
        sample = self._sample(points)
        for gate in GATES:
            probe = points[sample]
            nearest = self._scene.compute_closest_points(o3d.core.Tensor.from_numpy(probe.astype(np.float32)))
            foot, normal = nearest["points"].numpy(), nearest["primitive_normals"].numpy().astype(np.float64)
            use = np.linalg.norm(probe - foot, axis=1) < gate
            if np.count_nonzero(use) < max(6, LEAST * len(probe)):
                continue
            jacobian = np.hstack([np.cross(probe[use], normal[use]), normal[use]])
            step = np.linalg.lstsq(jacobian, -((probe - foot) * normal).sum(1)[use], rcond=None)[0]
            points = Rotation.from_rotvec(step[:3]).apply(points) + step[3:]
        return points + self._centre

    def errors(self, points: Floats, seen: Floats | None = None) -> CloudErrors:
        """Distances of points (n, 3), where they are, to the surface; seen (s, 3): places that should be there."""
        import open3d as o3d

        probe = (points - self._centre)[self._sample(points)].astype(np.float32)
        distance = np.sort(self._scene.compute_distance(o3d.core.Tensor.from_numpy(probe)).numpy())
        complete = None
        if seen is not None and len(seen):
            complete = 100 * float((cKDTree(points).query(seen)[0] < NEAR).mean())
        return CloudErrors(
            points=len(points),
            median_mm=1e3 * float(np.median(distance)),
            rms_mm=1e3 * _rms(distance),
            rms99_mm=1e3 * _rms(distance[: max(1, int(0.99 * len(distance)))]),
            p95_mm=1e3 * float(np.percentile(distance, 95)),
            beyond10_percent=100 * float((distance > FAR).mean()),
            complete_percent=complete,
        )

    def _sample(self, points: Floats) -> NDArray[np.int64]:
        return np.random.default_rng(0).permutation(len(points))[:SAMPLE]


def compare_cloud(
    points: Floats, vertices: Floats, triangles: NDArray[np.int32], seen: Floats | None = None
) -> CloudErrors:
    """Distances of points (n, 3), roughly in the frame of the surface (v, 3), (t, 3), to it, finely aligned."""
    surface = TrueSurface(vertices, triangles)
    return surface.errors(surface.aligned(points), seen)


def read_truth(paths: Sequence[Path]) -> Truth:
    """Truth from files, told apart by their endings, or from folders that hold them.

    `*trajectory.tum`, or a log with /truth/odometry: the trajectory; `*.ply`: the surface; `*seen.npy`: places (s, 3)
    that the scanner saw. Raises GarbiError that names the file which is missing, doubled or not what it should be.
    """
    files: list[Path] = []
    for path in paths:
        if not path.exists():
            raise GarbiError(f"{path}: there is no such truth")
        bag = path.is_dir() and (path / "metadata.yaml").exists()
        files += sorted(path.glob("*truth*")) if path.is_dir() and not bag else [path]
    found: dict[str, Any] = {}
    for file in files:
        if file.suffix == ".tum":
            found["trajectory"] = read_tum(file)
        elif file.suffix == ".ply":
            found["surface"] = _read_surface(file)
        elif file.suffix == ".npy":
            found["seen"] = _read_seen(file)
        else:
            found["trajectory"] = _read_odometry(file)
    if not found:
        raise GarbiError(
            f"{paths[0]}: no truth there: truth_trajectory.tum, truth_seabed.ply or truth_seen.npy is needed"
        )
    return Truth(**found)


def read_tum(path: Path) -> Trajectory:
    """Lines of `stamp x y z qx qy qz qw`; stamps to the nanosecond, covariances zero. Raises GarbiError."""
    try:
        rows = [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
        stamps = np.array([_nanoseconds(row[0]) for row in rows], np.int64)
        poses = np.array([row[1:8] for row in rows], np.float64).reshape(-1, 7)
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, IndexError, OverflowError) as error:
        raise GarbiError(f"{path}: not a trajectory: every line must be `stamp x y z qx qy qz qw`") from error
    if not len(stamps) or not np.isfinite(poses).all() or (np.diff(stamps) < 0).any():
        raise GarbiError(f"{path}: not a trajectory: empty, not finite or not in the order of time")
    stamps, first = np.unique(stamps, return_index=True)
    return Trajectory(stamps, poses[first, :3], poses[first, 3:], np.zeros((len(stamps), 6, 6)))


def _nanoseconds(text: str) -> int:
    seconds, _, fraction = text.partition(".")
    return int(seconds) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))


def _read_surface(path: Path) -> tuple[Floats, NDArray[np.int32]]:
    import open3d as o3d

    mesh = o3d.io.read_triangle_mesh(path)
    triangles = np.asarray(mesh.triangles)
    if not len(triangles):
        raise GarbiError(f"{path}: not a surface: a PLY file with triangles is needed")
    return np.asarray(mesh.vertices), triangles


def _read_seen(path: Path) -> Floats:
    try:
        seen = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise GarbiError(f"{path}: cannot be read as a numpy array: {' '.join(str(error).split())}") from error
    if seen.ndim != 2 or seen.shape[1] != 3:
        raise GarbiError(f"{path}: an array (n, 3) of places is needed, not {seen.shape}")
    return seen.astype(np.float64)


def _read_odometry(path: Path) -> Trajectory:
    from garbi_map.log import LogSettings, Topics, open_log

    odometry = open_log([path], LogSettings(topics=Topics(odometry="/truth/odometry"))).navigation().odometry
    if odometry is None or not len(odometry.stamp_ns):
        raise GarbiError(f"{path}: no /truth/odometry in it")
    count = len(odometry.stamp_ns)
    return Trajectory(odometry.stamp_ns, odometry.position, odometry.quaternion, np.zeros((count, 6, 6)))


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))
