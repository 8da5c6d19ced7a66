"""What is seen again and again is remembered a few times only, so that memory follows the area and not the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register import kernels
from garbi_map.register.surfels import Surfels

Floats = NDArray[np.float64]


def earliest(surfels: Surfels, size: float, most: int) -> NDArray[np.bool_]:
    """Which surfels (n,) belong to one of the first `most` sweeps that saw their voxel of `size` metres."""
    if len(surfels.mean) == 0:
        return np.zeros(0, bool)
    key = np.empty(len(surfels.mean), np.int64)
    kernels.voxel_keys(surfels.mean, size, key)
    order = np.lexsort((surfels.sweep, key))
    new_voxel = np.r_[True, np.diff(key[order]) != 0]
    new_sweep = new_voxel | np.r_[True, np.diff(surfels.sweep[order]) != 0]
    number = np.cumsum(new_sweep)
    first = np.maximum.accumulate(np.where(new_voxel, number, 0))
    out = np.empty(len(order), bool)
    out[order] = number - first < most
    return out


def within(surfels: Surfels, others: Surfels, margin: float) -> NDArray[np.bool_]:
    """Which surfels (n,) are inside the box about `others`, widened by `margin` metres."""
    if len(others.mean) == 0:
        return np.zeros(len(surfels.mean), bool)
    low, high = others.mean.min(axis=0) - margin, others.mean.max(axis=0) + margin
    return ((surfels.mean >= low) & (surfels.mean <= high)).all(axis=1)
