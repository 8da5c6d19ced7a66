"""How sure each pose is, from the inverse of the last round's information."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations

Floats = NDArray[np.float64]

_STEP = 0.1
"""s between the poses whose covariance is computed; between them it is interpolated."""


def pose_covariances(motion: Motion, problem: NormalEquations, t: Floats) -> tuple[Floats, Floats]:
    """Covariances (n, 6, 6), (n, 6, 6) of (position m, rotation rad) in map axes at t (n,): absolute, and relative.

    Absolute is against the map's origin and north. Relative is what is left when the window is moved as a rigid body to
    where it fits best (inner constraints: Baarda's S-transformation, 1973), that is the error inside the map.
    """
    full = problem.covariance()
    knots = motion.instants(_STEP)
    n = len(knots)
    columns, rows = _design(motion, knots)
    absolute = rows @ full[columns[:, :, None], columns[:, None, :]] @ rows.transpose(0, 2, 1)

    position = motion.position(knots)
    modes = np.tile(np.eye(6), (n, 1, 1))
    x, y, z = (position - position.mean(axis=0)).T
    zero = np.zeros(n)
    modes[:, :3, 3:] = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(n, 3, 3)
    # the rigid motion of all poses, one degree of attitude weighing as much as it moves what is seen at 1.4 m
    weight = np.array([1.0, 1.0, 1.0, 1.96, 1.96, 1.96])
    normal = np.einsum("nki,k,nkj->ij", modes, weight, modes)
    pull = np.zeros((6, motion.size))
    np.add.at(pull.T, columns.ravel(), np.einsum("nki,k,nkc->nci", modes, weight, rows).reshape(-1, 6))
    rigid = np.linalg.solve(normal, pull)
    shared = full @ rigid.T
    own = rows @ shared[columns]
    crossed = own @ modes.transpose(0, 2, 1)
    common = modes @ (rigid @ shared) @ modes.transpose(0, 2, 1)
    relative = absolute - crossed - crossed.transpose(0, 2, 1) + common
    return _interpolated(knots, absolute, t), _interpolated(knots, relative, t)


def _design(motion: Motion, t: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Which unknowns (n, 24) the poses at t depend on, and how (n, 6, 24)."""
    n = len(t)
    columns, rows = [], np.zeros((n, 6, 24))
    for part, (spline, offset) in enumerate(
        ((motion.position_spline, 0), (motion.attitude_spline, motion.attitude_offset))
    ):
        first, basis = spline.basis(t)
        columns.append((offset + 3 * first)[:, None] + np.arange(12))
        for axis in range(3):
            rows[:, 3 * part + axis, 12 * part + axis : 12 * part + 12 : 3] = basis
    return np.concatenate(columns, axis=1), rows


def _interpolated(knots: Floats, values: Floats, t: Floats) -> Floats:
    after = np.clip(np.searchsorted(knots, t, side="right"), 1, len(knots) - 1)
    weight = np.clip((t - knots[after - 1]) / (knots[after] - knots[after - 1]), 0.0, 1.0)[:, None, None]
    return values[after - 1] * (1.0 - weight) + values[after] * weight
