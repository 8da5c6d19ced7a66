"""Flat patches as evidence about a rig: their rows, where they are seen, and what a file may say of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.field_known import Flat, Known, flats, load_known
from garbi_map.calibrate.field_views import Views
from garbi_map.errors import GarbiError
from garbi_map.register.constants import Constant
from garbi_map.register.motion import Motion, PriorAttitude
from garbi_map.register.normal_equations import NormalEquations


def moving(seed: int) -> Motion:
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_euler("xyz", [0.1, -0.2, 0.5]).as_quat()[None]
    constants = [Constant("plane_0", 0.1, "1", 3), Constant("rig_0", 1.0, "1")]
    motion = Motion(0.0, 2.0, PriorAttitude(np.zeros(1), attitude), 0.5, 1.0, constants)
    motion.position_control[:] = 0.1 * rng.normal(size=motion.position_control.shape)
    motion.attitude_control[:] = 0.02 * rng.normal(size=motion.attitude_control.shape)
    motion.constants.value[:] = [0.02, -0.03, 0.01, 0.5]
    return motion


def test_a_step_changes_the_residuals_as_the_rows_say():
    """To first order in the motion, in the plane, and in what moves the points."""
    rng = np.random.default_rng(2)
    n = 40
    base, way = rng.normal(size=(n, 3)), 0.01 * rng.normal(size=(n, 3))
    when = rng.uniform(0.1, 1.9, n)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flat = Flat("plane_0", np.arange(n), 0.05, 5e-4, np.array([0.1, 0.2, -0.3]), axes)
    moved = np.zeros((n, 4, 1))
    moved[:, :3, 0] = way

    def problem(motion: Motion) -> tuple[np.ndarray, NormalEquations]:
        added = NormalEquations(motion.size)
        points = base + motion.constants.number("rig_0") * way
        return flat.add(added, motion, when, points, np.full(n, 1e6), moved), added

    motion = moving(1)
    before, added = problem(motion)
    gradient = added.vector * (1e12 + 25e-8)
    for k in range(motion.size):
        step = np.zeros(motion.size)
        step[k] = 1e-6
        ends = []
        for side in (1.0, -1.0):
            other = moving(1)
            other.step(side * step)
            ends.append(problem(other)[0])
        slope = (ends[0] - ends[1]) / 2e-6
        # the rows of the attitude are those of a turn in map axes, of its vector to first order in theta
        tolerance = 0.03 if motion.attitude_offset <= k < motion.constants_offset else 1e-4
        assert gradient[k] == pytest.approx(slope @ before, abs=tolerance * np.abs(gradient).max() + 1e-9)


def test_a_patch_is_where_its_seconds_and_rows_are_and_faces_the_camera(tmp_path):
    """Its plane is fitted; a second patch is on the same plane, so much nearer; too few points are refused."""
    file = tmp_path / "known.yaml"
    file.write_text(
        "- {from: 0.0, to: 1.0, rows: [0, 99]}\n- {from: 0.0, to: 1.0, rows: [200, 299], of: 0, height: 0.08}\n"
    )
    patches = load_known(file)
    n = 3000
    rng = np.random.default_rng(5)
    views = Views(
        np.zeros(n), rng.uniform(0, 300, n), np.full(n, 1e-4, np.float32), np.arange(n, dtype=np.int32) % 20,
        np.arange(20) * 100_000_000, np.zeros(20, np.int64),
    )  # fmt: skip
    points = np.column_stack([rng.uniform(-1, 1, (n, 2)), np.zeros(n)])
    cameras = np.tile([0.0, 0.0, 1.5], (n, 1))
    first, second = flats(patches, views, 0, lambda which: (points[which], cameras[which]))
    assert np.abs(first.axes[:, 2]) == pytest.approx([0, 0, 1]) and first.axes[2, 2] > 0
    assert (views.v[first.point] < 100).all() and (views.profile[first.point] <= 10).all()
    assert second.name == first.name == "plane_0" and second.height == 0.08 and (views.v[second.point] > 199).all()
    known = Known(patches, 1_000)
    assert known.names == ["plane_0"] and known.tells_lengths
    assert known.within(0, 2_000) is known and not known.within(2_000, 3_000).patches
    with pytest.raises(GarbiError, match="known patch 0: 0 points"):
        flats(patches, views, 10_000_000_000, lambda which: (points[which], cameras[which]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("- {from: 2.0, to: 1.0, rows: [0, 9]}", "from must be before to"),
        ("- {from: 0.0, to: 1.0, rows: [0, 9], height: 0.1}", "height needs of"),
        ("- {from: 0.0, to: 1.0, rows: [0, 9], of: 0}", "0.of: expected the number of an earlier patch"),
        ("- {from: 0.0, rows: [0, 9]}", "0.to: Field required"),
        ("[", "not YAML"),
    ],
)
def test_a_file_that_says_something_else_is_refused_in_one_line(tmp_path, text, says):
    """With its name."""
    file = tmp_path / "known.yaml"
    file.write_text(text)
    with pytest.raises(GarbiError, match=says) as raised:
        load_known(file)
    assert "known.yaml" in str(raised.value) and "\n" not in str(raised.value)
