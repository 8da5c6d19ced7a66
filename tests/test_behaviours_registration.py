"""Registration to a surface that was seen before: what it tells, what it leaves to dead reckoning."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from behaviours.fit import Cylinder, Plane
from behaviours.patch import Patch
from behaviours.registration import Placed, Registration, Surface
from behaviours.types import Pose
from garbi_map.log.records import Floats
from tests.behaviour_parts import SECOND, START

EYE = np.array([0.45, 0.0, 0.0])
WALL = Plane(np.array([2.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), 1.0, np.ones(2))
PIPE = Cylinder(np.array([2.1, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.15, 1.0)


def lumps(y: Floats, z: Floats) -> Floats:
    """Points (n, 3) of a lumpy face about 1.9 m before the vehicle."""
    x = 1.9 + 0.08 * np.sin(6 * y + 1) * np.cos(5 * z) + 0.05 * np.sin(3 * z) + 0.25 * (y**2 + z**2)
    return np.stack([x, y, z], 1)


def lumpy() -> Patch:
    """The same face, remembered with 3 mm of noise."""
    rng = np.random.default_rng(1)
    points = lumps(*rng.uniform(-0.7, 0.7, (2, 6000)))
    return Patch(points + rng.normal(0, 0.003, points.shape), EYE)


def drifted(surface: Surface, show: object, seconds: float = 12.0, error: float = 0.01) -> tuple[Placed, Registration]:
    """A vehicle that stands still while navigation says that it moves by `error` m/s ahead, to port and up; the sheet
    passes over y to and fro. show(y) are the true points of a profile, base_link."""
    rng = np.random.default_rng(2)
    wrong = np.full(3, error)

    def navigation(time: float) -> Pose:
        return Pose(START + round(time * SECOND), wrong * time, np.eye(3), wrong, np.zeros(3))

    registration = Registration(navigation(0.0))
    for n in range(round(seconds * 25)):
        points = show(0.6 * np.sin(0.04 * n))  # type: ignore[operator]
        registration.carry(navigation(0.04 * n))
        registration.see(points + rng.normal(0, 0.002, points.shape), surface, 0.12)
    return registration.at(navigation(seconds)), registration


def line(y: float) -> tuple[Floats, Floats]:
    z = np.linspace(-0.5, 0.5, 40)
    return np.full(40, y), z


def wall_line(y: float) -> Floats:
    return np.stack([np.full(40, 2.0), *line(y)], 1)


def pipe_line(y: float) -> Floats:
    angle = np.linspace(-1.0, 1.0, 40)
    return np.stack([2.1 - 0.15 * np.cos(angle), np.full(40, y), 0.15 * np.sin(angle)], 1)


def test_a_wall_tells_the_range_and_leaves_the_rest_to_dead_reckoning() -> None:
    """After 12 s of a drift of 1 cm/s the range is right to 5 mm; along the wall the drift stays, and is not told."""
    placed, _ = drifted(WALL, wall_line)
    assert placed.position[0] == pytest.approx(0.0, abs=0.005)
    assert placed.position[1] == pytest.approx(0.12, abs=0.02)
    assert placed.told.tolist() == [True, False, False, False, True, True]


def test_a_pipe_tells_range_and_height_but_not_the_way_along_it() -> None:
    """The drift of 1 cm/s is gone ahead and up, and stays to port."""
    placed, _ = drifted(PIPE, pipe_line)
    assert placed.position[[0, 2]] == pytest.approx([0.0, 0.0], abs=0.01)
    assert placed.position[1] == pytest.approx(0.12, abs=0.02)
    assert placed.told[0] and not placed.told[1]


def test_a_textured_object_tells_the_whole_position() -> None:
    """Against a lumpy face seen before, the drift is gone on all three axes."""
    placed, _ = drifted(lumpy(), lambda y: lumps(*line(y)))
    assert np.abs(placed.position).max() < 0.015
    assert placed.told[:3].all()


def test_the_velocity_that_navigation_has_wrong_is_found() -> None:
    """Navigation says 1 cm/s ahead; the wall says that the vehicle stands."""
    placed, _ = drifted(WALL, wall_line)
    assert placed.velocity[0] == pytest.approx(0.0, abs=0.004)


def test_noise_on_a_flat_wall_is_no_texture() -> None:
    """A flat patch remembered with noise, so that its normals scatter, tells nothing along itself."""
    rng = np.random.default_rng(3)
    points = np.c_[np.full(6000, 2.0), rng.uniform(-0.7, 0.7, (6000, 2))]
    placed, _ = drifted(Patch(points + rng.normal(0, 0.003, points.shape), EYE), wall_line)
    assert not placed.told[1] and not placed.told[2]
    assert placed.position[0] == pytest.approx(0.0, abs=0.005)


def test_what_does_not_lie_on_the_surface_moves_nothing() -> None:
    """Points half a metre before the wall are no measurement of it."""
    registration = Registration(Pose(START, np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3)))
    share = registration.see(wall_line(0.0) - np.array([0.5, 0.0, 0.0]), WALL, 0.12)
    assert share == 0.0 and registration.position.tolist() == [0.0, 0.0, 0.0]


def test_surfaces_say_how_they_lie() -> None:
    """Range, yaw and pitch of a wall and a pipe from a vehicle that is turned."""
    turned = Rotation.from_euler("ZY", [0.2, 0.1]).as_matrix()
    eye = np.zeros(3)
    reach, yaw, pitch = WALL.from_here(eye, turned)
    assert reach == pytest.approx(2.0 / turned[0, 0])
    assert yaw == pytest.approx(-0.2, abs=0.01) and pitch == pytest.approx(-0.1, abs=0.01)
    reach, yaw, _ = PIPE.from_here(eye, Rotation.from_euler("Z", 0.2).as_matrix())
    assert reach == pytest.approx(1.95) and yaw == pytest.approx(-0.2)


def test_a_patch_needs_something_to_remember() -> None:
    """Too few points, or nothing but scatter, is no patch."""
    rng = np.random.default_rng(4)
    for points in (rng.uniform(0, 1, (20, 3)), rng.uniform(0, 0.5, (300, 3))):
        with pytest.raises(ValueError, match="patch"):
            Patch(points, EYE)
