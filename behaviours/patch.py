"""A piece of surface of any shape, remembered as it was first seen."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from garbi_map.log.records import Floats

CELL = 0.06  # m, between surfels
NEIGHBOURS = 30  # points that make a surfel's normal
ROUGH = 0.02  # m, 1 sigma off the surfel's plane, beyond which it is none
REACH = 0.08  # m, of a surfel along the surface


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
        """Range along the view of what lies about its axis, m; yaw and pitch to the patch's middle, rad."""
        seen = (self.centres - eye) @ rotation
        about = np.hypot(seen[:, 1], seen[:, 2]) < 0.35
        reach = float(np.median(seen[about, 0])) if about.sum() >= 5 else float("nan")
        middle = np.median(seen, axis=0)
        return reach, float(np.arctan2(middle[1], middle[0])), 0.0
