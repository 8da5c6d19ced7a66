"""Distances along cylinders and their level of detection against py4dgeo's M3C2, which shares no code with ours."""

from __future__ import annotations

import numpy as np
import pytest
from test_compare_distance import clouds, sorted_points

from garbi_map.compare import kernels

RADIUS, REACH = 0.015, 0.08


def test_distances_and_levels_of_detection_are_those_of_py4dgeo() -> None:
    """Of two clouds of one floor, the second 3 mm higher, along given normals: to the nanometre."""
    py4dgeo = pytest.importorskip("py4dgeo", reason="the M3C2 of py4dgeo is not installed (extra: dev)")
    first, cores, normals = clouds(4)
    second = clouds(4)[0] + np.array([0.0, 0.0, 0.003])
    second[:, 2] += 0.001 * np.random.default_rng(5).standard_normal(len(second))
    own = []
    for points in (first, second):
        ordered, start, grid = sorted_points(points)
        own.append(kernels.cylinder_means(cores, normals, ordered, start, *grid, RADIUS, REACH, np.inf, 2))
    (here, scatter, _), (there, other, _) = own
    algorithm = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(first), py4dgeo.Epoch(second)),
        corepoints=cores,
        cyl_radius=RADIUS,
        max_distance=REACH,
        corepoint_normals=normals,
    )
    distance, uncertainty = algorithm.run()
    good = np.isfinite(here + there) & np.isfinite(distance)
    assert good.sum() > 40
    np.testing.assert_allclose((there - here)[good], distance[good], atol=1e-9)
    np.testing.assert_allclose(1.96 * np.sqrt(scatter + other)[good], uncertainty["lodetection"][good], rtol=1e-6)
