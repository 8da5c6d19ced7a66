"""The yardstick itself is measured: known perturbations give known errors."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.cli import main
from garbi_map.errors import GarbiError
from garbi_map.evaluate import Truth, compare_cloud, evaluate, read_truth, read_tum
from garbi_map.export import CloudWriter, write_trajectory
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import AcceptedPoints

MOTION = Rotation.from_rotvec([0.05, -0.08, 1.2])
SHIFT = np.array([4.0, -3.0, -17.0])


def path(count: int = 400, rate: float = 20.0) -> Trajectory:
    """A short straight path with a gentle roll: positions alone would not fix it."""
    time = np.arange(count) / rate
    position = np.stack([0.15 * time, 0 * time, 1.3 + 0 * time], 1)
    attitude = Rotation.from_euler("xyz", np.stack([0.03 * np.sin(time), 0.02 * np.cos(time), 0 * time], 1))
    stamps = 1_790_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64)
    return Trajectory(stamps, position, attitude.as_quat(), np.zeros((count, 6, 6)))


def moved(trajectory: Trajectory, rotation: Rotation = MOTION, shift: NDArray = SHIFT) -> Trajectory:
    """In another `map`."""
    return Trajectory(
        trajectory.stamp_ns,
        rotation.apply(trajectory.position) + shift,
        (rotation * trajectory.rotation).as_quat(),
        trajectory.covariance,
    )


def bumpy(side: int = 120) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """A triangulated floor of 2.4 m with bumps of 10 cm, so that it fixes six degrees of freedom."""
    y, x = np.mgrid[:side, :side] * 0.02
    z = 0.1 * np.sin(4 * x) * np.cos(5 * y) + 0.05 * np.sin(9 * x + 2 * y)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + side + 1], 1)
    upper = np.stack([corner, corner + side + 1, corner + side], 1)
    return vertices, np.concatenate([lower, upper]).astype(np.int32)


def on_surface(count: int, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, 3) on `bumpy`, away from its edge, and the normals there."""
    vertices, triangles = bumpy()
    rng = np.random.default_rng(seed)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inner = np.flatnonzero((np.abs(a[:, :2] - 1.2) < 1.1).all(1))
    pick = rng.choice(inner, count)
    share = rng.dirichlet([1, 1, 1], count)
    points = share[:, :1] * a[pick] + share[:, 1:2] * b[pick] + share[:, 2:] * c[pick]
    normal = np.cross((b - a)[pick], (c - a)[pick])
    return points, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def write_map(folder: Path, trajectory: Trajectory, points: NDArray[np.float64]) -> None:
    """What `garbi map` writes, as far as it is evaluated."""
    write_trajectory(folder / "trajectory.tum", trajectory)
    count = len(points)
    with CloudWriter(folder / "cloud.laz") as writer:
        writer.write(
            AcceptedPoints(
                np.full(count, trajectory.stamp_ns[0]),
                points,
                np.full(count, 1e-3, np.float32),
                np.zeros(count, np.float32),
                np.zeros(count, np.uint8),
            )
        )


def write_truth(folder: Path) -> None:
    """Truth as a dive brings it."""
    write_trajectory(folder / "truth_trajectory.tum", path())
    vertices, triangles = bumpy()
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles))
    o3d.io.write_triangle_mesh(folder / "truth_seabed.ply", mesh)
    np.save(folder / "truth_seen.npy", on_surface(5000, seed=7)[0].astype(np.float32))


def test_a_perfect_map_in_another_frame_has_no_error(tmp_path: Path) -> None:
    """Origin and heading of `map` are free: only the file's micrometres remain."""
    points, _ = on_surface(40_000)
    write_map(tmp_path, moved(path()), MOTION.apply(points) + SHIFT)
    found = evaluate(tmp_path, Truth(path(), bumpy(), on_surface(3000, 7)[0]))
    assert found.trajectory is not None
    assert found.cloud is not None
    assert found.trajectory.ate_rmse_mm < 0.005
    assert found.trajectory.rpe_mm is not None
    assert found.trajectory.rpe_mm < 0.005
    assert found.cloud.p95_mm < 0.01
    assert found.cloud.beyond10_percent == 0


