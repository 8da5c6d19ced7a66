"""The least-squares problem that the register room's factors fill, against dense numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from garbi_map.register.normal_equations import RUN, NormalEquations, Run, Tail, spline_run
from garbi_map.register.spline import UniformSpline


@settings(deadline=None, max_examples=30)
@given(st.integers(RUN, 60), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_the_solution_is_that_of_dense_least_squares(size, blocks, seed):
    """Runs that overlap, and runs on the same unknowns, add up as the rows of a matrix do."""
    random = np.random.default_rng(seed)
    n = 4 * size
    starts = [random.permutation(n) % (size - RUN + 1) for _ in range(blocks)]  # every unknown is touched four times
    runs = [Run(start, random.normal(0, 1, (n, RUN))) for start in starts]
    dense = np.zeros((n, size))
    for run in runs:
        np.add.at(dense, (np.arange(n)[:, None], run.start[:, None] + np.arange(RUN)), run.value)
    residual, sigma = random.normal(0, 1, n), random.uniform(0.5, 2.0, n)
    problem = NormalEquations(size)
    weight = problem.add(residual, sigma, runs)
    assert weight == pytest.approx(1 / sigma**2)
    expected = np.linalg.lstsq(dense / sigma[:, None], -residual / sigma, rcond=None)[0]
    assert problem.solve() == pytest.approx(expected, abs=1e-5)
    assert problem.covariance() == pytest.approx(
        np.linalg.inv(dense.T @ (dense / sigma[:, None] ** 2)), rel=1e-4, abs=1e-6
    )


@settings(deadline=None, max_examples=20)
@given(st.integers(RUN, 40), st.integers(1, 5), st.integers(0, 2), st.integers(0, 2**32 - 1))
def test_a_tail_is_as_good_as_columns_of_a_matrix(size, width, blocks, seed):
    """Rows that also touch a few unknowns at the end, in any order, with or without runs."""
    random = np.random.default_rng(seed)
    n, whole = 4 * (size + width), size + width
    runs = [Run(random.integers(0, size - RUN + 1, n), random.normal(0, 1, (n, RUN))) for _ in range(blocks)]
    tail = Tail(size + random.permutation(width), random.normal(0, 1, (n, width)))
    dense = np.zeros((n, whole))
    for run in runs:
        np.add.at(dense, (np.arange(n)[:, None], run.start[:, None] + np.arange(RUN)), run.value)
    dense[:, tail.columns] += tail.value
    residual, sigma = random.normal(0, 1, n), random.uniform(0.5, 2.0, n)
    problem = NormalEquations(whole)
    problem.add(residual, sigma, runs, tail=tail)
    weighted = dense / sigma[:, None] ** 2
    assert problem.matrix == pytest.approx(dense.T @ weighted, abs=1e-9)
    assert problem.vector == pytest.approx(weighted.T @ residual, abs=1e-9)
    if blocks:
        assert problem.covariance(tail.columns) == pytest.approx(
            problem.covariance()[np.ix_(tail.columns, tail.columns)], rel=1e-9, abs=1e-12
        )


def test_an_outlier_pulls_less_the_farther_it_is():
    """With Cauchy weights a row of 300 sigma moves the answer less than one of 3, without them a hundred times more."""

    def pulled(off: float, cauchy: float | None) -> float:
        problem = NormalEquations(RUN)
        value = np.zeros((11, RUN))
        value[:, 0] = 1.0
        residual = np.append(np.zeros(10), -off)
        problem.add(residual, 1.0, [Run(np.zeros(11, np.int64), value)], cauchy)
        return float(problem.solve()[0])

    assert pulled(300.0, None) == pytest.approx(100 * pulled(3.0, None), rel=1e-6)
    assert pulled(300.0, 2.0) < 0.1 * pulled(3.0, 2.0) < pulled(3.0, None)


def test_a_row_of_no_weight_says_nothing():
    """An infinite sigma leaves the problem as it was."""
    problem = NormalEquations(RUN)
    problem.add(np.ones(1), np.inf, [Run(np.zeros(1, np.int64), np.ones((1, RUN)))])
    assert not problem.matrix.any() and not problem.vector.any()


def test_a_spline_run_is_the_derivative_of_the_splines_value():
    """axes . spline(t) is the run times the control points it touches."""
    random = np.random.default_rng(1)
    spline = UniformSpline(0.0, 5.0, 0.5)
    control, t, axes = random.normal(0, 1, (spline.size, 3)), random.uniform(0, 5, 20), random.normal(0, 1, (20, 3))
    run = spline_run(*spline.basis(t), axes, offset=7)
    unknowns = np.concatenate([np.zeros(7), control.ravel()])
    by_run = (run.value * unknowns[run.start[:, None] + np.arange(RUN)]).sum(axis=1)
    assert by_run == pytest.approx((axes * spline.value(control, t)).sum(axis=1))
