"""The camera: lens, port, rays and projection."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import TILTED_WINDOW, WINDOW, make_rig

from garbi_map.rig import Port

PORTS = [None, WINDOW, TILTED_WINDOW]
pixel = st.tuples(st.floats(-20.0, 790.0), st.floats(-20.0, 600.0))


@pytest.mark.parametrize("port", PORTS, ids=["bare", "port", "tilted port"])
@settings(max_examples=150, deadline=None)
@given(at=pixel, distance=st.floats(0.01, 20.0), k1=st.floats(-0.3, 0.3), k2=st.floats(-0.03, 0.03))
def test_a_point_on_a_ray_projects_to_its_pixel(port, at, distance, k1, k2):
    """project(rays(pixel) at any distance) is the pixel, to 1e-9 px."""
    rig = make_rig(port, (k1, k2, 3e-4, -4e-4, 0.01))
    origin, direction = rig.rays(*at)
    np.testing.assert_allclose(rig.project(origin + distance * direction)[0], at, atol=1e-9)


def test_projection_agrees_with_opencv():
    """cv2.projectPoints is an independent plumb_bob."""
    camera = make_rig(distortion=(-0.2, 0.05, 3e-4, -6e-4, 0.01)).camera
    points = np.random.default_rng(1).uniform([-0.6, -0.45, 0.8], [0.6, 0.45, 3.0], (500, 3))
    matrix = np.array([[camera.alpha_u, 0, camera.u0], [0, camera.alpha_v, camera.v0], [0, 0, 1.0]])
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


def test_what_the_camera_cannot_see_has_no_pixel():
    """Behind the camera, inside the port, and where the distortion has turned back, is NaN and not a wrong pixel."""
    bare = make_rig(distortion=(-0.3, 0.0, 0.0, 0.0, 0.0)).camera
    assert np.isnan(bare.project(np.array([[0.1, 0.0, -1.0], [0.0, 0.0, 0.0], [1.5, 0.0, 1.0]]))).all()
    assert np.isnan(make_rig(WINDOW).camera.project(np.array([[0.0, 0.0, 0.06], [0.01, 0.0, -2.0]]))).all()


def test_a_port_of_water_is_no_port():
    """With both indices 1 nothing is refracted: the same lines, the same pixels."""
    bare, clear = make_rig(), make_rig(replace(TILTED_WINDOW, index_glass=1.0, index_water=1.0))
    u, v = np.random.default_rng(2).uniform(0, [[767], [575]], (2, 300))
    origin, direction = bare.rays(u, v)
    shifted, same = clear.rays(u, v)
    np.testing.assert_allclose(same, direction, atol=1e-14)
    np.testing.assert_allclose(np.cross(shifted - origin, direction), 0.0, atol=1e-14)
    points = origin + 1.7 * direction
    np.testing.assert_allclose(clear.project(points), bare.project(points), atol=1e-9)


def test_snells_law_holds_at_both_faces():
    """index * sin(angle to the normal) is the same in air and water, in one plane; the offset is the two layers'."""
    camera = make_rig(TILTED_WINDOW).camera
    bare = replace(camera, port=None)
    u, v = np.random.default_rng(3).uniform(0, [[767], [575]], (2, 300))
    normal = np.array(TILTED_WINDOW.normal)
    _, air = bare.rays(u, v)
    origin, water = camera.rays(u, v)
    np.testing.assert_allclose(1.335 * np.cross(normal, water), np.cross(normal, air), atol=1e-14)
    np.testing.assert_allclose(origin @ normal, 0.062, atol=1e-15)
    sin_air = np.linalg.norm(np.cross(normal, air), axis=1)
    lateral = 0.05 * np.tan(np.arcsin(sin_air)) + 0.012 * np.tan(np.arcsin(sin_air / 1.49))
    np.testing.assert_allclose(np.linalg.norm(np.cross(normal, origin), axis=1), lateral, atol=1e-15)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(1e-3, 0.3), st.floats(0.0, 0.1), st.floats(1.0, 2.0), st.floats(1.0, 1.6),
    st.floats(0.0, 1.5), st.floats(0.0, 10.0),
)  # fmt: skip
def test_projection_through_any_port_converges(distance, thickness, glass, water, angle, beyond):
    """From the axis to grazing incidence, thin or thick, the angle in air is found again."""
    camera = replace(make_rig(distortion=(0.0,) * 5).camera, port=Port((0, 0, 1), distance, thickness, glass, water))
    u = camera.u0 + camera.alpha_u * np.tan(angle)
    origin, direction = camera.rays(u, camera.v0)
    found = camera.project(origin + beyond * direction)[0]
    assert np.arctan((found[0] - camera.u0) / camera.alpha_u) == pytest.approx(angle, abs=1e-9)


def test_undistortion_that_does_not_exist_is_nan():
    """Beyond the fold of a barrel polynomial a pixel has no ray."""
    camera = make_rig(distortion=(-0.9, 0.0, 0.0, 0.0, 0.0)).camera
    assert np.isnan(camera.rays(767.0, 575.0)[1]).all()
