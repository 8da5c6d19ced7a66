"""The mesh is the grid, without what the grid does not have."""

from __future__ import annotations

import numpy as np
import pytest

from garbi_map.errors import GarbiError
from garbi_map.seabed import Mesh, Seabed, triangulate


def grid(elevation: np.ndarray, cell: float = 0.01) -> Seabed:
    """A finished grid with this elevation."""
    known = np.isfinite(elevation)
    nan = np.where(known, 0.001, np.nan).astype(np.float32)
    count = known.astype(np.int32)
    return Seabed((-1.0, 2.0), cell, elevation.astype(np.float32), nan, count, nan, nan, count)


def tilted(rows: int = 40, columns: int = 50) -> np.ndarray:
    """z = 0.1 x - 0.2 y over the cells' centres of `grid`."""
    y, x = np.mgrid[:rows, :columns]
    return 0.1 * (-1.0 + (x + 0.5) * 0.01) - 0.2 * (2.0 + (y + 0.5) * 0.01)


def area(mesh: Mesh) -> float:
    """Area seen from above, m^2; triangles that face down count against it."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k], :2] for k in range(3))
    return float(0.5 * np.sum((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]))


def test_a_plane_becomes_its_plane() -> None:
    """Every vertex is on it; the triangles cover it once and face up."""
    mesh = triangulate(grid(tilted()))
    np.testing.assert_allclose(mesh.vertices[:, 2], mesh.vertices @ [0.1, -0.2, 0.0], atol=1e-6)
    assert area(mesh) == pytest.approx(0.39 * 0.49)
    assert len(mesh.triangles) == 2 * 39 * 49
    assert not mesh.filled.any()


def test_wide_holes_stay_open_and_small_ones_are_closed_and_flagged() -> None:
    """A hole of 10 x 10 cells stays, one of 2 x 2 is interpolated."""
    elevation = tilted()
    elevation[5:15, 5:15] = np.nan
    elevation[30:32, 30:32] = np.nan
    mesh = triangulate(grid(elevation), widest_hole=0.02)
    assert mesh.filled.sum() == 4
    np.testing.assert_allclose(mesh.vertices[:, 2], mesh.vertices @ [0.1, -0.2, 0.0], atol=1e-6)
    inside = (np.abs(mesh.vertices[:, 0] + 0.9) < 0.045) & (np.abs(mesh.vertices[:, 1] - 2.1) < 0.045)
    assert not inside.any()
    assert area(mesh) == pytest.approx(0.39 * 0.49 - 0.11**2 + 4 * 0.5 * 0.01**2, rel=1e-6)


def test_a_mesh_is_no_larger_than_asked_for() -> None:
    """Cells are averaged until it fits; the surface stays where it is."""
    mesh = triangulate(grid(tilted(300, 300)), max_triangles=5000)
    assert 1000 < len(mesh.triangles) <= 5000
    np.testing.assert_allclose(mesh.vertices[:, 2], mesh.vertices @ [0.1, -0.2, 0.0], atol=1e-5)


def test_a_grid_without_neighbours_has_no_mesh() -> None:
    """One line for the user."""
    elevation = np.full((9, 9), np.nan)
    elevation[::4, ::4] = 1.0
    with pytest.raises(GarbiError, match="too sparse"):
        triangulate(grid(elevation))
