"""All submaps of all dives at once: where ground was seen twice, by one dive or by two, the views are laid on each other.

A dive that was laid on the map as one stiff piece keeps its own drift; here each submap moves by itself, held by what it
shares with others and, where it shares nothing, by its neighbours in time. One small sparse solve a round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, coo_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from garbi_map.register.normals import summed_normals
from garbi_map.register.surfels import Surfels, match_surfels
from garbi_map.register.thinning import earliest

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_GATES = (0.02, 0.015, 0.01, 0.01, 0.01)
"""m, within which matches are looked for, round after round."""
_VIEWS = 6
"""Of one place that later ones are compared with."""
_SIGMA = 2.5e-4
"""m, of a match: curvature and noise of two patches, as in the drift estimate."""
_TUKEY = 4.7
_NEIGHBOUR = np.array([1e-3, 1e-3, 1e-3, 5e-4, 5e-4, 5e-4])
"""1 sigma, m and rad, by which the drift left in a dive changes from one submap to the next."""
_AT_ALL = np.array([0.1, 0.1, 0.1, 0.02, 0.02, 0.02])
"""1 sigma, m and rad, of what a submap may move; only what nothing else holds feels it."""
_HELD = 1e-6


def settle(surfels: Surfels, dive: Ints) -> Floats:
    """The motion (k, 4, 4) of each submap in `map` that makes all of them agree; the first stays.

    surfels: of all submaps where they are now, numbered 0..k-1 by `sweep`; dive (k,): which dive each belongs to, submaps
    in the order of time.
    """
    count = len(dive)
    transforms = np.tile(np.eye(4), (count, 1, 1))
    asked = earliest(surfels, _GATES[0], _VIEWS)
    known = np.bincount(surfels.sweep, minlength=count)
    total = [np.bincount(surfels.sweep, column, count) for column in surfels.mean.T]
    centre: Floats = np.stack(total, axis=1) / np.maximum(known, 1)[:, None]
    neighbours = np.flatnonzero(dive[1:] == dive[:-1])
    for gate in _GATES:
        moved = surfels.moved(transforms)
        first, second = match_surfels(moved, gate, np.inf, asked)
        normal = summed_normals(moved.normal[first], moved.normal[second], first)
        apart = np.einsum("nk,nk->n", normal, moved.mean[first] - moved.mean[second])
        weight = _weights(apart)
        sides = []
        for rows, sign in ((first, 1.0), (second, -1.0)):
            arm = moved.mean[rows] - centre[moved.sweep[rows]]
            sides.append(sign * np.hstack([normal, np.cross(arm, normal)]))
        hessian, gradient = _normal_equations(sides, moved.sweep[first], moved.sweep[second], apart, weight, count)
        moves = _chained(transforms, centre)
        prior = np.full((count, 6), 1.0) / _AT_ALL**2
        prior[0] = 1.0 / _HELD**2
        hessian = hessian + coo_array((prior.ravel(), (np.arange(6 * count),) * 2)) + _chain(neighbours, count)
        gradient -= prior.ravel() * moves.ravel() + _chain(neighbours, count) @ moves.ravel()
        step = spsolve(hessian.tocsc(), gradient).reshape(count, 6)
        transforms = _moves(step, centre) @ transforms
    return transforms


def _weights(apart: Floats) -> Floats:
    """Tukey's, about the spread of most: what moved between two views has no say."""
    spread = max(1.4826 * float(np.median(np.abs(apart))) if len(apart) else 0.0, _SIGMA)
    return np.asarray(np.maximum(1.0 - (apart / (_TUKEY * spread)) ** 2, 0.0) ** 2 / _SIGMA**2)


def _normal_equations(
    sides: list[Floats], first: Ints, second: Ints, apart: Floats, weight: Floats, count: int
) -> tuple[coo_array, Floats]:
    """Hessian (6k, 6k) and right-hand side (6k,) of the matches; sides (m, 6) are the derivatives of both submaps."""
    gradient = np.zeros((count, 6))
    blocks, rows, columns = [], [], []
    pair = first * count + second
    order = np.argsort(pair, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(pair[order])) + 1) if len(order) else []:
        ends = (int(first[own[0]]), int(second[own[0]]))
        for a, one in zip(ends, sides, strict=True):
            weighted = one[own] * weight[own, None]
            gradient[a] -= weighted.T @ apart[own]
            for b, other in zip(ends, sides, strict=True):
                blocks.append(weighted.T @ other[own])
                rows.append(a)
                columns.append(b)
    if not blocks:
        return coo_array((6 * count, 6 * count)), gradient.ravel()
    index = np.arange(6)
    row = (6 * np.array(rows)[:, None, None] + index[:, None] + 0 * index).ravel()
    column = (6 * np.array(columns)[:, None, None] + 0 * index[:, None] + index).ravel()
    return coo_array((np.array(blocks).ravel(), (row, column)), shape=(6 * count, 6 * count)), gradient.ravel()


def _chain(neighbours: Ints, count: int) -> bsr_array:
    """Hessian (6k, 6k) of what holds a submap to the next of its dive."""
    stiff = np.tile(1.0 / _NEIGHBOUR**2, (len(neighbours), 1)).ravel()
    a = (6 * neighbours[:, None] + np.arange(6)).ravel()
    b = a + 6
    size = (6 * count, 6 * count)
    return coo_array((np.r_[stiff, stiff, -stiff, -stiff], (np.r_[a, b, a, b], np.r_[a, b, b, a])), shape=size).tocsr()


def _chained(transforms: Floats, centre: Floats) -> Floats:
    """What the submaps have moved so far (k, 6): their centres, m, and about these, rad."""
    shift = np.einsum("kij,kj->ki", transforms[:, :3, :3], centre) + transforms[:, :3, 3] - centre
    return np.hstack([shift, Rotation.from_matrix(transforms[:, :3, :3]).as_rotvec()])


def _moves(step: Floats, centre: Floats) -> Floats:
    """Transforms (k, 4, 4) of steps (k, 6) about centres (k, 3)."""
    out = np.tile(np.eye(4), (len(step), 1, 1))
    out[:, :3, :3] = Rotation.from_rotvec(step[:, 3:]).as_matrix()
    out[:, :3, 3] = centre + step[:, :3] - np.einsum("kij,kj->ki", out[:, :3, :3], centre)
    return out
