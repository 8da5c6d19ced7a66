"""A least-squares problem whose rows touch a few runs of neighbouring unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.register import kernels
from garbi_map.register.cholesky import Cholesky

Floats = NDArray[np.float64]

RUN = 12
"""Unknowns in a run: four control points of a cubic spline in three axes."""


@dataclass(frozen=True)
class Run:
    """What n rows have to do with twelve consecutive unknowns each.

    start (n,) first unknown, value (n, 12) derivatives of the rows' residuals.
    """

    start: NDArray[np.int64]
    value: Floats


def spline_run(first: NDArray[np.int64], weights: Floats, axes: Floats, offset: int) -> Run:
    """Rows that depend on `axes` (n, 3) . spline(t), the spline's control points starting at the unknown `offset`.

    first (n,) and weights (n, 4) come from UniformSpline.basis.
    """
    return Run(offset + 3 * first, (weights[:, :, None] * axes[:, None, :]).reshape(len(first), RUN))


@dataclass(frozen=True)
class Tail:
    """What n rows have to do with unknowns that any row may touch: columns (k,), the unknowns, and value (n, k)."""

    columns: NDArray[np.int64]
    value: Floats


class NormalEquations:
    """Accumulates J' W J and J' W r of rows residual + J x = 0 and solves for x."""

    def __init__(self, size: int, order: NDArray[np.int64] | None = None) -> None:
        """order (size,): the unknowns in an order in which those that rows have in common are close; else as they are."""
        self.matrix = np.zeros((size, size))
        self.vector = np.zeros(size)
        self._order = np.arange(size) if order is None else order
        self._factored: Cholesky | None = None

    def add(
        self,
        residual: Floats,
        sigma: Floats | float,
        runs: list[Run],
        cauchy: float | None = None,
        tail: Tail | None = None,
    ) -> Floats:
        """Add n rows with residual (n,), 1 sigma (n,) or scalar, and what they touch; returns the weights (n,).

        cauchy: the residual, in sigmas, beyond which a row loses its say (Cauchy weights by iteration, Holland and Welsch
        1977); None for plain least squares.
        """
        weight = np.broadcast_to(1.0 / np.square(np.asarray(sigma, float)), residual.shape)
        if cauchy is not None:
            weight = weight / (1.0 + residual**2 * weight / cauchy**2)
        if runs:
            start = np.ascontiguousarray(np.stack([run.start for run in runs], axis=1))
            value = np.ascontiguousarray(np.stack([run.value for run in runs], axis=1))
        else:
            start, value = np.zeros((len(residual), 0), np.int64), np.zeros((len(residual), 0, RUN))
        residual, weight = np.ascontiguousarray(residual, float), np.ascontiguousarray(weight, float)
        kernels.accumulate_normal_equations(start, value, residual, weight, self.matrix, self.vector)
        if tail is not None and len(tail.columns):
            self._add_tail(start, value, residual, weight, tail)
        self._factored = None
        return weight

    def _add_tail(self, start: NDArray[np.int64], value: Floats, residual: Floats, weight: Floats, tail: Tail) -> None:
        """The tail with itself and with the runs, on both sides of the diagonal."""
        weighted = tail.value * weight[:, None]
        crossed = np.zeros((len(self.vector), len(tail.columns)))
        kernels.accumulate_tail(start, value, weighted, crossed)
        self.matrix[:, tail.columns] += crossed
        self.matrix[tail.columns, :] += crossed.T
        self.matrix[np.ix_(tail.columns, tail.columns)] += tail.value.T @ weighted
        self.vector[tail.columns] += weighted.T @ residual

    def solve(self) -> Floats:
        """The step x (size,) that minimises the weighted squares."""
        return self._factor().solve(-self.vector)

    def covariance(self, columns: NDArray[np.int64] | None = None) -> Floats:
        """The inverse of the accumulated information (size, size), or that of some unknowns (k, k)."""
        if columns is None:
            return self._factor().solve(np.eye(len(self.vector)))
        unit = np.zeros((len(self.vector), len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        return self._factor().solve(unit)[columns]

    def _factor(self) -> Cholesky:
        if self._factored is None:
            matrix = self.matrix.copy()
            matrix[np.diag_indices_from(matrix)] += 1e-9  # unknowns that no row touches
            self._factored = Cholesky(matrix, self._order)
        return self._factored
