"""Compiled charts of the local volume, see behaviours.charts."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from behaviours.kernels import NEVER
from garbi_map.log.records import Floats

FAR = 9.0  # m, where there is nothing


@njit(cache=True, nogil=True)
def chart(
    heights: Floats,
    half: float,
    margin: float,
    first: NDArray[np.int64],
    size: int,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    lasting: int,
    assumed_free_above: float,
    layers: tuple,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int32]]:
    """Of each column (heights, size, size) from column `first` (2,) on: whether a hull of that half height, m, at that
    height and a margin above and below meet something; whether some of the hull would be in unseen water; and the
    latest hit, ms, of what may move (no voxel was hit again `lasting` ms after its first hit), NEVER where there is none."""
    free_ms, hit_ms, _, hits, _, _, _, first_ms = layers
    occupied = np.zeros((len(heights), size, size), np.bool_)
    unseen = np.zeros_like(occupied)
    restless = np.full(occupied.shape, NEVER, np.int32)
    for n in range(len(heights)):
        bottom, top = heights[n] - half - margin, heights[n] + half + margin
        k0, k1 = math.floor(bottom / voxel), math.floor(top / voxel) + 1
        o0, o1 = math.floor((heights[n] - half) / voxel + 0.5), math.floor((heights[n] + half) / voxel - 0.5) + 1
        for i in range(size):
            for j in range(size):
                p, q = first[0] + i, first[1] + j
                if not (low[0] <= p < low[0] + shape[0] and low[1] <= q < low[1] + shape[1]):
                    unseen[n, i, j] = True
                    continue
                a, b = p % shape[0], q % shape[1]
                settled = False
                for k in range(k0, k1):
                    if not low[2] <= k < low[2] + shape[2]:
                        occupied[n, i, j] = True
                        continue
                    c = k % shape[2]
                    if hits[a, b, c] >= least:
                        settled = settled or hit_ms[a, b, c] - first_ms[a, b, c] >= lasting
                        restless[n, i, j] = max(restless[n, i, j], hit_ms[a, b, c])
                        occupied[n, i, j] = True
                    elif o0 <= k < o1 and free_ms[a, b, c] == NEVER and k * voxel < assumed_free_above:
                        unseen[n, i, j] = True
                if settled:
                    restless[n, i, j] = NEVER
    return occupied, unseen, restless


@njit(cache=True, nogil=True)
def distance(there: NDArray[np.bool_], farthest: float) -> NDArray[np.float32]:
    """Cells from each cell (nx, ny) to the nearest that is true, `farthest` at most: exact (Felzenszwalb and Huttenlocher,
    Distance Transforms of Sampled Functions, 2012)."""
    nx, ny = there.shape
    square = farthest * farthest
    column = np.empty((nx, ny))
    for j in range(ny):  # along x: two passes count steps
        gone = farthest
        for i in range(nx):
            gone = 0.0 if there[i, j] else gone + 1.0
            column[i, j] = gone
        gone = farthest
        for i in range(nx - 1, -1, -1):
            gone = 0.0 if there[i, j] else gone + 1.0
            column[i, j] = min(min(gone, column[i, j]) ** 2, square)
    out = np.empty((nx, ny), np.float32)
    place, border = np.empty(ny, np.int64), np.empty(ny + 1)
    for i in range(nx):  # along y: the lower envelope of parabolas
        f = column[i]
        k = 0
        place[0], border[0], border[1] = 0, -np.inf, np.inf
        for q in range(1, ny):
            s = (f[q] + q * q - f[place[k]] - place[k] ** 2) / (2.0 * (q - place[k]))
            while s <= border[k]:
                k -= 1
                s = (f[q] + q * q - f[place[k]] - place[k] ** 2) / (2.0 * (q - place[k]))
            k += 1
            place[k], border[k], border[k + 1] = q, s, np.inf
        k = 0
        for q in range(ny):
            while border[k + 1] < q:
                k += 1
            out[i, q] = min(math.sqrt((q - place[k]) ** 2 + f[place[k]]), farthest)
    return out
