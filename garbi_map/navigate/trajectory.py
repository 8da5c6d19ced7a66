"""`map` <- `base_link` over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Mount, Stamps

_BLOCK = 10_000


@dataclass(frozen=True)
class Trajectory:
    """Poses map <- base_link at ascending stamps.

    stamp_ns    (n,) int64
    position    (n, 3) m
    quaternion  (n, 4) xyzw
    covariance  (n, 6, 6), float32 in long ones, of (position error m, rotation error rad), both in the map frame:
                true = position + dp, true = exp(dtheta) * attitude
    """

    stamp_ns: Stamps
    position: Floats
    quaternion: Floats
    covariance: NDArray[np.floating]

    @property
    def rotation(self) -> Rotation:
        """The n attitudes map <- base_link."""
        return Rotation.from_quat(self.quaternion)

    def at(self, stamp_ns: NDArray[np.int64]) -> Trajectory:
        """The poses at other stamps: positions and covariances linear, attitudes on the great arc; held at the ends."""
        asked = np.asarray(stamp_ns, np.int64)
        held = np.clip(asked, self.stamp_ns[0], self.stamp_ns[-1])
        last = len(self.stamp_ns) - 1
        after = np.clip(np.searchsorted(self.stamp_ns, held, side="right"), min(1, last), last)
        before = np.maximum(after - 1, 0)
        weight = (held - self.stamp_ns[before]) / np.maximum(self.stamp_ns[after] - self.stamp_ns[before], 1)
        w1 = weight[:, None]
        covariance = np.empty((len(asked), 6, 6), self.covariance.dtype)
        for first in range(0, len(asked), _BLOCK):  # an hour's covariances are 50 MB, and twice that is too much
            rows = slice(first, first + _BLOCK)
            one, two = self.covariance[before[rows]], self.covariance[after[rows]]
            covariance[rows] = one + (two - one) * weight[rows, None, None]
        start = Rotation.from_quat(self.quaternion[before])
        arc = (start.inv() * Rotation.from_quat(self.quaternion[after])).as_rotvec()
        return Trajectory(
            asked,
            self.position[before] * (1 - w1) + self.position[after] * w1,
            (start * Rotation.from_rotvec(arc * w1)).as_quat(),
            covariance,
        )

    def mounted(self, mount: Mount) -> Trajectory:
        """The poses map <- sensor of a sensor fixed to base_link (its own covariance is left as that of base_link)."""
        rotation = self.rotation
        return Trajectory(
            self.stamp_ns,
            self.position + rotation.apply(mount.translation),
            (rotation * Rotation.from_quat(mount.quaternion)).as_quat(),
            self.covariance,
        )

    def moved(self, transform: Floats) -> Trajectory:
        """The poses in another frame, which a transform (4, 4) of this one gives."""
        turn = transform[:3, :3]
        both = np.kron(np.eye(2), turn).astype(self.covariance.dtype)
        return Trajectory(
            self.stamp_ns,
            self.position @ turn.T + transform[:3, 3],
            (Rotation.from_matrix(turn) * self.rotation).as_quat(),
            both @ self.covariance @ both.T,
        )
