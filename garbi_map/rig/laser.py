"""The laser sheet that a motor turns about an axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from garbi_map.rig import window_kernels
from garbi_map.rig.window import LaserWindow


@dataclass(frozen=True)
class Laser:
    """The paper's seven parameters (section 4.2), rig frame.

    x, y, z       the point of the rotation axis that all sheets pass through (the apex of the cone they touch), m
    delta         encoder's zero, rad
    theta, gamma  tilt of the axis about X and Y, rad
    beta          angle between the sheet and the axis, rad
    fixed_angle   alpha of a scanner without a motor, rad
    window        what the sheet is refracted by; None: it stays a plane
    """

    x: float
    y: float
    z: float
    delta: float
    theta: float
    gamma: float
    beta: float
    joint: str = "laser_joint"
    fixed_angle: float | None = None
    window: LaserWindow | None = None

    @cached_property
    def apex(self) -> Floats:
        """(3,) m, rig frame."""
        return np.array([self.x, self.y, self.z])

    @cached_property
    def axis(self) -> Floats:
        """(3, 3) Ry(gamma) Rx(theta): its last column is the axis of rotation."""
        return np.ascontiguousarray(Rotation.from_euler("YX", [self.gamma, self.theta]).as_matrix())

    @cached_property
    def glass(self) -> Floats:
        """(8,) window as the kernels take it, (0,) without one."""
        return np.empty(0) if self.window is None else self.window.parameters

    def off_sheet(self, points: Floats, alpha: ArrayLike) -> Floats:
        """Sine (n,) of the angle, in air at the apex, by which points (n, 3) m, rig frame, miss the sheets.

        alpha: (n,) rad, or one for all. NaN for points inside the window."""
        points = np.ascontiguousarray(points, float).reshape(-1, 3)
        angle = np.ascontiguousarray(np.broadcast_to(np.asarray(alpha, float), len(points)))
        return window_kernels.off_sheet(points, angle, self.delta, self.beta, self.axis, self.apex, self.glass)

    def distance(self, points: Floats, alpha: ArrayLike) -> Floats:
        """Signed distance (n,) m, to first order, of points (n, 3) m, rig frame, from the sheets at alpha (n,) rad."""
        normal = np.broadcast_to(self.sheet(alpha), points.shape)
        step = 1e-4
        ahead, behind = self.off_sheet(points + step * normal, alpha), self.off_sheet(points - step * normal, alpha)
        return self.off_sheet(points, alpha) * 2.0 * step / (ahead - behind)

    def sheet(self, alpha: ArrayLike) -> Floats:
        """Unit normals (m, 3), rig frame, of the sheets through the apex at angles alpha (m,) rad, before a window.

        Ry(gamma) Rx(theta) Rz(delta + alpha) Rx(-beta) [0, 1, 0]', the paper's equation (4) where theta = gamma = 0.
        """
        turn = np.atleast_1d(np.asarray(alpha, float)) + self.delta
        flat = np.full_like(turn, -np.sin(self.beta))
        own = np.stack([-np.sin(turn) * np.cos(self.beta), np.cos(turn) * np.cos(self.beta), flat], axis=1)
        return own @ self.axis.T
