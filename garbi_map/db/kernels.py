"""Compiled loops over the points of a submap."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit

_STEEPEST = 1e-3  # least vertical part of a turned normal, for a slope to be told


@njit(cache=True, nogil=True)
def lay(place, slope, step, turn, shift):
    """Points and the slopes of the surface at them, turned (3, 3), the points then shifted (3,).

    place: x, y and z (n,) in steps of so many m; slope: along x and y (n,).
    Returns the points (n, 3) and the slopes (n, 2), those of the turned normals.
    """
    n = len(place[0])
    placed = np.empty((n, 3))
    turned = np.empty((n, 2), np.float32)
    for i in range(n):
        x, y, z = place[0][i] * step, place[1][i] * step, place[2][i] * step
        for k in range(3):
            placed[i, k] = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + shift[k]
        up = max(turn[2, 2] - turn[2, 0] * slope[0][i] - turn[2, 1] * slope[1][i], _STEEPEST)
        for k in range(2):
            turned[i, k] = (turn[k, 0] * slope[0][i] + turn[k, 1] * slope[1][i] - turn[k, 2]) / up
    return placed, turned
