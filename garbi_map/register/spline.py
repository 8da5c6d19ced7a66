"""Uniform cubic B-splines as linear maps from control points to values, so that they can stand in a least-squares row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class UniformSpline:
    """Cubic B-spline with knots `spacing` seconds apart that covers [begin, end] (seconds).

    A value is the weighted sum of four neighbouring control points (de Boor, A Practical Guide to Splines, 1978).
    """

    begin: float
    end: float
    spacing: float

    @property
    def size(self) -> int:
        """Number of control points."""
        return max(int(np.ceil((self.end - self.begin) / self.spacing)), 1) + 3

    def basis(self, t: Floats, derivative: int = 0) -> tuple[NDArray[np.int64], Floats]:
        """First control point (n,) and the four weights (n, 4) for the value, or one of its three derivatives, at t (n,).

        Times outside are held at the ends.
        """
        s = np.clip((np.asarray(t, float) - self.begin) / self.spacing, 0.0, self.size - 3 - 1e-9)
        first = s.astype(np.int64)
        u = s - first
        if derivative == 0:
            weights = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=-1)
            return first, weights / 6
        if derivative == 1:
            weights = np.stack([-((1 - u) ** 2), 3 * u**2 - 4 * u, -3 * u**2 + 2 * u + 1, u**2], axis=-1)
            return first, weights / (2 * self.spacing)
        if derivative == 2:
            return first, np.stack([1 - u, 3 * u - 2, 1 - 3 * u, u], axis=-1) / self.spacing**2
        if derivative == 3:
            return first, np.broadcast_to([-1.0, 3.0, -3.0, 1.0], (len(s), 4)) / self.spacing**3
        raise ValueError(f"derivative {derivative} of a cubic spline is not offered")

    def value(self, control: Floats, t: Floats, derivative: int = 0) -> Floats:
        """Values (n, d) at t (n,) of the spline with control points (size, d)."""
        first, weights = self.basis(t, derivative)
        return np.einsum("nk,nkd->nd", weights, control[first[:, None] + np.arange(4)])
