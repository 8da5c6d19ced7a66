"""Which matches count: those of ground that both sweeps have seen, between sweeps that fit each other."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from garbi_map.register.overlap import _neighbours, fitting, seen_by_both
from garbi_map.register.surfels import Surfels, match_surfels

SIZE = 0.04


def floor(begin: float, end: float, sweep: int, seed: int = 0) -> Surfels:
    """Surfels of a level floor from x = begin to end, a metre wide, one in each voxel, near its middle."""
    x, y = np.meshgrid(np.arange(begin, end, SIZE), np.arange(0.0, 1.0, SIZE), indexing="ij")
    mean = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    mean[:, :2] += np.random.default_rng(seed + sweep).uniform(0.25 * SIZE, 0.75 * SIZE, (x.size, 2))
    up = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    return Surfels(mean, up, np.full(x.size, float(sweep)), np.full(x.size, sweep, np.int64), np.zeros(x.size))


def both(one: Surfels, other: Surfels) -> Surfels:
    return Surfels(*(np.concatenate([getattr(one, name), getattr(other, name)]) for name in one.__dataclass_fields__))


def kept(surfels: Surfels) -> tuple[int, int, np.ndarray]:
    """Matches, those of them that count, and where these are along x."""
    first, second = match_surfels(surfels, 0.06, np.inf)
    counts = seen_by_both(surfels, first, second, SIZE)
    return len(first), int(counts.sum()), surfels.mean[first[counts], 0]


def test_sweeps_that_only_touch_have_next_to_nothing_in_common():
    """Along the seam neighbours lie within the gate of each other; nine in ten of them are told to be different ground."""
    found, counted, _ = kept(both(floor(0.0, 1.0, 0), floor(1.0, 2.0, 1)))
    assert found > 20
    assert counted < 0.1 * found


def test_what_both_have_seen_is_kept():
    """Nearly all of an overlap of half a metre counts, and nothing outside it."""
    _, counted, x = kept(both(floor(0.0, 1.0, 0), floor(0.5, 1.5, 1)))
    assert counted > 0.8 * (0.5 / SIZE) * (1.0 / SIZE)
    assert x.min() > 0.5 - SIZE and x.max() < 1.0 + SIZE


def test_an_island_is_all_edge():
    """A few surfels of a sweep that saw no more there are not matched."""
    island = floor(0.5, 0.5 + SIZE / 2, 1)
    alone = Surfels(*(getattr(island, name)[:2] for name in island.__dataclass_fields__))
    found, counted, _ = kept(both(floor(0.0, 1.0, 0), alone))
    assert found > 0 and counted == 0


@given(st.integers(0, 10_000), st.integers(1, 60))
def test_neighbours_are_those_of_the_same_sweep_within_the_radius(seed, count):
    """Against all distances, one by one."""
    random = np.random.default_rng(seed)
    mean = random.uniform(-0.2, 0.2, (count, 3))
    sweep = random.integers(0, 3, count) * 7
    surfels = Surfels(mean, np.tile([0.0, 0.0, 1.0], (count, 1)), np.zeros(count), sweep, np.zeros(count))
    asked = random.random(count) < 0.8
    offset, number = _neighbours(surfels, asked, 0.07)
    between = mean[None, :] - mean[:, None]
    near = (np.linalg.norm(between, axis=2) <= 0.07) & (sweep[None, :] == sweep[:, None]) & ~np.eye(count, dtype=bool)
    near &= asked[:, None]
    assert (number == near.sum(axis=1)).all()
    np.testing.assert_allclose(offset, (between * near[:, :, None]).sum(axis=1), atol=1e-12)


def test_two_sweeps_that_do_not_fit_are_left_out_whole():
    """Even those of their matches that happen to be near; sweeps that fit keep their outliers, which a kernel weighs."""
    random = np.random.default_rng(1)
    residual = np.concatenate([random.normal(0, 1e-3, 100), random.normal(0, 6e-3, 100)])
    residual[3] = 0.02
    pair = np.repeat([5, 9], 100)
    mixed = random.permutation(200)
    fits = fitting(residual[mixed], pair[mixed], 1e-3)
    assert fits[pair[mixed] == 5].all()
    assert not fits[pair[mixed] == 9].any()
