"""The true path and surface of a simulated dive: drawn where its log has them, on our path, and never a reason to stop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log import LogWriter, Topics, open_log
from garbi_map.view import record_map, style
from garbi_map.view.truth import SURFACE, Truth
from tests.view_scene import IMAGES, PERIOD_NS, SEABED_Z, START, VEHICLE_Z, Scene, make_scene, recorded

TURN, SHIFT = Rotation.from_euler("z", 40, degrees=True), np.array([3.0, -2.0, 7.0])
"""From the scene's frame to that of its truth."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_scene(tmp_path_factory.mktemp("dive"))


def grid() -> NDArray[np.float32]:
    """The scene's plane, 81 x 101 points of 5 cm, in the truth's frame."""
    x, y = np.meshgrid(np.linspace(-2.0, 3.0, 101), np.linspace(-2.0, 2.0, 81))
    points = np.stack([x, y, np.full(x.shape, SEABED_Z)], axis=-1)
    return (TURN.apply(points.reshape(-1, 3)) + SHIFT).reshape(points.shape).astype(np.float32)


def write_truth(path: Path, points: NDArray[np.float32] | None, **lies: Any) -> Path:
    """A log of nothing but the truth; lies: fields of the cloud that are wrong."""
    with LogWriter(path, Topics(odometry="/truth/odometry")) as log:
        for k in range(IMAGES):
            place = TURN.apply([0.005 * k, 0.0, VEHICLE_Z]) + SHIFT
            log.write_odometry(START + k * PERIOD_NS, place, TURN.as_quat(), frames=("map", "base_link"))
        if points is not None:
            field, cloud = (log.types.types[f"sensor_msgs/msg/{name}"] for name in ("PointField", "PointCloud2"))
            fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
            rows, columns = points.shape[:2]
            told: dict[str, Any] = {
                "height": rows, "width": columns, "fields": fields, "is_bigendian": False, "point_step": 12,
                "row_step": 12 * columns, "data": np.frombuffer(points.tobytes(), np.uint8), "is_dense": False,
            }  # fmt: skip
            log.write(*SURFACE, cloud(header=log.header(START, "map"), **{**told, **lies}), START)
    return path


def test_the_true_surface_lies_under_the_map(scene: Scene, tmp_path: Path) -> None:
    """Truth in a frame of its own is laid on our path: its plane is that of the map, and ends beside it."""
    ours, mesh = scene.built.registered.trajectory, scene.mesh.vertices
    truth = Truth.of(open_log([write_truth(tmp_path / "truth.mcap", grid())]), ours, mesh)
    assert truth is not None and truth.points is not None
    np.testing.assert_allclose(truth.path, ours.position, atol=1e-6)
    np.testing.assert_allclose(truth.points[:, 2], SEABED_Z, atol=1e-5)
    for axis in (0, 1):
        assert truth.points[:, axis].min() >= mesh[:, axis].min() - 0.05
        assert truth.points[:, axis].max() <= mesh[:, axis].max() + 0.05


def test_a_map_s_recording_shows_it(scene: Scene, tmp_path: Path) -> None:
    """A mesh in no more triangles than there is room for, and a path; the page says what they are."""
    log = open_log([write_truth(tmp_path / "truth.mcap", grid())])
    dive = replace(scene.dive, log=log)
    record_map(tmp_path / "map.rrd", dive, scene.store, scene.built, scene.mesh)
    content = recorded(tmp_path / "map.rrd")
    mesh = content[style.TRUTH_SURFACE.path]
    (triangles,) = [row for row in mesh["Mesh3D:triangle_indices"] if row]
    (vertices,) = [row for row in mesh["Mesh3D:vertex_positions"] if row]
    assert len(triangles) > 0 and np.max(triangles) < len(vertices)
    assert style.TRUTH_ROUTE.path in content
    (page,) = [row for row in content[style.ABOUT]["TextDocument:text"] if row]
    assert style.TRUTH_SURFACE.meaning in page[0]


def test_without_truth_there_is_none(scene: Scene, tmp_path: Path) -> None:
    """A log of a real dive has none, and one of a simulation may have the path alone."""
    ours, mesh = scene.built.registered.trajectory, scene.mesh.vertices
    assert Truth.of(open_log([scene.log]), ours, mesh) is None
    path_only = Truth.of(open_log([write_truth(tmp_path / "path.mcap", None)]), ours, mesh)
    assert path_only is not None and path_only.surface is None
    elsewhere = grid() + np.float32([50.0, 0.0, 0.0])
    far_away = Truth.of(open_log([write_truth(tmp_path / "far.mcap", elsewhere)]), ours, mesh)
    assert far_away is not None and far_away.surface is None


@settings(max_examples=25, deadline=None)  # each writes a file
@given(
    lies=st.fixed_dictionaries(
        {},
        optional={
            "height": st.integers(0, 2**32 - 1),
            "width": st.integers(0, 2**32 - 1),
            "point_step": st.integers(0, 2**32 - 1),
            "is_bigendian": st.booleans(),
            "data": st.binary(max_size=200).map(lambda data: np.frombuffer(data, np.uint8)),
        },
    )
)
def test_a_cloud_that_lies_is_no_surface(
    lies: dict[str, Any], scene: Scene, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever it says of itself, the map is shown."""
    path = write_truth(tmp_path_factory.mktemp("lies") / "truth.mcap", grid(), **lies)
    truth = Truth.of(open_log([path]), scene.built.registered.trajectory, scene.mesh.vertices)
    assert truth is not None
    assert truth.surface is None or truth.surface.shape[2] == 3
