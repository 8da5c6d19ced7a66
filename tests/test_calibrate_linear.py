"""The linear solves: exact from noise-free points, and refused where nothing follows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.linear import solve_camera, solve_laser, solve_laser_paper
from garbi_map.errors import GarbiError
from garbi_map.rig import Laser
from tools.simulator.target_points import TWO_PLANES, target_of


def on_sheets(laser: Laser, alphas: np.ndarray, heights: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on the sheets, at heights z and any distance."""
    rng = np.random.default_rng(seed)
    alpha, z = (values.ravel() for values in np.meshgrid(alphas, heights))
    points = np.column_stack([rng.uniform(0.7, 2.0, len(z)), np.zeros(len(z)), z])
    normal = laser.sheet(alpha)
    points[:, 1] = -np.einsum("ij,ij->i", normal, points - laser.apex) / normal[:, 1]
    return points, alpha


angles = st.floats(-0.15, 0.15)


@settings(max_examples=40, deadline=None)
@given(x=angles, y=st.floats(-0.6, -0.2), z=angles, delta=st.floats(-0.5, 0.5), beta=st.floats(0.01, 0.2))
def test_five_columns_find_every_parameter(x, y, z, delta, beta):
    """Noise-free points at any heights give all five parameters to 1e-6."""
    laser = Laser(x, y, z, delta, 0.0, 0.0, beta)
    points, alpha = on_sheets(laser, np.linspace(0.1, 0.6, 9) - delta, np.linspace(-0.3, 0.3, 7), 1)
    found = solve_laser(points, alpha)
    expected = [x, y, z, delta, beta]
    np.testing.assert_allclose([found.x, found.y, found.z, found.delta, found.beta], expected, atol=1e-6)


def test_the_papers_two_sets_corrected_and_as_printed():
    """Corrected, (9) and (10) are exact; as printed, beta and Z are not even near."""
    laser = Laser(0.02, -0.4, 0.03, 0.05, 0.0, 0.0, 0.04)
    low, high = (on_sheets(laser, np.linspace(0.1, 0.6, 9), np.array([z]), 2) for z in (0.0, 0.1))
    right, printed = solve_laser_paper(low, high), solve_laser_paper(low, high, as_printed=True)
    np.testing.assert_allclose([right.x, right.y, right.z, right.beta], [0.02, -0.4, 0.03, 0.04], atol=1e-9)
    np.testing.assert_allclose([printed.x, printed.y, printed.delta], [0.02, -0.4, 0.05], atol=1e-9)
    assert abs(printed.beta - 0.04) > 0.01
    assert abs(printed.z - 0.03) > 0.1


def test_one_angle_does_not_determine_a_laser():
    """A single sheet says nothing about the axis."""
    laser = Laser(0.02, -0.4, 0.03, 0.05, 0.0, 0.0, 0.04)
    with pytest.raises(GarbiError, match="do not determine the laser"):
        solve_laser(*on_sheets(laser, np.array([0.3]), np.linspace(-0.3, 0.3, 50), 3))


def seen_two_planes(mirror: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    target = target_of(TWO_PLANES)
    here = Rotation.from_euler("yx", [-0.8, -0.15]).apply(target.points) + np.array([0.05, 0.02, 1.0])
    return target.points, here[:, :2] / here[:, 2:] * [mirror * 812.0, 816.0] + [mirror * 370.0, 290.0]


def test_the_linear_camera_is_exact():
    """Eleven unknowns from the two-plane target: intrinsics and pose to 1e-6."""
    camera = solve_camera(*seen_two_planes())
    found = [camera.alpha_u, camera.alpha_v, camera.u0, camera.v0]
    np.testing.assert_allclose(found, [812.0, 816.0, 370.0, 290.0], atol=1e-6)
    np.testing.assert_allclose(camera.translation, [0.05, 0.02, 1.0], atol=1e-9)


def test_a_mirrored_image_is_refused():
    """Flipped columns make a left-handed camera."""
    with pytest.raises(GarbiError, match="mirrored"):
        solve_camera(*seen_two_planes(-1.0))


def test_a_flat_target_is_refused_by_the_linear_camera():
    """One plane has a family of answers."""
    points, pixels = seen_two_planes()
    with pytest.raises(GarbiError, match="one plane"):
        solve_camera(points[:80], pixels[:80])
