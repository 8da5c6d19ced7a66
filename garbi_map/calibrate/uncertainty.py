"""What a calibration's covariance means in metres, across the image and with distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.calibrate.bundle import step_sizes
from garbi_map.calibrate.scanner import Scanner
from garbi_map.log.records import Floats
from garbi_map.rig import Laser, Rig

GRID = (9, 7)  # columns and rows of the image at which errors are stated


@dataclass(frozen=True)
class Spread:
    """1 sigma (rows, columns) m of a point's position, all three directions together, at a depth (m)."""

    depth: float
    sigma: Floats

    @property
    def rms(self) -> float:
        """Over the image, m."""
        return float(np.sqrt(np.nanmean(self.sigma**2)))


def image_grid(width: int, height: int) -> tuple[Floats, Floats]:
    """u, v (n,) px of a grid across the image, 2 % inside its border."""
    columns, rows = GRID
    u, v = np.meshgrid(np.linspace(0.02, 0.98, columns) * (width - 1), np.linspace(0.02, 0.98, rows) * (height - 1))
    return u.ravel(), v.ravel()


def points_at(rig: Rig, depth: float) -> tuple[Floats, Floats, Floats, Floats]:
    """u, v (n,) px across the image, the points (n, 3) m seen there at a depth, and the alpha (n,) whose sheet lights
    them; NaN where no sheet does."""
    u, v = image_grid(rig.camera.width, rig.camera.height)
    origin, direction = rig.rays(u, v)
    ahead = rig.camera.rotation[:, 2]
    reach = (depth - (origin - rig.camera.centre) @ ahead) / (direction @ ahead)
    points = origin + reach[:, None] * direction
    return u, v, points, alpha_through(rig.laser, points)


def alpha_through(laser: Laser, points: Floats) -> Floats:
    """alpha (n,) rad whose sheet passes through points (n, 3) m, rig frame; NaN where none does."""
    own = (points - laser.apex) @ laser.axis
    alpha = np.arctan2(own[:, 1], own[:, 0]) - laser.delta
    h = 1e-5
    for _ in range(20):
        slope = (laser.off_sheet(points, alpha + h) - laser.off_sheet(points, alpha - h)) / (2 * h)
        step = np.clip(laser.off_sheet(points, alpha) / slope, -0.2, 0.2)
        alpha = alpha - step
        if not np.nanmax(np.abs(step), initial=0.0) > 1e-13:
            break
    return np.where(np.abs(laser.off_sheet(points, alpha)) < 1e-9, alpha, np.nan)


def spread_at(
    scanner: Scanner, names: tuple[str, ...], covariance: Floats, depth: float, fixed: bool = False
) -> Spread:
    """The covariance (k, k) of named parameters as metres at a depth; fixed: the laser has no motor.

    Without a motor, points are taken where its one sheet is, within a tenth of the depth.
    """
    assert scanner.laser is not None
    rig = Rig(scanner.camera, scanner.laser)
    u, v, _, alpha = points_at(rig, depth)
    if fixed:
        alpha = np.full_like(u, scanner.laser.fixed_angle or 0.0)
        u, v = _on_sheet(rig, depth, v, float(alpha[0]))
    moved = np.zeros((len(u), 3, len(names)))
    values = scanner.values()
    for i, (name, step) in enumerate(zip(names, step_sizes(names), strict=True)):
        ends = []
        for sign in (1.0, -1.0):
            other = scanner.changed({name: values[name] + sign * step})
            assert other.laser is not None
            ends.append(Rig(other.camera, other.laser).triangulate(u, v, alpha).points)
        moved[:, :, i] = (ends[0] - ends[1]) / (2 * step)
    variance = np.einsum("nik,kl,nil->n", moved, covariance, moved)
    return Spread(depth, np.sqrt(np.maximum(variance, 0.0)).reshape(GRID[::-1]))


def _on_sheet(rig: Rig, depth: float, v: Floats, alpha: float) -> tuple[Floats, Floats]:
    """For rows v (n,), the columns where the sheet is at a depth; NaN where that is outside the image."""
    columns = np.linspace(0.0, rig.camera.width - 1.0, 401)
    u, rows = np.meshgrid(columns, v)
    there = rig.depth(rig.triangulate(u.ravel(), rows.ravel(), alpha).points).reshape(u.shape)
    off = np.abs(np.where(np.isfinite(there), 1.0 / there, np.inf) - 1.0 / depth)
    nearest = np.argmin(off, axis=1)
    far = off[np.arange(len(v)), nearest] > 0.1 / depth
    return np.where(far, np.nan, columns[nearest]), v


def errors_at(truth: Rig, found: Rig, depth: float) -> Floats:
    """Distances (n,) m by which `found` misplaces points at a depth whose pixels and alphas are those of `truth`."""
    u, v, points, alpha = points_at(truth, depth)
    return np.linalg.norm(found.triangulate(u, v, alpha).points - points, axis=1)
