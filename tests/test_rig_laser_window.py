"""A laser sheet behind a window: refraction against rays that are traced forwards, one face after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs import TILTED_WINDOW, make_rig
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.rig import LaserWindow, Rig, parse_rig

TILTED = tuple(Rotation.from_euler("zy", [0.35, 0.1]).as_matrix()[:, 0].tolist())
WINDOWS = [
    LaserWindow("flat", TILTED, 0.04, 0.01, 1.49, 1.335),
    LaserWindow("turning", TILTED, 0.04, 0.01, 1.49, 1.335),
    LaserWindow("cylinder", (1.0, 0.0, 0.0), 0.04, 0.01, 1.49, 1.335),
]


def behind(window: LaserWindow | None, port=None) -> Rig:
    rig = make_rig(port)
    return replace(rig, laser=replace(rig.laser, window=window))


def snell(direction: np.ndarray, normal: np.ndarray, ratio: float) -> np.ndarray:
    """Direction beyond a face with its normal along the light; ratio: index before over index after."""
    c = direction @ normal
    return ratio * direction + (np.sqrt(1 - ratio**2 * (1 - c * c)) - ratio * c) * normal


def traced(rig: Rig, alpha: float, fan: float, reach: float) -> np.ndarray:
    """Where the ray at angle `fan` in the sheet is after `reach` metres of water."""
    laser, window = rig.laser, rig.laser.window
    turn = Rotation.from_matrix(laser.axis) * Rotation.from_euler("z", alpha + laser.delta)
    own = turn * Rotation.from_euler("x", -laser.beta)
    direction = own.apply([np.cos(fan), 0.0, np.sin(fan)])
    point = np.zeros(3)
    indices = [1.0, window.index_glass, window.index_water]
    axis = laser.axis[:, 2]
    for face in (0, 1):
        deep = window.distance + face * window.thickness
        if window.kind == "cylinder":
            across, start = direction - (direction @ axis) * axis, point - (point @ axis) * axis
            a, b, c = across @ across, across @ start, start @ start - deep**2
            point = point + (-b + np.sqrt(b * b - a * c)) / a * direction
            normal = point - (point @ axis) * axis
            normal /= np.linalg.norm(normal)
        else:
            normal = np.array(window.normal) if window.kind == "flat" else turn.apply(window.normal)
            point = point + (deep - point @ normal) / (direction @ normal) * direction
        direction = snell(direction, normal, indices[face] / indices[face + 1])
    return laser.apex + point + reach * direction


@pytest.mark.parametrize("port", [None, TILTED_WINDOW])
@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_triangulation_finds_the_point_that_a_traced_ray_reaches(window, port):
    """Light traced from the apex through both faces, seen by the camera, comes out where it was, to a nanometre."""
    rig = behind(window, port)
    alpha = np.repeat([0.1, 0.25, 0.4], 9)
    points = np.array([traced(rig, a, f, r) for a in (0.1, 0.25, 0.4) for f in (-0.2, 0.0, 0.2) for r in (0.8, 1.3, 2)])
    pixel = rig.project(points)
    found = rig.triangulate(pixel[:, 0], pixel[:, 1], alpha).points
    np.testing.assert_allclose(found, points, atol=1e-9)
    np.testing.assert_allclose(rig.laser.off_sheet(points, alpha), 0.0, atol=1e-12)


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_derivatives_behind_a_window_are_the_differences(window):
    """d_du and d_dalpha against central differences."""
    rig, h = behind(window, TILTED_WINDOW), 1e-4
    points = np.array([traced(rig, 0.25, f, r) for f in (-0.2, 0.1) for r in (0.8, 1.5)])
    u, v = rig.project(points).T
    found = rig.triangulate(u, v, 0.25)
    by_u = (rig.triangulate(u + h, v, 0.25).points - rig.triangulate(u - h, v, 0.25).points) / (2 * h)
    by_alpha = (rig.triangulate(u, v, 0.25 + h).points - rig.triangulate(u, v, 0.25 - h).points) / (2 * h)
    np.testing.assert_allclose(found.d_du, by_u, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(found.d_dalpha, by_alpha, rtol=1e-4, atol=1e-7)


def test_a_window_of_air_is_no_window():
    """Indices of one leave the plane."""
    plain, aired = behind(None), behind(LaserWindow("flat", TILTED, 0.04, 0.01, 1.0, 1.0))
    u = np.linspace(100.0, 600.0, 20)
    expected = plain.triangulate(u, 250.0, 0.3)
    for one, other in zip(aired.triangulate(u, 250.0, 0.3), expected, strict=True):
        seen = np.isfinite(one[:, 0])
        assert seen.sum() > 5
        np.testing.assert_allclose(one[seen], other[seen], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_the_column_window_holds_the_refracted_stripe(window):
    """Every traced point between the ranges lies inside its row's window, widened by half a pixel."""
    rig = behind(window)
    points = np.array([traced(rig, 0.3, f, r) for f in np.linspace(-0.3, 0.3, 40) for r in np.linspace(0.5, 3.5, 20)])
    depth, pixel = rig.depth(points), rig.project(points)
    first, last = rig.column_window(0.3, 0.7, 3.0)
    height, width = rig.camera.height, rig.camera.width
    inside = ((pixel >= 0) & (pixel <= [width - 1, height - 1])).all(axis=1) & (depth > 0.7) & (depth < 3.0)
    assert inside.sum() > 100
    row = np.round(pixel[inside, 1]).astype(int)
    assert (pixel[inside, 0] >= first[row] - 1.0).all()
    assert (pixel[inside, 0] <= last[row] + 1.0).all()


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_the_rig_file_keeps_the_window(window):
    """Written and read again."""
    assert parse_rig(behind(window).to_yaml(), "r").laser.window == window


def test_a_window_of_an_unknown_kind_is_refused():
    """One line names the key."""
    text = behind(WINDOWS[0]).to_yaml().replace("kind: flat", "kind: round")
    with pytest.raises(GarbiError, match=r"r: laser\.window\.kind"):
        parse_rig(text, "r")
