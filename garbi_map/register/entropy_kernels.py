"""Compiled loops of the map entropy: points into the balls that hold them."""

from __future__ import annotations

import numpy as np
from numba import njit

EMPTY = np.int64(-1)


@njit(cache=True, nogil=True, inline="always")
def _voxel(x, y, z, size):  # type: ignore[no-untyped-def]
    """The int64 that names a voxel, 21 bits an axis; never negative within a million voxels of the origin."""
    i = int(np.floor(x / size)) + 1048576
    j = int(np.floor(y / size)) + 1048576
    k = int(np.floor(z / size)) + 1048576
    return (i << 42) | (j << 21) | k


@njit(cache=True, nogil=True, inline="always")
def _slot(name, mask):  # type: ignore[no-untyped-def]
    """Where in the table to begin to look for a name."""
    mixed = name ^ (name >> 21) * 73856093 ^ (name >> 42) * 19349663
    return (mixed ^ (mixed >> 15)) & mask


@njit(cache=True, nogil=True)
def file_balls(centre, size, names, head, following):  # type: ignore[no-untyped-def]
    """Files each centre (m, 3) under the 27 voxels about it: a hash table of chains.

    names (slots,) and head (slots,) come filled with EMPTY; following (27 m,) links entries, entry // 27 is the centre.
    """
    mask = names.shape[0] - 1
    for ball in range(centre.shape[0]):
        for turn in range(27):
            name = _voxel(
                centre[ball, 0] + (turn // 9 - 1) * size,
                centre[ball, 1] + (turn // 3 % 3 - 1) * size,
                centre[ball, 2] + (turn % 3 - 1) * size,
                size,
            )
            slot = _slot(name, mask)
            while names[slot] != EMPTY and names[slot] != name:
                slot = (slot + 1) & mask
            names[slot] = name
            following[27 * ball + turn] = head[slot]
            head[slot] = 27 * ball + turn


@njit(cache=True, nogil=True)
def add_points(points, centre, size, names, head, following, count, first, second):  # type: ignore[no-untyped-def]
    """Adds points (n, 3) to the moments of the balls of radius `size` that hold them.

    count (m,); first (m, 3) and second (m, 3, 3) are about the ball's centre, so that no digits are lost far out.
    """
    mask = names.shape[0] - 1
    off = np.empty(3)
    for k in range(points.shape[0]):
        name = _voxel(points[k, 0], points[k, 1], points[k, 2], size)
        slot = _slot(name, mask)
        while names[slot] != EMPTY and names[slot] != name:
            slot = (slot + 1) & mask
        entry = head[slot]
        while entry != EMPTY:
            ball = entry // 27
            entry = following[entry]
            square = 0.0
            for a in range(3):
                off[a] = points[k, a] - centre[ball, a]
                square += off[a] * off[a]
            if square > size * size:
                continue
            count[ball] += 1
            for a in range(3):
                first[ball, a] += off[a]
                for b in range(3):
                    second[ball, a, b] += off[a] * off[b]
