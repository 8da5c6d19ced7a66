"""The elevation grid as a triangulated surface to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.seabed.holes import fill_holes
from garbi_map.seabed.types import Mesh, Seabed


def triangulate(seabed: Seabed, max_triangles: int = 500_000, widest_hole: float = 0.0) -> Mesh:
    """Triangles between the centres of neighbouring known cells; none across a hole wider than `widest_hole` metres.

    Where there would be more triangles than asked for, cells are averaged 2 x 2, 3 x 3, ... first.
    Raises GarbiError when the grid is too small for a single triangle.
    """
    factor = 1
    while True:
        elevation = _coarsened(seabed, factor)
        known = np.isfinite(elevation)
        triangles = _triangles(known)
        if len(triangles) <= max_triangles:
            break
        factor = max(factor + 1, int(np.ceil(factor * np.sqrt(len(triangles) / max_triangles))))
    cell = seabed.cell * factor
    filled = np.zeros_like(known)
    if widest_hole > 0:
        elevation, filled = fill_holes(elevation, round(widest_hole / cell))
        triangles = _triangles(known | filled)
    if len(triangles) == 0:
        raise GarbiError("the seabed map is too sparse for a mesh: use larger cells (seabed.cell)")
    used, triangles = np.unique(triangles, return_inverse=True)
    row, column = np.unravel_index(used, elevation.shape)
    vertices = np.stack(
        [
            seabed.origin[0] + (column + 0.5) * cell,
            seabed.origin[1] + (row + 0.5) * cell,
            elevation[row, column].astype(np.float64),
        ],
        1,
    )
    return Mesh(vertices, triangles.reshape(-1, 3).astype(np.int32), filled[row, column])


def _coarsened(seabed: Seabed, factor: int) -> NDArray[np.float64]:
    """Elevation averaged over factor x factor cells by 1 / variance."""
    known = seabed.known
    weight = np.where(known, 1.0 / np.where(known, seabed.uncertainty, 1.0).astype(np.float64) ** 2, 0.0)
    total = weight * np.where(known, seabed.elevation, 0.0)
    weight, total = (
        np.add.reduceat(
            np.add.reduceat(band, np.arange(0, band.shape[0], factor), 0), np.arange(0, band.shape[1], factor), 1
        )
        for band in (weight, total)
    )
    return np.divide(total, weight, out=np.full_like(total, np.nan), where=weight > 0)


def _triangles(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(t, 3) flat indices: two triangles where all four corners of a square are known, one where three are."""
    number = np.arange(known.size).reshape(known.shape)
    sw, se, nw, ne = (
        (
            known[a : a + known.shape[0] - 1, b : b + known.shape[1] - 1],
            number[a:, b:][: known.shape[0] - 1, : known.shape[1] - 1],
        )
        for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))
    )
    parts = []
    for corners, absent in (((sw, se, ne), None), ((sw, ne, nw), None), ((sw, se, nw), ne), ((se, ne, nw), sw)):
        there = corners[0][0] & corners[1][0] & corners[2][0]
        if absent is not None:
            there &= ~absent[0]
        parts.append(np.stack([index[there] for _, index in corners], 1))
    return np.concatenate(parts)
