"""The profiles of one pass of the laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Sweep:
    """m profiles, n points, rig frame, metres; not yet de-skewed: each profile is at its own instant.

    index       number of the sweep in the log, from 0
    stamp_ns    (m,) int64, mid-exposure of each profile
    alpha       (m,) float64, estimated laser angle, rad
    points      (n, 3) float64, ordered by profile, then by row
    sigma       (n,) float32, 1-sigma along the camera ray, m (stripe and laser angle)
    intensity   (n,) float32, 0..255
    profile     (n,) int32, index into stamp_ns
    row         (n,) int32, image row
    """

    index: int
    stamp_ns: NDArray[np.int64]
    alpha: NDArray[np.float64]
    points: NDArray[np.float64]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    profile: NDArray[np.int32]
    row: NDArray[np.int32]

    @property
    def point_stamp_ns(self) -> NDArray[np.int64]:
        """(n,) stamp of each point's profile."""
        return self.stamp_ns[self.profile]
