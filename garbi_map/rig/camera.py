"""Pinhole camera with plumb_bob distortion, behind an optional flat port."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from garbi_map.rig import kernels
from garbi_map.rig.port import Port


def same_length(*values: ArrayLike) -> list[Floats]:
    """Numbers and arrays (n,) as contiguous arrays (n,)."""
    arrays = [np.asarray(value, float) for value in values]
    shape = np.broadcast_shapes((1,), *(array.shape for array in arrays))
    return [np.ascontiguousarray(array) if array.shape == shape else np.full(shape, array) for array in arrays]


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels, distortion k1 k2 p1 p2 k3 in OpenCV's convention, pose in the rig.

    position, quaternion   rig <- camera optical frame (z forward, x right, y down): m, xyzw
    port                   None: calibrated in the medium it works in
    """

    frame_id: str
    width: int
    height: int
    alpha_u: float
    alpha_v: float
    u0: float
    v0: float
    distortion: tuple[float, float, float, float, float]
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    port: Port | None = None

    @cached_property
    def lens(self) -> Floats:
        """(9,) intrinsics and distortion as the kernels take them."""
        return np.array([self.alpha_u, self.alpha_v, self.u0, self.v0, *self.distortion])

    @cached_property
    def window(self) -> Floats:
        """(7,) port as the kernels take it, (0,) without one."""
        return np.empty(0) if self.port is None else self.port.parameters

    @cached_property
    def rotation(self) -> Floats:
        """(3, 3) rig <- camera."""
        return np.ascontiguousarray(Rotation.from_quat(self.quaternion).as_matrix())

    @cached_property
    def centre(self) -> Floats:
        """(3,) pinhole in the rig frame, m."""
        return np.array(self.position, float)

    def rays(self, u: ArrayLike, v: ArrayLike) -> tuple[Floats, Floats]:
        """Origins (n, 3) m and unit directions (n, 3), camera frame, of pixels u, v (n,); NaN where there is no ray."""
        columns, rows = same_length(u, v)
        return kernels.camera_rays(columns, rows, self.lens, self.window)

    def project(self, points: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) m in the camera frame; NaN for those that the camera cannot see."""
        return kernels.camera_pixels(np.asarray(points, float).reshape(-1, 3), self.lens, self.window)
