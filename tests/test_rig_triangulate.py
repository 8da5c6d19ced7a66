"""The sheet, its meeting point with rays, and where in the image it can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs import TILTED_WINDOW, WINDOW, make_rig

from garbi_map.rig import Laser

PORTS = pytest.mark.parametrize("port", [None, WINDOW, TILTED_WINDOW], ids=["bare", "port", "tilted port"])


def test_the_sheet_is_the_papers_equation_4():
    """With theta = gamma = 0 the normal is the paper's expanded expression."""
    a, d, b = np.linspace(-1.0, 1.5, 40), 0.3, 0.1
    expected = np.stack(
        [
            -np.sin(a) * np.cos(b) * np.cos(d) - np.cos(a) * np.cos(b) * np.sin(d),
            -np.sin(a) * np.cos(b) * np.sin(d) + np.cos(a) * np.cos(b) * np.cos(d),
            np.full_like(a, -np.sin(b)),
        ],
        axis=1,
    )
    np.testing.assert_allclose(Laser(0, 0, 0, d, 0.0, 0.0, b).sheet(a), expected, atol=1e-15)


def test_all_sheets_touch_one_cone_about_the_axis():
    """Whatever alpha, the sheet makes the angle beta with the axis Ry(gamma) Rx(theta) Z."""
    laser = Laser(0, 0, 0, 0.2, 0.3, -0.2, 0.1)
    axis = np.array([np.sin(-0.2) * np.cos(0.3), -np.sin(0.3), np.cos(-0.2) * np.cos(0.3)])
    np.testing.assert_allclose(laser.sheet(np.linspace(-3, 3, 50)) @ axis, -np.sin(0.1), atol=1e-15)


def scene(rig, count=400):
    """Points of a slanting plane, each with the sheet that lights it: points (n, 3), alpha (n,), the plane's normal."""
    plane, offset = np.array([0.8, 0.5, 0.33]), 1.5
    alpha = np.linspace(0.05, 0.5, count)
    normals = rig.sheet(alpha)
    along = np.cross(normals, plane)
    start = np.array(
        [np.linalg.lstsq(np.stack([n, plane]), [n @ rig.laser.apex, offset], rcond=None)[0] for n in normals]
    )
    return start + along * np.random.default_rng(4).uniform(-0.3, 0.3, (count, 1)), alpha, plane / offset


@PORTS
def test_a_lit_plane_triangulates_onto_itself(port):
    """Points of a plane, projected and triangulated, come back to 1e-9 m and lie on the plane."""
    rig = make_rig(port)
    points, alpha, plane = scene(rig)
    u, v = rig.project(points).T
    found = rig.triangulate(u, v, alpha).points
    np.testing.assert_allclose(found, points, atol=1e-9)
    np.testing.assert_allclose(found @ plane, 1.0, atol=1e-9)


@PORTS
def test_derivatives_are_those_of_finite_differences(port):
    """d_du and d_dalpha against central differences."""
    rig = make_rig(port)
    points, alpha, _ = scene(rig)
    u, v = rig.project(points).T
    found = rig.triangulate(u, v, alpha)
    h = 1e-4
    by_u = (rig.triangulate(u + h, v, alpha).points - rig.triangulate(u - h, v, alpha).points) / (2 * h)
    np.testing.assert_allclose(found.d_du, by_u, rtol=1e-6, atol=1e-9)
    h = 1e-6
    by_alpha = (rig.triangulate(u, v, alpha + h).points - rig.triangulate(u, v, alpha - h).points) / (2 * h)
    np.testing.assert_allclose(found.d_dalpha, by_alpha, rtol=1e-6, atol=1e-7)


def test_rays_that_meet_no_sheet_are_nan():
    """Parallel to the sheet, or meeting it behind the camera."""
    rig = make_rig(distortion=(0.0,) * 5)
    straight = replace(rig, laser=Laser(0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0))
    camera = replace(straight.camera, position=(0.0, 0.0, 0.0), quaternion=(-0.5, 0.5, -0.5, 0.5))
    straight = replace(straight, camera=camera)
    found = straight.triangulate([camera.u0, camera.u0 - 50.0, camera.u0 + 50.0], camera.v0, 0.0)
    assert np.isnan(found.points[:2]).all()
    assert np.isnan(found.d_du[:2]).all()
    np.testing.assert_allclose(found.points[2, 0], 0.4 * camera.alpha_u / 50.0)


@PORTS
@pytest.mark.parametrize("distortion", [(-0.12, 0.033, 2e-4, 6e-4, 0.0), (-0.3, 0.1, 0.0, 0.0, 0.0)])
def test_the_column_window_holds_exactly_the_depths(port, distortion):
    """In each row the pixels half a pixel inside the window see the sheet within the depths, those outside do not."""
    rig = make_rig(port, distortion)
    near, far = 0.6, 3.0
    for alpha in (-0.05, 0.05, 0.2, 0.4, 0.6):
        first, last = rig.column_window(alpha, near, far)
        u, v = np.meshgrid(np.arange(768.0), np.arange(576.0))
        depth = rig.depth(rig.triangulate(u.ravel(), v.ravel(), alpha).points).reshape(u.shape)
        inside = (depth >= near) & (depth <= far)
        window = (u >= first[:, None] - 0.5) & (u <= last[:, None] + 0.5)
        core = (u >= first[:, None] + 0.5) & (u <= last[:, None] - 0.5)
        assert not (inside & ~window).any()
        assert not (core & ~inside).any()
        assert inside.any() or alpha in (-0.05, 0.6)


def test_the_column_window_of_an_unknown_angle_is_the_image():
    """Without an angle the stripe may be anywhere."""
    first, last = make_rig().column_window(float("nan"), 0.2, 5.0)
    assert (first == 0).all()
    assert (last == 767).all()
