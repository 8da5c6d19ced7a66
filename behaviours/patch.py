"""A piece of surface of any shape, remembered as it was first seen."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from garbi_map.log.records import Floats

CELL = 0.08  # m, between surfels
NEIGHBOURS = 30  # points that make a surfel's normal
ROUGH = 0.02  # m, 1 sigma off the surfel's plane, beyond which it is none
REACH = 0.12  # m, of a surfel along the surface
VIEW = 0.2  # tangent of the half angle about the axis of the view whose middle range counts
RAYS = np.array([[1.0, y, z] for y in np.linspace(-VIEW, VIEW, 9) for z in np.linspace(-VIEW, VIEW, 9)])


class Patch:
    """Surfels: a mean and a normal each, towards the eye. Raises ValueError where the points (n, 3) make fewer than ten."""

    def __init__(self, points: Floats, eye: Floats) -> None:
        cells, inverse = np.unique(np.floor(points / CELL).astype(np.int64), axis=0, return_inverse=True)
        count = np.bincount(inverse.ravel())
        centres = np.stack([np.bincount(inverse.ravel(), points[:, axis]) for axis in range(3)], 1) / count[:, None]
        if len(points) < NEIGHBOURS or len(cells) < 10:
            raise ValueError("too few points for a patch")
        _, near = cKDTree(points).query(centres, NEIGHBOURS)
        apart = points[near] - points[near].mean(1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", apart, apart) / NEIGHBOURS)
        flat = (values[:, 0] < ROUGH**2) & (values[:, 1] > 9 * values[:, 0])
        if flat.sum() < 10:
            raise ValueError("nothing flat enough for a patch")
        self.centres: Floats = points[near].mean(1)[flat]
        normal = vectors[flat, :, 0]
        self.normals: Floats = normal * np.sign((normal * (eye - self.centres)).sum(1))[:, None]
        self._tree = cKDTree(self.centres)

    def off(self, points: Floats) -> tuple[Floats, Floats]:
        """See `registration.Surface`."""
        distance, nearest = self._tree.query(points)
        away = points - self.centres[nearest]
        off = (away * self.normals[nearest]).sum(1)
        aside = np.sqrt(np.maximum(distance**2 - off**2, 0.0))
        return np.where(aside < REACH, off, np.nan), self.normals[nearest]

    def from_here(self, eye: Floats, rotation: Floats) -> tuple[float, float, float]:
        """Range along the view, m: the median over rays within VIEW of its axis; yaw, rad, to the patch's middle.

        Each ray meets the plane of the surfel that is nearest in bearing."""
        seen = (self.centres - eye) @ rotation
        ahead = seen[:, 0] > 0.2
        seen, normals = seen[ahead], self.normals[ahead] @ rotation
        if len(seen) < 10:
            return float("nan"), 0.0, 0.0
        apart, nearest = cKDTree(seen[:, 1:] / seen[:, :1]).query(RAYS[:, 1:])
        across = (normals[nearest] * RAYS).sum(1)
        reach = (normals[nearest] * seen[nearest]).sum(1) / np.where(np.abs(across) > 0.1, across, np.nan)
        reach = np.where((apart < REACH) & (np.abs(reach - seen[nearest, 0]) < REACH), reach, np.nan)
        middle = np.median(seen, axis=0)
        met = np.isfinite(reach)
        found = float(np.median(reach[met])) if met.sum() > len(RAYS) / 4 else float("nan")
        return found, float(np.arctan2(middle[1], middle[0])), 0.0
