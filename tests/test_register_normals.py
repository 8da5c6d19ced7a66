"""Normals of matched surfels: slopes are kept, noise is not taken for slopes."""

from __future__ import annotations

import numpy as np
import pytest

from garbi_map.register.normals import common_normals

N, GROUPS = 4000, 20


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def two_looks(true: np.ndarray, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The normals as two sweeps measure them, and groups."""
    random = np.random.default_rng(seed)
    first, second = (unit(true + random.normal(0, noise, true.shape)) for _ in range(2))
    return first, second, np.arange(N) % GROUPS


def slopes(across: float, along: float) -> np.ndarray:
    random = np.random.default_rng(9)
    return unit(np.column_stack([random.normal(0, across, N), random.normal(0, along, N), np.ones(N)]))


def test_a_level_floor_has_one_normal():
    """What the plain mean takes for 1.4 mrad of slopes is noise to a hundredth, in the sum of squares that counts."""
    first, second, group = two_looks(slopes(0.0, 0.0), 0.002)
    found = common_normals(first, second, group)
    plain = unit(first + second)
    assert (found[:, :2].std(axis=0) ** 2 < 0.01 * plain[:, :2].std(axis=0) ** 2).all()
    assert found == pytest.approx(np.tile([0.0, 0.0, 1.0], (N, 1)), abs=5e-4)


def test_slopes_are_kept():
    """Where the floor is rough the normals are the mean of the two, but for a few per mille."""
    first, second, group = two_looks(slopes(0.2, 0.2), 0.005)
    assert common_normals(first, second, group) == pytest.approx(unit(first + second), abs=5e-3)


def test_ripples_tell_of_one_direction_only():
    """Slopes along y stay, the noise along x goes."""
    first, second, group = two_looks(slopes(0.0, 0.2), 0.005)
    found = common_normals(first, second, group)
    assert found[:, 1] == pytest.approx(unit(first + second)[:, 1], abs=5e-3)
    assert found[:, 0].std() < 1e-3


def test_few_matches_keep_their_normal():
    """One match alone in the world: the mean of its two."""
    first, second = unit(np.array([[0.1, 0.0, 1.0]])), unit(np.array([[0.1, 0.02, 1.0]]))
    assert common_normals(first, second, np.array([7])) == pytest.approx(unit(first + second))
