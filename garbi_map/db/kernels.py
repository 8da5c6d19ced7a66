"""Compiled loops over the points of a submap."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit

_STEEPEST = 1e-3  # least vertical part of a turned normal, for a slope to be told


@njit(cache=True, nogil=True)
def lay(x, y, z, slope_x, slope_y, step, turn, shift):
    """Points given in steps (n,) and slopes (n,) of the surface at them, turned (3, 3), the points then shifted (3,).

    Returns the points (n, 3) and the slopes (n, 2), those of the turned normals.
    """
    placed = np.empty((len(x), 3))
    slope = np.empty((len(x), 2), np.float32)
    for i in range(len(x)):
        p = (x[i] * step, y[i] * step, z[i] * step)
        normal = (-slope_x[i], -slope_y[i], 1.0)
        up = max(turn[2, 0] * normal[0] + turn[2, 1] * normal[1] + turn[2, 2] * normal[2], _STEEPEST)
        for k in range(3):
            placed[i, k] = turn[k, 0] * p[0] + turn[k, 1] * p[1] + turn[k, 2] * p[2] + shift[k]
            if k < 2:
                slope[i, k] = -(turn[k, 0] * normal[0] + turn[k, 1] * normal[1] + turn[k, 2] * normal[2]) / up
    return placed, slope
