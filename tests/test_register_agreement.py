"""What is said of overlapping sweeps before and after: known offsets come back, doubled surfaces raise the entropy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from seabed_scene import plane, scan

from garbi_map.log.records import Mount
from garbi_map.navigate.kernels import place_points
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register.agreement import ENTROPY_RADIUS, compare_placements, pair_distances
from garbi_map.register.entropy import Balls
from garbi_map.register.surfels import Surfels, extract_surfels, join
from garbi_map.sweep.store import SweepStore

OFFSET = 0.003
"""m, upward, of the second sweep as navigation places it."""
LIFT = np.array([0.0, 0.0, OFFSET])


def entropy(points: np.ndarray, centres: np.ndarray, radius: float = ENTROPY_RADIUS) -> np.ndarray:
    """At once."""
    balls = Balls(centres, radius)
    balls.add(points)
    return balls.entropy()


def test_the_entropy_of_a_gaussian_cloud_is_its_formula() -> None:
    """1.5 ln(2 pi e sigma^2) for an isotropic cloud well inside the radius."""
    sigma = 0.002
    points = np.random.default_rng(0).normal([5.0, -3.0, -40.0], sigma, (200_000, 3))
    (found,) = entropy(points, np.array([[5.0, -3.0, -40.0]]), 8 * sigma)
    assert found == pytest.approx(1.5 * np.log(2 * np.pi * np.e * sigma**2), abs=0.01)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), radius=st.floats(0.01, 0.3), pieces=st.integers(1, 5))
def test_balls_hold_what_a_tree_finds(seed: int, radius: float, pieces: int) -> None:
    """The covariance of the points within the radius, whatever pieces they come in, far from the origin too."""
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-100, 100, 3)
    points = origin + rng.uniform(-0.3, 0.3, (400, 3))
    centres = origin + rng.uniform(-0.3, 0.3, (30, 3))
    balls = Balls(centres, radius)
    for piece in np.array_split(points, pieces):
        balls.add(piece)
    tree = cKDTree(points)
    for found, near in zip(balls.entropy(), tree.query_ball_point(centres, radius), strict=True):
        if len(near) < 10:
            assert np.isnan(found)
        else:
            covariance = np.cov(points[near].T, bias=True)
            assert found == pytest.approx(0.5 * np.linalg.slogdet(2 * np.pi * np.e * covariance)[1], abs=1e-6)


def test_a_doubled_surface_has_more_entropy() -> None:
    """The farther its two copies are apart, the more, while both are within the radius."""
    rng = np.random.default_rng(3)
    sheet = np.c_[rng.uniform(0, 0.2, (40_000, 2)), rng.normal(0, 2e-4, 40_000)]
    centres = np.c_[rng.uniform(0.05, 0.15, (50, 2)), np.zeros(50)]
    means = []
    for gap in (0.0, 0.001, 0.002, 0.004):
        sheet[::2, 2] += gap
        means.append(entropy(sheet, centres).mean())
        sheet[::2, 2] -= gap
    assert np.all(np.diff(means) > 0.3)


@pytest.fixture(scope="module")
def doubled(tmp_path_factory: pytest.TempPathFactory) -> tuple[SweepStore, Trajectory, Trajectory, Surfels, Surfels]:
    """Two sweeps of one slope: navigation has the second OFFSET too high, the map has both right."""
    store = SweepStore(tmp_path_factory.mktemp("doubled"))
    poses, after, before = [], [], []
    for index in range(2):
        sweep, pose = scan(plane, index, profiles=60, rows=200, sigma=1e-4)
        store.add(sweep)
        poses.append(pose)
        placed = place_points(sweep.points, sweep.profile, pose.rotation.as_matrix(), pose.position)
        surfels = extract_surfels(
            placed,
            sweep.sigma,
            sweep.profile,
            (sweep.stamp_ns - poses[0].stamp_ns[0]) * 1e-9,
            np.full(60, index),
            pose.position,
            0.03,
            8,
        )
        after.append(surfels)
        before.append(replace(surfels, mean=surfels.mean + index * LIFT))
    store.finish([])
    right = Trajectory(*(np.concatenate([getattr(p, name) for p in poses]) for name in Trajectory.__dataclass_fields__))
    lift = np.zeros((120, 3))
    lift[60:, 2] = OFFSET
    wrong = replace(right, position=right.position + lift)
    return store, wrong, right, join(*before), join(*after)


def test_a_known_offset_comes_back_everywhere(doubled) -> None:
    """The distance along the normal, at every place of the slope; none is left afterwards."""
    _, _, _, before, after = doubled
    place, apart, left = pair_distances(before, after)
    normal = 1 / np.hypot(1, 0.2)
    assert apart == pytest.approx(np.full(len(apart), OFFSET * normal), abs=4e-4)
    assert np.median(left) < 1e-4
    assert len(np.unique(np.round(place, 1), axis=0)) > 30  # all over the 0.6 m by 0.6 m


def test_the_same_pairs_are_compared_however_far_navigation_is_off(doubled) -> None:
    """Half a metre is reported as such: matched anew, the surfels would find no partner, or a wrong one."""
    _, _, _, _, after = doubled
    lift = np.where(after.sweep == 1, 0.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    _, apart, _ = pair_distances(replace(after, mean=after.mean + lift), after)
    assert np.median(apart) == pytest.approx(0.5 / np.hypot(1, 0.2), rel=1e-3)


def test_the_agreement_of_a_store_tells_both(doubled) -> None:
    """Median distance and entropy, before and after; the second is what the sheet's own noise leaves."""
    store, wrong, right, before, after = doubled
    found = compare_placements(store, Mount(), wrong, right, before, after)
    assert found.median[0] == pytest.approx(OFFSET / np.hypot(1, 0.2), rel=0.02)
    assert found.median[1] < 1e-4
    assert found.entropy[0] > found.entropy[1] + 1.0


def test_sweeps_that_do_not_overlap_have_no_agreement(doubled) -> None:
    """Neither pairs nor a median; the entropy of what each saw is there."""
    store, _, right, _, after = doubled
    alone = after.select(after.sweep == 0)
    found = compare_placements(store, Mount(), right, right, alone, alone)
    assert len(found.after) == 0 and np.isnan(found.median).all()
    assert np.isfinite(found.entropy).all()
