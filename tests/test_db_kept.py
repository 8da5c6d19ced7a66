"""What a stage leaves on disk comes back bit for bit, or counts as never written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from garbi_map.db import keep, recall
from garbi_map.db.submaps import Pose, read_moving, read_submap, write_submap
from garbi_map.errors import GarbiError
from garbi_map.seabed import JudgedPoints, Points
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore


@dataclass(frozen=True)
class Result:
    """Something that a stage found."""

    numbers: np.ndarray
    more: object


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
    max_leaves=12,
)


@settings(max_examples=30, deadline=None)
@given(plain)
def test_anything_plain_comes_back(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    """Numbers to the bit, tuples as tuples, whatever is nested in what."""
    path = tmp_path_factory.mktemp("kept") / "result.npz"
    keep(path, Result(np.arange(3.0), value))
    found = recall(path, [Result])
    np.testing.assert_array_equal(found.numbers, [0, 1, 2])
    assert found.more == value and type(found.more) is type(value)


def test_what_is_not_there_cut_or_of_another_kind_is_none(tmp_path: Path) -> None:
    """Then the stage runs again; nothing in the file is ever run as code."""
    path = tmp_path / "result.npz"
    assert recall(path, [Result]) is None
    keep(path, Result(np.zeros(9), "x"))
    assert recall(path, []) is None
    path.write_bytes(path.read_bytes()[:-40])
    assert recall(path, [Result]) is None
    path.write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    assert recall(path, [Result]) is None


def judged(count: int, seed: int) -> JudgedPoints:
    """Points of one sweep."""
    rng = np.random.default_rng(seed)
    sigma, grey = rng.uniform(1e-4, 1e-3, count).astype(np.float32), rng.uniform(0, 255, count).astype(np.float32)
    stamps = np.sort(rng.integers(0, 10**9, count)) + 1_790_000_000_000_000_000
    points = rng.uniform(-3, 3, (count, 3)) + np.array([40.0, -30.0, -12.0])
    moving = Points(stamps[:5], points[:5] + 0.5, sigma[:5], grey[:5])
    noise, pose = rng.uniform(1e-8, 1e-7, count), rng.uniform(1e-5, 1e-4, count)
    gradient = rng.normal(size=(count, 2))
    return JudgedPoints(
        stamps, points, sigma, grey, np.zeros(count, np.uint8), moving, gradient=gradient, noise=noise, pose=pose
    )


def test_submap_comes_back_to_ten_micrometres_and_is_the_same_file_twice(tmp_path: Path) -> None:
    """Points, stamps and what fusion needs, sweep by sweep; two writings do not differ in a byte."""
    sweeps = [(4, judged(50, 1)), (5, judged(30, 2))]
    parts = [(index, points, points.points + np.array([0.0, 0.0, 1.3])) for index, points in sweeps]
    written, again = (write_submap(tmp_path / name, "one", parts) for name in ("a", "b"))
    for file, other in zip(written.files, again.files, strict=True):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / other).read_bytes()
    pose = Pose.of(np.eye(4), written.frame)
    submap = read_submap(tmp_path / "a" / written.file)
    found = list(submap.sweeps(pose))
    np.testing.assert_allclose(pose.apply(submap.origin)[:50], parts[0][2], atol=6e-6)
    for one, (_, true) in zip(found, sweeps, strict=True):
        np.testing.assert_allclose(one.points, true.points, atol=6e-6)
        np.testing.assert_array_equal(one.stamp_ns, true.stamp_ns)
        np.testing.assert_allclose(one.noise, true.noise, rtol=1e-6)
        np.testing.assert_allclose(one.gradient, true.gradient, rtol=1e-6)
        np.testing.assert_allclose(one.intensity, true.intensity, atol=1 / 256)
    moving = read_moving(tmp_path / "a" / written.moving, pose)
    true_moving = np.concatenate([true.moving.points for _, true in sweeps if true.moving is not None])
    np.testing.assert_allclose(moving.points, true_moving, atol=6e-6)


def test_slopes_turn_with_the_submap(tmp_path: Path) -> None:
    """A quarter turn: what rose along x rises along y."""
    points = judged(3, 3)
    points.gradient[:] = [0.2, 0.0]
    written = write_submap(tmp_path, "one", [(0, points, points.points)])
    quarter = np.eye(4)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    turned = next(read_submap(tmp_path / written.file).sweeps(Pose.of(quarter, written.frame)))
    np.testing.assert_allclose(turned.gradient, np.tile([0.0, 0.2], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(turned.points, points.points @ quarter[:3, :3].T, atol=6e-6)


def test_damaged_submap_is_one_line(tmp_path: Path) -> None:
    """A flipped byte in a page is seen."""
    points = judged(500, 4)
    file = tmp_path / write_submap(tmp_path, "one", [(0, points, points.points)]).file
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 0xFF
    file.write_bytes(data)
    with pytest.raises(GarbiError, match=r"one\.parquet: the map's database is damaged"):
        read_submap(file)


def test_linked_sweeps_change_by_themselves(tmp_path: Path) -> None:
    """The registration sets clocks right in its own copy; a run that is killed there begins again from the same sweeps."""
    sweep = Sweep(
        0, np.arange(3, dtype=np.int64), np.zeros(3), np.ones((4, 3)), np.ones(4, np.float32),
        np.ones(4, np.float32), np.array([0, 0, 1, 2], np.int32), np.zeros(4, np.int32),
    )  # fmt: skip
    store = SweepStore(tmp_path / "sweeps")
    store.add(sweep)
    store.finish(["a loss"])
    own = store.linked(tmp_path / "own")
    own.retime(lambda one: Sweep(**{**vars(one), "points": 2 * one.points}), latency=0.01)
    first, second = SweepStore.open(tmp_path / "sweeps"), SweepStore.open(tmp_path / "own")
    assert first is not None and second is not None
    assert (first.latency, second.latency) == (0.0, 0.01) and second.losses == ["a loss"]
    np.testing.assert_array_equal(first.load(0).points, np.ones((4, 3)))
    np.testing.assert_array_equal(second.load(0).points, 2 * np.ones((4, 3)))
