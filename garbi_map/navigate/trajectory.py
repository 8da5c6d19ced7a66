"""`map` <- `base_link` over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from garbi_map.log.records import Floats, Mount, Stamps


@dataclass(frozen=True)
class Trajectory:
    """Poses map <- base_link at ascending stamps.

    stamp_ns    (n,) int64
    position    (n, 3) m
    quaternion  (n, 4) xyzw
    covariance  (n, 6, 6) of (position error m, rotation error rad), both in the map frame:
                true = position + dp, true = exp(dtheta) * attitude
    """

    stamp_ns: Stamps
    position: Floats
    quaternion: Floats
    covariance: Floats

    @property
    def rotation(self) -> Rotation:
        """The n attitudes map <- base_link."""
        return Rotation.from_quat(self.quaternion)

    def at(self, stamp_ns: NDArray[np.int64]) -> Trajectory:
        """The poses at other stamps: positions and covariances linear, attitudes on the great arc; held at both ends."""
        start = int(self.stamp_ns[0])
        own = (self.stamp_ns - start) * 1e-9
        asked = np.clip((np.asarray(stamp_ns, np.int64) - start) * 1e-9, own[0], own[-1])
        if len(own) == 1:
            pick = np.zeros(len(asked), int)
            return Trajectory(np.asarray(stamp_ns), self.position[pick], self.quaternion[pick], self.covariance[pick])
        after = np.clip(np.searchsorted(own, asked, side="right"), 1, len(own) - 1)
        weight = (asked - own[after - 1]) / (own[after] - own[after - 1])
        w1, w2 = weight[:, None], weight[:, None, None]
        return Trajectory(
            np.asarray(stamp_ns),
            self.position[after - 1] * (1 - w1) + self.position[after] * w1,
            Slerp(own, self.rotation)(asked).as_quat(),
            self.covariance[after - 1] * (1 - w2) + self.covariance[after] * w2,
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
