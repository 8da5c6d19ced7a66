"""Poses between poses, and profiles at their own pose."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from synthetic_navigation import MOUNTS, stamps

from garbi_map.navigate import Trajectory, deskew, place
from garbi_map.sweep.types import Sweep


def some_trajectory(seed: int, count: int = 6) -> Trajectory:
    random = np.random.default_rng(seed)
    root = random.normal(0, 0.1, (count, 6, 6))
    return Trajectory(
        np.cumsum(random.integers(1_000_000, 50_000_000, count)),
        random.normal(0, 1, (count, 3)),
        Rotation.random(count, rng=random).as_quat(),
        root @ root.transpose(0, 2, 1),
    )


def some_sweep(seed: int, at: np.ndarray, per_profile: int = 40) -> Sweep:
    random = np.random.default_rng(seed)
    profile = np.repeat(np.arange(len(at)), per_profile).astype(np.int32)
    count = len(profile)
    return Sweep(
        0,
        at,
        np.zeros(len(at)),
        random.normal(0, 1, (count, 3)),
        np.full(count, 1e-3, np.float32),
        np.zeros(count, np.float32),
        profile,
        np.zeros(count, np.int32),
    )


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_trajectory_at_its_own_stamps_is_itself(seed: int) -> None:
    """Interpolating where there is a pose changes nothing."""
    path = some_trajectory(seed)
    same = path.at(path.stamp_ns)
    assert np.allclose(same.position, path.position)
    assert np.allclose((same.rotation * path.rotation.inv()).magnitude(), 0.0, atol=1e-7)
    assert np.allclose(same.covariance, path.covariance)


@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
@settings(max_examples=30, deadline=None)
def test_between_two_poses_the_turn_is_even(seed: int, share: float) -> None:
    """On the great arc the angle from the first pose grows with time; positions lie on the chord."""
    path = some_trajectory(seed, 2)
    at = path.stamp_ns[0] + int(share * (path.stamp_ns[1] - path.stamp_ns[0]))
    exact = (at - path.stamp_ns[0]) / (path.stamp_ns[1] - path.stamp_ns[0])
    middle = path.at(np.array([at]))
    whole = (path.rotation[0].inv() * path.rotation[1]).magnitude()
    assert np.isclose((path.rotation[0].inv() * middle.rotation[0]).magnitude(), exact * whole, atol=1e-6)
    assert np.allclose(middle.position[0], path.position[0] * (1 - exact) + path.position[1] * exact)


def test_the_ends_are_held() -> None:
    """Beyond the first and the last pose nothing is extrapolated; a single pose holds for ever."""
    path = some_trajectory(1)
    far = path.at(np.array([path.stamp_ns[0] - 10**9, path.stamp_ns[-1] + 10**9]))
    assert np.allclose(far.position, path.position[[0, -1]])
    single = Trajectory(path.stamp_ns[:1], path.position[:1], path.quaternion[:1], path.covariance[:1])
    assert np.allclose(single.at(path.stamp_ns).position, path.position[0])
    assert len(path.at(np.empty(0, np.int64)).position) == 0


def test_points_are_placed_by_the_pose_of_their_profile() -> None:
    """Against the product with each profile's own matrix, one by one."""
    path = some_trajectory(2).mounted(MOUNTS["rig"])
    sweep = some_sweep(2, path.stamp_ns[:-1] + 400_000)
    poses = path.at(sweep.stamp_ns)
    expected = [
        poses.rotation[k].apply(p) + poses.position[k] for p, k in zip(sweep.points, sweep.profile, strict=True)
    ]
    assert np.allclose(place(sweep, path), expected, atol=1e-12)


def test_deskewed_points_placed_from_the_reference_are_the_placed_points() -> None:
    """deskew takes out the motion inside the sweep and nothing else."""
    path = some_trajectory(3)
    sweep = some_sweep(3, path.stamp_ns)
    reference = int(path.stamp_ns[2]) + 1000
    pose = path.at(np.array([reference]))
    from_reference = pose.rotation[0].apply(deskew(sweep, path, reference)) + pose.position[0]
    assert np.allclose(from_reference, place(sweep, path), atol=1e-9)


def test_a_still_vehicle_needs_no_deskew() -> None:
    """All poses equal: the points stay where they are."""
    at = stamps(2.0, 20.0)
    count = len(at)
    still = Trajectory(
        at, np.tile([1.0, 2.0, 3.0], (count, 1)), np.tile([0.0, 0.6, 0.0, 0.8], (count, 1)), np.zeros((count, 6, 6))
    )
    sweep = some_sweep(4, at)
    assert np.allclose(deskew(sweep, still, int(at[7])), sweep.points, atol=1e-12)


def test_an_empty_sweep_stays_empty() -> None:
    """Nothing visible: no points, no error."""
    path = some_trajectory(5)
    assert place(some_sweep(5, path.stamp_ns, per_profile=0), path).shape == (0, 3)
