"""Robust shapes through points: a plane, a cylinder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats

HYPOTHESES = 40
ROUNDS = 6


@dataclass(frozen=True)
class Plane:
    """point (3,) on it, unit normal (3,); share of the points that lie on it; spread (2,) m, 1 sigma along it,
    smaller first."""

    point: Floats
    normal: Floats
    share: float
    spread: Floats

    def off(self, points: Floats) -> tuple[Floats, Floats]:
        """See `registration.Surface`."""
        return (points - self.point) @ self.normal, np.broadcast_to(self.normal, points.shape)

    def from_here(self, eye: Floats, rotation: Floats) -> tuple[float, float, float]:
        """Range along the view, m; yaw and pitch, rad, by which a vehicle so turned (3, 3) has to turn to face it."""
        facing = self.normal @ rotation
        facing = facing if facing[0] > 0 else -facing
        reach = float(facing @ ((self.point - eye) @ rotation) / max(float(facing[0]), 1e-3))
        pitch = -np.arctan2(facing[2], np.hypot(facing[0], facing[1]))
        return reach, float(np.arctan2(facing[1], facing[0])), float(pitch)


@dataclass(frozen=True)
class Cylinder:
    """point (3,) on the axis, unit axis (3,), radius m; share of the points that lie on it."""

    point: Floats
    axis: Floats
    radius: float
    share: float

    def off(self, points: Floats) -> tuple[Floats, Floats]:
        """See `registration.Surface`."""
        away = points - self.point
        away = away - (away @ self.axis)[:, None] * self.axis
        distance = np.linalg.norm(away, axis=1)
        return distance - self.radius, away / np.maximum(distance, 1e-9)[:, None]

    def from_here(self, eye: Floats, rotation: Floats) -> tuple[float, float, float]:
        """Range to its skin, m; yaw, rad, to face it square; it fixes no pitch."""
        away = (self.point - eye) @ rotation
        axis = self.axis @ rotation
        away = away - (away @ axis) * axis
        return float(np.linalg.norm(away)) - self.radius, float(np.arctan2(away[1], away[0])), 0.0


def fit_plane(points: Floats, tolerance: float) -> Plane | None:
    """The plane through points (n, 3) that the most of them support within 2.5 tolerances (m, 1 sigma); None: too few.

    RANSAC (Fischler and Bolles, 1981) with fixed draws, then least squares with Tukey's weights.
    """
    if len(points) < 10:
        return None
    rng = np.random.default_rng(len(points))
    some = points[rng.permutation(len(points))[:400]]
    a, b, c = (some[rng.integers(0, len(some), HYPOTHESES)] for _ in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    usable = length > 1e-4
    if not usable.any():
        return None
    normals, a = normals[usable] / length[usable, None], a[usable]
    off = np.abs((some[None] - a[:, None]) @ normals[:, :, None])[:, :, 0]
    best = int((off < 2.5 * tolerance).sum(1).argmax())
    centre, normal = a[best], normals[best]
    spread = np.zeros(2)
    for _ in range(ROUNDS):
        residual = (points - centre) @ normal
        weight = np.clip(1 - (residual / (4 * tolerance)) ** 2, 0.0, None) ** 2
        if (weight > 0).sum() < 10:
            return None
        centre = (weight[:, None] * points).sum(0) / weight.sum()
        apart = points - centre
        values, vectors = np.linalg.eigh((weight[:, None] * apart).T @ apart / weight.sum())
        normal, spread = vectors[:, 0], np.sqrt(np.maximum(values[1:], 0.0))
    share = float((np.abs((points - centre) @ normal) < 2.5 * tolerance).mean())
    return Plane(centre, normal, share, spread)


def fit_cylinder(points: Floats, eye: Floats, tolerance: float) -> Cylinder | None:
    """The cylinder through points (n, 3) of its side that faces eye (3,); longer than it is thick; None: none.

    Gauss-Newton on the distances to the surface, Tukey's weights; the start from the points' principal axis.
    """
    from scipy.optimize import least_squares

    if len(points) < 30:
        return None
    rng = np.random.default_rng(len(points))
    some = points[rng.permutation(len(points))[:300]]
    middle = np.median(some, axis=0)
    values, vectors = np.linalg.eigh(np.cov((some - middle).T))
    axis = vectors[:, 2]
    away = middle - eye
    away -= (away @ axis) * axis
    away /= max(float(np.linalg.norm(away)), 1e-9)
    side = np.cross(axis, away)
    width = float(np.percentile(np.abs((some - middle) @ side), 90))
    first = np.array([0.0, 0.0, 0.0, 0.0, max(width, 0.03)])

    def shape(x: Floats) -> tuple[Floats, Floats]:
        direction = axis + x[2] * away + x[3] * side
        return middle + x[0] * side + (x[1] + x[4]) * away, direction / np.linalg.norm(direction)

    def residual(x: Floats) -> Floats:
        point, direction = shape(x)
        return (np.linalg.norm(np.cross(some - point, direction), axis=1) - abs(x[4])) / tolerance

    found = least_squares(residual, first, loss="soft_l1", max_nfev=40)
    point, direction = shape(found.x)
    radius = float(abs(found.x[4]))
    share = float((np.abs(residual(found.x)) < 2.5).mean())
    if radius > 1.0 or values[2] < values[1]:
        return None
    return Cylinder(point, direction, radius, share)
