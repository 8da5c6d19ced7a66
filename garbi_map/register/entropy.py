"""The mean map entropy: how sharp a map is, without a truth and without pairs.

Droeschel and Behnke (ICRA 2014), Razlaw et al. (ECMR 2015): the mean over the map of half the logarithm of |2 pi e C|, where
C is the covariance of the points within a radius. Two copies of a surface that do not fit make C thicker.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from garbi_map.register import entropy_kernels as kernels

Floats = NDArray[np.float64]

_FEWEST = 10
"""Points within the radius; fewer tell no covariance."""


class Balls:
    """Moments of the points within `radius` m of some centres (m, 3); the points come piece by piece."""

    def __init__(self, centres: Floats, radius: float) -> None:
        self._centres, self._radius = np.ascontiguousarray(centres, np.float64), radius
        slots = 1 << int(np.ceil(np.log2(4 * 27 * max(len(centres), 1))))
        self._names, self._head = np.full(slots, kernels.EMPTY), np.full(slots, kernels.EMPTY)
        self._following = np.full(27 * len(centres), kernels.EMPTY)
        kernels.file_balls(self._centres, radius, self._names, self._head, self._following)
        self._count = np.zeros(len(centres), np.int64)
        self._first, self._second = np.zeros((len(centres), 3)), np.zeros((len(centres), 3, 3))

    def add(self, points: Floats) -> None:
        """Points (n, 3), m."""
        table = self._names, self._head, self._following
        kernels.add_points(points, self._centres, self._radius, *table, self._count, self._first, self._second)

    def entropy(self) -> Floats:
        """(m,) nats; NaN where there are too few points, or they lie in a plane to the last digit."""
        count = np.maximum(self._count, 1)
        mean = self._first / count[:, None]
        covariance = self._second / count[:, None, None] - mean[:, :, None] * mean[:, None, :]
        sign, logarithm = np.linalg.slogdet(2 * np.pi * math.e * covariance)
        return np.where((self._count >= _FEWEST) & (sign > 0), 0.5 * logarithm, np.nan)