def test_white_noise_in_the_trajectory_is_its_own_error(tmp_path: Path) -> None:
    """2 mm on each axis: ATE sqrt(3) of that, RPE sqrt(6)."""
    true = path(2000)
    noise = 0.002 * np.random.default_rng(0).standard_normal((2000, 3))
    noisy = Trajectory(true.stamp_ns, true.position + noise, true.quaternion, true.covariance)
    write_trajectory(tmp_path / "trajectory.tum", moved(noisy))
    found = evaluate(tmp_path, Truth(true)).trajectory
    assert found is not None
    assert found.ate_rmse_mm == pytest.approx(2 * np.sqrt(3), rel=0.05)
    assert found.rpe_mm == pytest.approx(2 * np.sqrt(6), rel=0.05)


def test_a_roll_that_a_straight_path_would_hide_is_seen(tmp_path: Path) -> None:
    """Two degrees of roll about the direction of travel: positions are right, attitudes are not."""
    true = path()
    rolled = (true.rotation * Rotation.from_euler("x", np.linspace(-2, 2, 400)[:, None], degrees=True)).as_quat()
    write_trajectory(tmp_path / "trajectory.tum", Trajectory(true.stamp_ns, true.position, rolled, true.covariance))
    found = evaluate(tmp_path, Truth(true)).trajectory
    assert found is not None
    assert found.ate_attitude_deg == pytest.approx(2 / np.sqrt(3), rel=0.02)


def test_noise_along_the_normals_is_the_distance_to_the_surface() -> None:
    """1 mm: median 0.674 mm, 95th percentile 1.96 mm, rms 1 mm."""
    points, normals = on_surface(60_000)
    noisy = points + 0.001 * np.random.default_rng(1).standard_normal((len(points), 1)) * normals
    found = compare_cloud(noisy, *bumpy())
    assert found.median_mm == pytest.approx(0.674, rel=0.03)
    assert found.p95_mm == pytest.approx(1.96, rel=0.03)
    assert found.rms_mm == pytest.approx(1.0, rel=0.03)


def test_gross_errors_are_counted_and_do_not_pull_the_alignment() -> None:
    """3 % of the points 2 to 4 cm above the floor."""
    points, normals = on_surface(40_000)
    wrong = np.arange(len(points)) % 100 < 3
    off = np.where(wrong, np.random.default_rng(2).uniform(0.02, 0.04, len(points)), 0.0)
    found = compare_cloud(points + off[:, None] * normals, *bumpy())
    assert found.beyond10_percent == pytest.approx(3.0, abs=0.3)
    assert found.median_mm < 0.1


def test_a_small_misalignment_is_taken_out() -> None:
    """2 cm and half a degree that the trajectory left over."""
    points, _ = on_surface(50_000)
    off = Rotation.from_euler("xyz", [0.5, -0.4, 0.5], degrees=True).apply(points) + np.array([0.02, -0.015, 0.01])
    assert compare_cloud(off, *bumpy()).p95_mm < 0.02


def test_a_surface_far_from_the_origin_is_measured_as_well() -> None:
    """Ray casting computes in float32; the distances do not suffer."""
    points, _ = on_surface(20_000)
    vertices, triangles = bumpy()
    far = np.array([512_345.0, 4_650_123.0, -30.0])
    assert compare_cloud(points + far, vertices + far, triangles).p95_mm < 0.01


def test_completeness_is_the_share_of_places_with_a_point() -> None:
    """Half of the floor mapped: half complete."""
    points, _ = on_surface(400_000)
    seen, _ = on_surface(4000, 7)
    found = compare_cloud(points[points[:, 0] < 1.2], *bumpy(), seen)
    assert found.complete_percent == pytest.approx(100 * (seen[:, 0] < 1.2).mean(), abs=1.5)


