"""A surface in three dimensions, for walls and overhangs: what an elevation grid cannot hold.

Screened Poisson reconstruction (Kazhdan and Hoppe, 2013) by Open3D, tile by tile.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from garbi_map.errors import GarbiError
from garbi_map.seabed.settings import SolidSettings
from garbi_map.seabed.types import Mesh

Floats = NDArray[np.float64]

_MARGIN = 0.1
"""Of a tile's side, by which it sees into its neighbours."""
_NEIGHBOURS = 30
_LEAST = 200
"""Averaged points of a tile that are worth a surface."""
_PENDING = 400_000
"""Points of a tile that wait to be averaged."""
_FACING = 0.5
"""Cosine between a surface's normal and that of the nearest point, from which on the two are of one surface."""
_HALF = 1 << 20


class SolidSurface:
    """`add` points and where they were seen from, in any order; `finish` gives the surface.

    Memory grows with the surface's area: points are averaged in voxels, tile by tile.
    """

    def __init__(self, settings: SolidSettings) -> None:
        self._settings = settings
        self._tiles: dict[tuple[int, int, int], list[Floats]] = defaultdict(list)

    def add(self, points: Floats, eyes: Floats) -> None:
        """Take in points (n, 3) m in `map`, each seen from its eye (n, 3)."""
        if not len(points):
            return
        view = eyes - points
        view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-9)
        rows = _averaged(np.concatenate([points, view, np.ones((len(points), 1))], axis=1), self._settings.voxel)
        home = np.floor(_centres(rows) / self._settings.tile).astype(int)
        tiles, member = np.unique(home, axis=0, return_inverse=True)
        order = np.argsort(member.ravel(), kind="stable")
        for tile, part in zip(tiles, np.split(rows[order], np.cumsum(np.bincount(member.ravel()))[:-1]), strict=True):
            waiting = self._tiles[int(tile[0]), int(tile[1]), int(tile[2])]
            waiting.append(part)
            if sum(map(len, waiting)) > _PENDING:
                waiting[:] = [_averaged(np.concatenate(waiting), self._settings.voxel)]

    def finish(self) -> Mesh:
        """The surface where it was seen, (v, 3) in `map`. Raises GarbiError where there is none."""
        parts = [part for tile in sorted(self._tiles) for part in self._tile(tile)]
        if not parts:
            raise GarbiError("too few points for a surface in three dimensions")
        shift = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
        vertices = np.concatenate([vertices for vertices, _ in parts])
        triangles = np.concatenate([one + first for (_, one), first in zip(parts, shift, strict=True)])
        return Mesh(vertices, triangles.astype(np.int32), np.zeros(len(vertices), bool))

    def _tile(self, tile: tuple[int, int, int]) -> Iterator[tuple[Floats, NDArray[np.int64]]]:
        """Vertices and triangles of one tile, made with a margin and cut at its sides."""
        import open3d as o3d

        own = self._settings
        low = np.array(tile) * own.tile
        high = low + own.tile
        margin = _MARGIN * own.tile
        rows = self._about(tile)
        points = _centres(rows)
        near = ((points > low - margin) & (points < high + margin)).all(axis=1)
        points, view = points[near] - low, rows[near, 3:6]
        if len(points) < _LEAST:
            return
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=own.normal_radius, max_nn=_NEIGHBOURS))
        normals = np.asarray(cloud.normals)
        normals[(normals * view).sum(1) < 0] *= -1  # towards where it was seen from
        depth = int(np.ceil(np.log2(np.ptp(points, axis=0).max() * 1.1 / own.voxel)))
        mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=int(np.clip(depth, 4, own.deepest)), n_threads=1
        )
        vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
        tree = cKDTree(points)
        seen = (tree.query(vertices)[0] < own.reach)[triangles].all(axis=1)
        middle = vertices[triangles].mean(axis=1)
        inside = ((middle >= 0) & (middle < own.tile)).all(axis=1)
        mesh.compute_triangle_normals()
        # where the points end the surface turns off to close itself, and faces elsewhere
        facing = (np.asarray(mesh.triangle_normals) * normals[tree.query(middle)[1]]).sum(axis=1) > _FACING
        triangles = triangles[seen & inside & facing]
        if len(triangles):
            used, triangles = np.unique(triangles, return_inverse=True)
            yield vertices[used] + low, triangles.reshape(-1, 3)

    def _about(self, tile: tuple[int, int, int]) -> Floats:
        """Averaged rows of a tile and of its neighbours."""
        parts: list[Floats] = []
        for step in np.ndindex(3, 3, 3):
            index = (tile[0] + step[0] - 1, tile[1] + step[1] - 1, tile[2] + step[2] - 1)
            waiting = self._tiles.get(index)
            if waiting:
                waiting[:] = [_averaged(np.concatenate(waiting), self._settings.voxel)]
                parts.append(waiting[0])
        return np.concatenate(parts)


def _centres(rows: Floats) -> Floats:
    return rows[:, :3] / rows[:, 6:]


def _averaged(rows: Floats, voxel: float) -> Floats:
    """Sums (k, 7) of place, view and count of all rows (n, 7) whose mean lies in one voxel."""
    index = np.floor(_centres(rows) / voxel).astype(np.int64) + _HALF
    key = (index[:, 0] << 42) | (index[:, 1] << 21) | index[:, 2]
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0])
    return np.add.reduceat(rows[order], first, axis=0)
