"""One camera and one laser, and what a pixel means in metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from garbi_map.log.records import Floats
from garbi_map.rig import kernels, window_kernels
from garbi_map.rig.camera import Camera, same_length
from garbi_map.rig.laser import Laser

WINDOW_STRIDE = 48  # px between the columns whose rays the window samples: 0.2 px error with |k1| = 0.3


class Triangulated(NamedTuple):
    """points (n, 3) m, and their derivatives by the column, d_du (n, 3) m/px, and by the laser's angle, d_dalpha
    (n, 3) m/rad. Rig frame. NaN rows where the ray meets no sheet in front of the camera."""

    points: Floats
    d_du: Floats
    d_dalpha: Floats


@dataclass(frozen=True)
class Rig:
    """What rig.yaml holds. `rig` is the paper's {W}: X forward along the view, Y left, Z up.

    extra   keys of the file that are not computed with (covariances, dates), kept as they were read
    """

    camera: Camera
    laser: Laser
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def rays(self, u: ArrayLike, v: ArrayLike) -> tuple[Floats, Floats]:
        """Origins (n, 3) m and unit directions (n, 3), rig frame, of pixels u, v (n,).

        With a port the origin lies on its outer face, and differs from pixel to pixel."""
        origin, direction = self.camera.rays(u, v)
        return origin @ self.camera.rotation.T + self.camera.centre, direction @ self.camera.rotation.T

    def project(self, points: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) m in the rig frame; NaN for those that the camera cannot see."""
        return self.camera.project((np.asarray(points, float) - self.camera.centre) @ self.camera.rotation)

    def depth(self, points: Floats) -> Floats:
        """Camera depth (n,) m, along the optical axis, of points (n, 3) in the rig frame."""
        return (points - self.camera.centre) @ self.camera.rotation[:, 2]

    def sheet(self, alpha: ArrayLike) -> Floats:
        """Unit normals (m, 3) of the sheets at encoder angles alpha (m,) rad; all pass through `laser.apex`."""
        return self.laser.sheet(alpha)

    def triangulate(self, u: ArrayLike, v: ArrayLike, alpha: ArrayLike) -> Triangulated:
        """Where the rays of pixels u, v (n,) meet the sheets at alpha (n,) rad, or one alpha for all."""
        columns, rows, angles = same_length(u, v, alpha)
        camera, laser = self.camera, self.laser
        view = (columns, rows, angles, camera.lens, camera.window, camera.rotation, camera.centre)
        sheet = (laser.delta, laser.beta, laser.axis, laser.apex)
        if laser.window is None:
            return Triangulated(*kernels.triangulate(*view, *sheet))
        return Triangulated(*window_kernels.triangulate(*view, *sheet, laser.glass))

    def column_window(self, alpha: float, min_range: float, max_range: float) -> tuple[Floats, Floats]:
        """Where in the image the stripe can be: first and last column (height,) px of each row, float, in the image.

        The hull of the columns whose ray meets the sheet between two camera depths (along the optical axis, m), lens
        and port included, good to half a pixel: add your own margin. first > last in a row that cannot see the
        stripe; the whole row where alpha is not known (NaN).
        """
        height, width = self.camera.height, self.camera.width
        if np.isnan(alpha):
            return np.zeros(height), np.full(height, width - 1.0)
        if self.laser.window is not None:
            return self._refracted_window(alpha, min_range, max_range)
        rotation = self.camera.rotation
        columns, rays = self._window_rays
        return kernels.inverse_depth_window(
            rotation.T @ self.sheet(alpha)[0],
            rotation.T @ (self.laser.apex - self.camera.centre),
            columns,
            rays,
            1.0 / min_range,
            1.0 / max_range,
        )

    def _refracted_window(self, alpha: float, min_range: float, max_range: float) -> tuple[Floats, Floats]:
        """column_window behind a laser window: where the sheet's light at the two depths is seen, row by row."""
        height, width = self.camera.height, self.camera.width
        rows = np.unique(np.append(np.arange(0, height, WINDOW_STRIDE), height - 1))
        columns = np.linspace(0.0, width - 1.0, 4 * -(-(width - 1) // WINDOW_STRIDE) + 1)
        u, v = np.meshgrid(columns, rows.astype(float))
        inverse = 1.0 / self.depth(self.triangulate(u.ravel(), v.ravel(), alpha).points).reshape(u.shape)
        after = np.clip(np.searchsorted(rows, np.arange(height)), 1, len(rows) - 1)
        share = ((np.arange(height) - rows[after - 1]) / (rows[after] - rows[after - 1]))[:, None]
        between = (1.0 - share) * inverse[after - 1] + share * inverse[after]
        return kernels.hulls(columns, between, 1.0 / min_range, 1.0 / max_range)

    @cached_property
    def _window_rays(self) -> tuple[Floats, Floats]:
        """Columns (k,) px and rays (height, 6, k), camera frame: origin and direction with z = 1."""
        height, width = self.camera.height, self.camera.width
        columns = np.linspace(0.0, width - 1.0, -(-(width - 1) // WINDOW_STRIDE) + 1)
        u, v = np.meshgrid(columns, np.arange(height, dtype=float))
        origin, direction = self.camera.rays(u.ravel(), v.ravel())
        rays = np.concatenate([origin, direction / direction[:, 2:]], axis=1)
        return columns, np.ascontiguousarray(rays.reshape(height, len(columns), 6).transpose(0, 2, 1))

    @property
    def eyes(self) -> Floats:
        """(2, 3) m, rig frame: where the view and the light come from, the camera and the laser's apex."""
        return np.stack([self.camera.centre, self.laser.apex])

    def to_yaml(self) -> str:
        """The rig file, unknown keys included."""
        from garbi_map.rig.io import dump_rig

        return dump_rig(self)