def test_the_command_prints_a_table_and_writes_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From files to figures."""
    write_truth(tmp_path)
    write_map(tmp_path, path(), on_surface(50_000)[0])
    json_file = tmp_path / "e.json"
    monkeypatch.setattr(
        "sys.argv", ["garbi", "evaluate", str(tmp_path), "--truth", str(tmp_path), "--json", str(json_file)]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "95th percentile" in capsys.readouterr().out
    read = json.loads(json_file.read_text())
    assert read["cloud"]["median_mm"] < 0.01
    assert 0 < read["cloud"]["complete_percent"] <= 100
    assert read["trajectory"]["poses"] == 400


def test_truth_from_a_log_with_truth_odometry(tmp_path: Path) -> None:
    """Any log that carries /truth/odometry is a truth of the trajectory."""
    from rosbags.typesys import Stores, get_typestore

    from garbi_map.log import LogWriter

    types = get_typestore(Stores.ROS2_HUMBLE).types
    true = path(50)

    def message(k: int) -> object:
        stamp = types["builtin_interfaces/msg/Time"](*(int(v) for v in divmod(true.stamp_ns[k], 10**9)))
        pose = types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](*true.position[k]),
            types["geometry_msgs/msg/Quaternion"](*true.quaternion[k]),
        )
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        return types["nav_msgs/msg/Odometry"](
            types["std_msgs/msg/Header"](stamp, "map"),
            "base_link",
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)),
        )

    with LogWriter(tmp_path / "truth.mcap") as log:
        for k, stamp in enumerate(true.stamp_ns.tolist()):
            log.write("/truth/odometry", "nav_msgs/msg/Odometry", message(k), stamp)
    read = read_truth([tmp_path / "truth.mcap"]).trajectory
    assert read is not None
    np.testing.assert_array_equal(read.stamp_ns, true.stamp_ns)
    np.testing.assert_allclose(read.position, true.position, atol=1e-12)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "empty"),
        ("1 2 3\n", "not a trajectory"),
        ("a b c d e f g h\n", "not a trajectory"),
        ("2.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n", "order of time"),
        ("1.0 nan 0 0 0 0 0 1\n", "not finite"),
    ],
)
def test_a_broken_trajectory_is_one_clear_line(tmp_path: Path, content: str, complaint: str) -> None:
    """Which file, and what is wrong with it."""
    (tmp_path / "t.tum").write_text(content)
    with pytest.raises(GarbiError, match=complaint):
        read_tum(tmp_path / "t.tum")


def test_the_truth_of_another_dive_is_noticed(tmp_path: Path) -> None:
    """No common time, nothing there, a file that is no truth."""
    write_trajectory(tmp_path / "trajectory.tum", path())
    late = path()
    later = Trajectory(late.stamp_ns + 10**12, late.position, late.quaternion, late.covariance)
    with pytest.raises(GarbiError, match="no time in common"):
        evaluate(tmp_path, Truth(later))
    with pytest.raises(GarbiError, match="neither"):
        evaluate(tmp_path, Truth())
    with pytest.raises(GarbiError, match="no such truth"):
        read_truth([tmp_path / "nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(GarbiError, match="no truth there"):
        read_truth([tmp_path / "empty"])
    (tmp_path / "bad.npy").write_bytes(b"not numpy")
    with pytest.raises(GarbiError, match="numpy"):
        read_truth([tmp_path / "bad.npy"])


def test_it_agrees_with_an_independent_scorer(
    tmp_path: Path, shared: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scorer that lies beside the dives, on a map with noise, gross errors and another origin."""
    scorer = shared / "tools" / "score_map.py"
    if not scorer.exists():
        pytest.skip("no independent scorer beside the dives")
    spec = importlib.util.spec_from_file_location("score_map", scorer)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    truth = tmp_path / "truth"
    truth.mkdir()
    write_truth(truth)
    points, normals = on_surface(60_000)
    rng = np.random.default_rng(4)
    off = 0.0015 * rng.standard_normal(len(points)) + np.where(rng.random(len(points)) < 0.01, 0.02, 0)
    noisy = Trajectory(
        path().stamp_ns, path().position + 0.003 * rng.standard_normal((400, 3)), path().quaternion, path().covariance
    )
    write_map(tmp_path, moved(noisy), MOTION.apply(points + off[:, None] * normals) + SHIFT)
    module.main(truth, tmp_path)
    theirs = json.loads(capsys.readouterr().out)
    ours = evaluate(tmp_path, read_truth([truth]))
    assert ours.trajectory is not None
    assert ours.cloud is not None
    assert ours.trajectory.ate_rmse_mm == pytest.approx(theirs["ate_rmse"], abs=0.02)
    assert ours.cloud.median_mm == pytest.approx(theirs["median"], abs=0.005)
    assert ours.cloud.rms99_mm == pytest.approx(theirs["rms99"], abs=0.02)
    assert ours.cloud.p95_mm == pytest.approx(theirs["p95"], abs=0.02)
    assert ours.cloud.beyond10_percent == pytest.approx(theirs["beyond10_percent"], abs=0.02)
    assert ours.cloud.complete_percent == pytest.approx(100 * theirs["complete"], abs=0.05)


def test_a_cloud_that_is_nowhere_near_is_not_thrown_farther() -> None:
    """A few strays on the surface do not align the rest, which lies metres beside it."""
    vertices, triangles = bumpy()
    strays = vertices[:40]
    lost = np.random.default_rng(0).uniform([3, 3, 2], [6, 6, 4], (20_000, 3))
    found = compare_cloud(np.concatenate([strays, lost]), vertices, triangles)
    assert 1e3 < found.median_mm < 1e4
