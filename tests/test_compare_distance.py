"""Averages along cylinders against a search that shares no code with them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from garbi_map.compare import kernels


def clouds(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) of a bumpy floor, cores (k, 3) near it, unit normals (k, 3)."""
    random = np.random.default_rng(seed)
    points = random.uniform(-0.2, 0.2, (4000, 3))
    points[:, 2] = 0.05 * np.sin(12 * points[:, 0]) + 0.002 * random.standard_normal(len(points))
    cores = points[random.choice(len(points), 60, replace=False)] + 0.003 * random.standard_normal((60, 3))
    normals = random.standard_normal((60, 3)) + np.array([0.0, 0.0, 3.0])
    return points, cores, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def sorted_points(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, float, int, int]]:
    grid = (np.full(2, -0.25), 0.02, 25, 25)
    order, start = kernels.binned(points, *grid)
    return points[order[: start[-1]]], start, grid


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000))
def test_means_along_cylinders_are_those_of_a_brute_search(seed: int) -> None:
    """Mean, variance of the mean and count of the points within 2 cm of the middle one."""
    points, cores, normals = clouds(seed)
    ordered, start, grid = sorted_points(points)
    mean, variance, count = kernels.cylinder_means(cores, normals, ordered, start, *grid, 0.015, 0.08, 0.02, 4)
    for k, (core, normal) in enumerate(zip(cores, normals, strict=True)):
        away = points - core
        along = away @ normal
        near = (np.linalg.norm(away - along[:, None] * normal, axis=1) <= 0.015) & (np.abs(along) <= 0.08)
        own = along[near]
        own = own[np.abs(own - np.median(own)) <= 0.02] if len(own) >= 4 else own[:0]
        if len(own) < 4:
            assert np.isnan(mean[k])
            continue
        assert count[k] == len(own)
        np.testing.assert_allclose(mean[k], own.mean(), atol=1e-12)
        np.testing.assert_allclose(variance[k], own.var(ddof=1) / len(own), atol=1e-12)


def test_nearest_points_are_those_of_a_tree() -> None:
    """Within reach; infinite beyond."""
    points, cores, _ = clouds(1)
    ordered, start, grid = sorted_points(points)
    reach = np.linspace(0.001, 0.02, len(cores))
    true = cKDTree(points).query(cores)[0]
    found = kernels.nearest(cores, reach, ordered, start, *grid)
    np.testing.assert_allclose(found, np.where(true < reach, true, np.inf))


def test_normals_of_a_plane_are_its_own() -> None:
    """Upward, whatever the tilt; none where there are too few points."""
    random = np.random.default_rng(0)
    points = random.uniform(-0.2, 0.2, (3000, 3))
    points[:, 2] = 0.7 * points[:, 0] - 0.3 * points[:, 1]
    ordered, start, grid = sorted_points(points)
    cores = np.array([[0.0, 0.0, 0.0], [0.1, 0.05, 0.055], [0.0, 0.0, 0.2]])
    normals = kernels.surface_normals(cores, ordered, start, *grid, 0.03, 8)
    true = np.array([-0.7, 0.3, 1.0]) / np.linalg.norm([-0.7, 0.3, 1.0])
    np.testing.assert_allclose(normals[:2], [true, true], atol=1e-9)
    assert np.isnan(normals[2]).all()
