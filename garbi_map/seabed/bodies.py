"""What hangs in the water as one body, and whether it moves: what was looked at again speaks for the rest of it."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from garbi_map.seabed.settings import OutlierSettings

_JOIN = 2
"""Voxels along a side of the cells that, where they touch, are one body: gaps of two voxels are bridged."""
_LOW = (1 << 21) - 1
"""Mask of one axis in a voxel's key."""


def moving_bodies(
    key: NDArray[np.int64],
    count: NDArray[np.int32],
    moved: NDArray[np.bool_],
    again: NDArray[np.bool_],
    settings: OutlierSettings,
) -> NDArray[np.bool_]:
    """Which voxels (n,) belong to a body that moves, by their keys, in ascending order, and the points in each.

    A body is what touches nothing else and is small. It moves where more of its points `moved`, for they were seen
    through, than were hit `again` by a later sweep, and at least a few of them did; or where it floats: the seabed is seen
    right beneath it, so that it rests on nothing, and no later sweep hit it again.
    """
    index = [key >> 42, (key >> 21) & _LOW, key & _LOW]
    label = _touching(index)
    bodies = int(label.max(initial=-1)) + 1
    small = np.ones(bodies, np.bool_)
    for axis in index:
        first, last = np.full(bodies, _LOW), np.zeros(bodies, np.int64)
        np.minimum.at(first, label, axis)
        np.maximum.at(last, label, axis)
        small &= (last - first + 1) * settings.voxel <= settings.body
    points = np.bincount(label, count, bodies)
    gone = np.bincount(label, count * moved, bodies)
    confirmed = np.bincount(label, count * (again & ~moved), bodies)
    floats = np.bincount(label, count * _above_others(key, label, settings), bodies) > 0.5 * points
    moves = small & (gone >= confirmed) & (floats | (gone > settings.body_through * points))
    return moves[label]


def columns(key: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each vertical column begins among voxels in the order of their keys (n,), and how many each has."""
    starts = np.flatnonzero(np.diff(key >> 21, prepend=-1))
    return starts, np.diff(starts, append=len(key))


def _touching(index: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """A number (n,) for each voxel that those have in common which hang together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    coarse = index[0] // _JOIN << 42 | index[1] // _JOIN << 21 | index[2] // _JOIN
    cells, member = np.unique(coarse, return_inverse=True)
    pairs = []
    for dx, dy, dz in product((-1, 0, 1), repeat=3):
        step = (dx << 42) + (dy << 21) + dz
        if step > 0:  # the other half of the neighbours sees the pair from its other end
            to = np.minimum(np.searchsorted(cells, cells + step), len(cells) - 1)
            here = np.flatnonzero(cells[to] == cells + step)
            pairs.append((here, to[here]))
    a, b = (np.concatenate(part) for part in zip(*pairs, strict=True))
    graph = coo_array((np.ones(len(a), np.bool_), (a, b)), shape=(len(cells), len(cells)))
    return connected_components(graph, directed=False)[1][member].astype(np.int64)


def _above_others(key: NDArray[np.int64], label: NDArray[np.int64], settings: OutlierSettings) -> NDArray[np.bool_]:
    """Whether the lowest voxel in a voxel's column belongs to something else and lies well below it (n,)."""
    starts, lengths = columns(key)
    lowest = np.repeat(starts, lengths)
    return (label[lowest] != label) & ((key - key[lowest]) * settings.voxel > settings.clearance)
