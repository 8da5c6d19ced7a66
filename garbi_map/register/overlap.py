"""Which matched surfels are of ground that both sweeps have seen, and which sweeps fit each other at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register import kernels
from garbi_map.register.surfels import Surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_RADIUS = 1.6
"""Voxel sizes, within which a surfel's neighbours tell whether its sweep goes on on all sides."""
_FEWEST = 3
"""Neighbours; a surfel of fewer is an island of its sweep, and all edge."""
_EDGE = 0.25
"""Voxel sizes, to which the middle of the neighbours of a surfel at an edge is off to one side."""
_BEYOND = 0.15
"""Voxel sizes beyond such a surfel, outside its sweep."""
_FIT = 2.0
"""Times the sigma of a match that those of two sweeps may be apart in the median."""


def seen_by_both(surfels: Surfels, first: Ints, second: Ints, size: float) -> NDArray[np.bool_]:
    """Which of the pairs (m,) of surfels, of voxels of `size` m, have neither beyond the edge of the other's sweep.

    Two sweeps that only touch, as one that begins where another ends, have neighbouring surfels all along the seam; taken
    for the same ground they would tell of a motion that nothing has seen (Turk and Levoy 1994, on edges of meshes).
    """
    asked = np.zeros(len(surfels.mean), bool)
    asked[first] = asked[second] = True
    offset, count = _neighbours(surfels, asked, _RADIUS * size)
    middle = offset / np.maximum(count, 1)[:, None]
    aside = np.linalg.norm(middle, axis=1)
    outward = -middle / np.maximum(aside, 1e-12)[:, None]

    def beyond(one: Ints, other: Ints) -> NDArray[np.bool_]:
        between = surfels.mean[one] - surfels.mean[other]
        normal = surfels.normal[other]
        along = between - np.einsum("nk,nk->n", between, normal)[:, None] * normal
        edge = (aside[other] > _EDGE * size) & (np.einsum("nk,nk->n", along, outward[other]) > _BEYOND * size)
        return edge | (count[other] < _FEWEST)

    return ~(beyond(first, second) | beyond(second, first))


def fitting(residual: Floats, pair: Ints, sigma: float) -> NDArray[np.bool_]:
    """Which of the matches (m,) are between sweeps that fit: whose residuals, m, are in the median not beyond the sigma, m.

    pair (m,) names the two sweeps. Where they do not fit they were laid on each other in the wrong place, and all of their
    matches are wrong together, which no robust kernel for single ones takes into account.
    """
    order = np.lexsort((np.abs(residual), pair))
    begin = np.flatnonzero(np.diff(pair[order], prepend=-1))
    count = np.diff(begin, append=len(order))
    median = np.abs(residual)[order][begin + count // 2]
    fits = np.empty(len(order), bool)
    fits[order] = np.repeat(1.4826 * median < _FIT * sigma, count)
    return fits


def _neighbours(surfels: Surfels, asked: NDArray[np.bool_], radius: float) -> tuple[Floats, Ints]:
    """Sum of the offsets (n, 3) m of the neighbours in the same sweep of those that are asked, and their number (n,)."""
    n = len(surfels.mean)
    names, sweep = np.unique(surfels.sweep, return_inverse=True)
    key = np.empty(n, np.int64)
    kernels.voxel_keys(surfels.mean, radius, key)
    order = np.lexsort((key, sweep))
    begin = np.searchsorted(sweep[order], np.arange(len(names) + 1))
    offset, count = np.zeros((n, 3)), np.zeros(n, np.int64)
    kernels.sum_neighbours(asked, surfels.mean, sweep, order, key[order], begin, radius, key, offset, count)
    return offset, count
