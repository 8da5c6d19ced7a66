"""How sure each pose is, from the inverse of the last round's information."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations

Floats = NDArray[np.float64]

_STEP = 0.1
"""s between the poses whose covariance is computed; between them it is interpolated."""


def pose_covariance(motion: Motion, problem: NormalEquations, t: Floats) -> Floats:
    """Covariance (n, 6, 6) of (position m, rotation rad) in map axes at t (n,)."""
    full = problem.covariance()
    knots = np.append(np.arange(motion.begin, motion.end, _STEP), motion.end)
    n = len(knots)
    columns, weights = [], []
    for spline, offset in ((motion.position_spline, 0), (motion.attitude_spline, motion.attitude_offset)):
        first, basis = spline.basis(knots)
        columns.append(offset + 3 * first[:, None, None] + 3 * np.arange(4)[:, None] + np.arange(3))
        weights.append(basis)
    column = np.concatenate([part.reshape(n, 12) for part in columns], axis=1)
    rows = np.zeros((n, 6, 24))
    for part in (0, 1):
        for axis in range(3):
            rows[:, 3 * part + axis, 12 * part + axis : 12 * part + 12 : 3] = weights[part]
    block = full[column[:, :, None], column[:, None, :]]
    covariance = rows @ block @ rows.transpose(0, 2, 1)
    after = np.clip(np.searchsorted(knots, t, side="right"), 1, n - 1)
    weight = np.clip((t - knots[after - 1]) / (knots[after] - knots[after - 1]), 0.0, 1.0)[:, None, None]
    return covariance[after - 1] * (1.0 - weight) + covariance[after] * weight
