"""Surfels and their matches: what a patch says, what has none, and which patches are the same place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from garbi_map.register import kernels
from garbi_map.register.surfels import Surfels, extract_surfels, join, match_surfels
from garbi_map.register.thinning import earliest

SEEDS = st.integers(0, 2**32 - 1)


def extract(points: np.ndarray, size: float = 0.1, fewest: int = 8, sweep: np.ndarray | None = None) -> Surfels:
    """Surfels of points that a camera 1.5 m above the origin saw at time 0."""
    n = len(points)
    camera = np.tile([0.0, 0.0, 1.5], (n, 1))
    number = np.zeros(n, np.int64) if sweep is None else sweep
    return extract_surfels(points, np.full(n, 1e-3), np.arange(n), np.zeros(n), number, camera, size, fewest)


@pytest.mark.parametrize("seed", range(3))
def test_a_plane_gives_its_normal_toward_the_camera(seed):
    """4 cm voxels, 0.5 mm noise: each normal within what the noise over the patch allows, each mean on the plane."""
    random = np.random.default_rng(seed)
    across = random.uniform(-0.3, 0.3, (20_000, 2))
    slope = random.uniform(-0.3, 0.3, 2)
    points = np.column_stack([across, across @ slope + random.normal(0, 5e-4, len(across))])
    true = np.array([*-slope, 1.0]) / np.linalg.norm([*slope, 1.0])
    surfels = extract(points, 0.04, 30)
    assert len(surfels.mean) > 100
    angle = np.arccos(np.clip(surfels.normal @ true, -1.0, 1.0))  # below 90 deg only if it points to the camera
    assert np.median(angle) < 2 * 5e-4 / (0.04 / np.sqrt(12)) / np.sqrt(40)
    assert np.abs(surfels.mean @ true).max() < 5e-4
    assert np.median(surfels.thickness) == pytest.approx(5e-4, rel=0.2)


def test_lines_edges_blobs_and_few_points_give_no_surfel():
    """A profile alone is a line, a right-angled edge two planes, a blob none; seven points are too few."""
    random = np.random.default_rng(0)
    along = random.uniform(0.01, 0.09, 200)
    line = np.column_stack([along, np.full(200, 0.05), np.full(200, 0.05)]) + random.normal(0, 5e-4, (200, 3))
    height = np.abs(along - 0.05)
    edge = np.column_stack([along, random.uniform(0.01, 0.09, 200), 0.09 - height])
    blob = random.uniform(0.01, 0.09, (200, 3))
    few = np.column_stack([random.uniform(0.01, 0.09, (7, 2)), np.full(7, 0.05)])
    for points in (line, edge, blob, few, np.empty((0, 3)), np.full((50, 3), 0.05)):
        assert len(extract(points).mean) == 0


def test_a_surfel_is_made_of_one_sweep_only():
    """Two sweeps of the same voxel give two surfels, each where its own points are."""
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(0.01, 0.09, (200, 2)), np.repeat([0.03, 0.06], 100)])
    surfels = extract(points, sweep=np.repeat([3, 8], 100))
    assert surfels.sweep.tolist() == [3, 8]
    assert surfels.mean[:, 2] == pytest.approx([0.03, 0.06])


def test_sure_points_weigh_more():
    """Mean and time are those of the points weighted with 1 / sigma^2."""
    random = np.random.default_rng(4)
    points = np.column_stack([random.uniform(0.01, 0.09, (50, 2)), np.full(50, 0.05)])
    sigma, time = random.uniform(1e-3, 1e-2, 50), random.uniform(0, 1, 50)
    camera = np.tile([0.0, 0.0, 1.0], (50, 1))
    surfels = extract_surfels(points, sigma, np.arange(50), time, np.zeros(50, np.int64), camera, 0.1, 8)
    assert surfels.mean[0] == pytest.approx(np.average(points, axis=0, weights=sigma**-2))
    assert surfels.time[0] == pytest.approx(np.average(time, weights=sigma**-2))


@settings(deadline=None, max_examples=50)
@given(SEEDS, st.integers(0, 200), st.floats(0.01, 1.0))
def test_voxel_groups_are_those_of_numpy(seed, n, size):
    """Same group if and only if same sweep and same floor(point / size), numbered as they appear."""
    random = np.random.default_rng(seed)
    points, sweep = random.uniform(-2, 2, (n, 3)), random.integers(0, 4, n)
    group, group_sweep = np.empty(n, np.int64), np.empty(n, np.int64)
    count = kernels.group_by_voxel(points, np.arange(len(points)), sweep, size, group, group_sweep)
    keys = np.column_stack([np.floor(points / size).astype(np.int64), sweep])
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    by_appearance = np.argsort(np.argsort(first))
    assert count == len(first)
    assert (group == by_appearance[inverse]).all()
    assert (group_sweep[group] == sweep).all()


@settings(deadline=None, max_examples=100)
@given(SEEDS, st.floats(-8, 0), st.floats(-8, 0), st.floats(1e-6, 1e3))
def test_eigenvalues_and_the_first_eigenvector_are_those_of_numpy(seed, flat, narrow, scale):
    """From blobs to needles and sheets: values to rounding, the vector to what its gap allows."""
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    matrix = turn @ np.diag([10.0**flat, 10.0**narrow, 1.0]) @ turn.T * scale
    matrix = (matrix + matrix.T) / 2
    values, normal = np.empty((1, 3)), np.empty((1, 3))
    kernels.smallest_eigenvectors(matrix[np.triu_indices(3)][None], values, normal)
    expected, vectors = np.linalg.eigh(matrix)
    assert values[0] == pytest.approx(expected, abs=1e-7 * scale)
    assert np.isfinite(normal).all()
    gap = (expected[1] - expected[0]) / scale
    if gap > 1e-4:
        # Smith's formula leaves an error of sqrt(eps) in the worst case, two equal large values
        assert abs(normal[0] @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-5)


def test_equal_eigenvalues_give_a_finite_answer():
    """A ball has no direction: the vertical is as good as any."""
    values, normal = np.empty((1, 3)), np.empty((1, 3))
    kernels.smallest_eigenvectors(np.array([[2.0, 0, 0, 2.0, 0, 2.0]]), values, normal)
    assert values.tolist() == [[2.0, 2.0, 2.0]] and normal.tolist() == [[0.0, 0.0, 1.0]]


def some_surfels(random: np.random.Generator, n: int) -> Surfels:
    normal = random.normal(0, 0.35, (n, 3)) + np.array([0.0, 0.0, 1.0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Surfels(
        random.uniform(-0.15, 0.15, (n, 3)), normal, random.uniform(0, 10, n), random.integers(0, 5, n), np.zeros(n)
    )


@settings(deadline=None, max_examples=40)
@given(SEEDS, st.integers(0, 60), st.floats(0.02, 0.2), st.floats(0.1, 12.0))
def test_matches_are_those_of_trying_every_pair(seed, n, gate, longest):
    """For each surfel the nearest of every later sweep within gate, time and angle; never its own sweep's."""
    surfels = some_surfels(np.random.default_rng(seed), n)
    first, second = match_surfels(surfels, gate, longest)
    expected = set()
    for i in range(n):
        for later in range(surfels.sweep[i] + 1, 5):
            distance = np.linalg.norm(surfels.mean - surfels.mean[i], axis=1)
            allowed = (surfels.sweep == later) & (distance <= gate)
            allowed &= np.abs(surfels.time - surfels.time[i]) <= longest
            allowed &= surfels.normal @ surfels.normal[i] >= np.cos(np.deg2rad(25.0))
            if allowed.any():
                expected.add((i, int(np.argmin(np.where(allowed, distance, np.inf)))))
    assert set(zip(first.tolist(), second.tolist(), strict=True)) == expected
    assert len(first) == len(expected)


