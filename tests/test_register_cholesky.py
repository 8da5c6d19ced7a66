"""The factor of banded and of full matrices, against dense numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from garbi_map.register.cholesky import Cholesky
from garbi_map.register.cholesky_kernels import factor_envelope, first_entries
from garbi_map.register.motion import Motion, PriorAttitude
from garbi_map.register.normal_equations import NormalEquations


def banded(size: int, band: int, border: int, seed: int) -> np.ndarray:
    """Positive definite; entries within `band` of the diagonal and in the last `border` rows and columns."""
    random = np.random.default_rng(seed)
    rows = np.zeros((4 * size, size))
    for row in rows:
        start = random.integers(0, max(size - border - band, 1))
        row[start : start + band] = random.normal(0, 1, len(row[start : start + band]))
        row[size - border :] = random.normal(0, 1, border)
    return rows.T @ rows + np.eye(size)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 120), st.integers(1, 12), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_it_solves_what_numpy_solves_however_the_unknowns_are_shuffled(size, band, border, seed):
    """One right side or several; a shuffled band is found again by its order."""
    random = np.random.default_rng(seed)
    matrix = banded(size, band, min(border, size), seed)
    shuffle = random.permutation(size)
    shuffled = matrix[np.ix_(shuffle, shuffle)]
    right = random.normal(0, 1, (size, 3))
    found = Cholesky(shuffled.copy(), np.argsort(shuffle))
    assert found.solve(right) == pytest.approx(np.linalg.solve(shuffled, right), rel=1e-7, abs=1e-9)
    assert found.solve(right[:, 0]) == pytest.approx(found.solve(right)[:, 0], rel=1e-12, abs=1e-14)


def test_of_a_band_only_the_band_is_worked_on():
    """The factor fills the envelope and nothing else; a full matrix is left to LAPACK and gives the same."""
    matrix = banded(300, 6, 2, 1)
    order = np.arange(300)
    first, lower = first_entries(matrix, order), np.zeros_like(matrix)
    assert factor_envelope(matrix, order, first, lower)
    assert lower @ lower.T == pytest.approx(matrix, abs=1e-9)
    assert np.count_nonzero(lower) <= (order - first + 1).sum() < 0.05 * matrix.size
    right, shuffled = np.linspace(-1, 1, 300), np.random.default_rng(2).permutation(300)
    assert Cholesky(matrix.copy(), order).solve(right) == pytest.approx(
        Cholesky(matrix.copy(), shuffled).solve(right), rel=1e-9
    )


@pytest.mark.parametrize("size", [3, 400])
def test_a_matrix_that_is_not_positive_definite_is_refused(size):
    """Narrow or full."""
    matrix = np.diag(np.r_[np.ones(size - 1), -1.0])
    with pytest.raises(np.linalg.LinAlgError):
        Cholesky(matrix, np.arange(size))


def test_neighbours_in_time_are_a_narrow_band_whatever_the_two_splines_spacing():
    """In a motion's order what 0.4 s share stays within a second's unknowns; the constants come last."""
    prior = PriorAttitude(np.array([0.0, 60.0]), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
    motion = Motion(0.0, 60.0, prior, 0.2, 1.0)
    assert sorted(motion.order) == list(range(motion.size))
    problem = NormalEquations(motion.size, motion.order)
    axes = np.random.default_rng(0).normal(0, 1, (3000, 3))
    t = np.linspace(0.0, 59.6, 3000)
    both = motion.rows(t).position(axes).rotation(axes) + motion.rows(t + 0.4).position(axes).rotation(axes)
    problem.add(np.zeros(3000), 1.0, both.runs)
    width = np.arange(motion.size) - first_entries(problem.matrix, motion.order)
    assert width.max() <= 3 * (0.4 + 4 * 1.0) * (1 / 0.2 + 1 / 1.0) + 24