def test_a_place_seen_by_many_sweeps_has_all_its_matches():
    """Sixty sweeps of one place: 59 + 58 + ... pairs, more than are first made room for."""
    n = 90
    surfels = Surfels(np.zeros((n, 3)), np.tile([0, 0, 1.0], (n, 1)), np.zeros(n), np.arange(n), np.zeros(n))
    first, second = match_surfels(surfels, 0.01, 1.0)
    assert len(first) == n * (n - 1) // 2
    assert (first < second).all()


def test_surfels_move_with_their_sweep():
    """A transform for each sweep; joining and leaving out keep the rest as it is."""
    surfels = some_surfels(np.random.default_rng(1), 30)
    transforms = np.tile(np.eye(4), (5, 1, 1))
    transforms[2, :3, :3] = Rotation.from_rotvec([0, 0, 0.3]).as_matrix()
    transforms[2, :3, 3] = [1.0, 2.0, 3.0]
    moved = surfels.moved(transforms)
    there = surfels.sweep == 2
    assert moved.mean[there] == pytest.approx(
        Rotation.from_rotvec([0, 0, 0.3]).apply(surfels.mean[there]) + transforms[2, :3, 3]
    )
    assert (moved.mean[~there] == surfels.mean[~there]).all()
    apart = surfels.without(np.array([2]))
    assert len(apart.mean) == (~there).sum()
    assert len(join(apart, surfels.select(there)).mean) == 30


def test_no_surfels_are_moved_to_no_surfels():
    """A dive on which nothing planar was seen has no sweeps to move either."""
    nothing = some_surfels(np.random.default_rng(0), 0)
    assert len(nothing.moved(np.empty((0, 4, 4))).mean) == 0
    assert all(len(rows) == 0 for rows in match_surfels(nothing, 0.05, np.inf))


def test_a_place_that_many_sweeps_saw_is_remembered_a_few_times() -> None:
    """Of every voxel all surfels of the first sweeps that saw it, whatever their order; every voxel keeps some."""
    random = np.random.default_rng(5)
    n = 4000
    mean = random.uniform(0, 0.3, (n, 3)) * [1, 1, 0.1]
    surfels = Surfels(mean, np.tile([0.0, 0, 1], (n, 1)), np.zeros(n), random.integers(0, 30, n), np.zeros(n))
    kept = earliest(surfels, 0.05, 4)
    voxel = np.unique(np.floor(mean / 0.05).astype(int), axis=0, return_inverse=True)[1].ravel()
    for place in range(voxel.max() + 1):
        here = voxel == place
        first = np.unique(surfels.sweep[here])[:4]
        assert (kept[here] == np.isin(surfels.sweep[here], first)).all()


def test_only_surfels_that_are_asked_are_the_earlier_of_a_pair() -> None:
    """The pairs are those of all surfels that begin with one that was asked."""
    random = np.random.default_rng(6)
    n = 500
    surfels = Surfels(
        random.uniform(0, 0.4, (n, 3)) * [1, 1, 0.01],
        np.tile([0.0, 0, 1], (n, 1)),
        random.uniform(0, 9, n),
        random.integers(0, 6, n),
        np.zeros(n),
    )
    asked = random.uniform(size=n) < 0.3
    every = set(zip(*(part.tolist() for part in match_surfels(surfels, 0.05, np.inf)), strict=True))
    some = set(zip(*(part.tolist() for part in match_surfels(surfels, 0.05, np.inf, asked)), strict=True))
    assert some == {(a, b) for a, b in every if asked[a]} and len(some) > 50
