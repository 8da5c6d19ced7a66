"""A stony floor with a formula, a scanner that sways over it, and what its sensors would say: truth of the register tests.

The rig looks down from 1.4 m; its sheet swings forth and back by 20 degrees in sweeps of two seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_navigation import BEGIN_NS, GRAVITY, derivative, seconds, stamps

from garbi_map.evaluate import rigid_alignment
from garbi_map.log.records import Dvl, Floats, Imu, Mount, Navigation, Pressure, Stamps
from garbi_map.navigate import NavigateSettings, NavigationResult, Trajectory, navigate
from garbi_map.navigate.deskew import place
from garbi_map.register import Registered, RegisterSettings, register
from garbi_map.register.settings import DriftSettings
from garbi_map.sweep.store import SweepStore
from garbi_map.sweep.types import Sweep

MOUNTS = {
    "imu_link": Mount(np.array([-0.10, 0.02, 0.05])),
    "dvl_link": Mount(np.array([-0.20, 0.05, -0.10]), Rotation.from_euler("z", 45.0, degrees=True).as_quat()),
    "pressure_link": Mount(np.array([0.10, 0.0, 0.10])),
    "rig": Mount(np.array([0.25, 0.0, -0.10]), Rotation.from_euler("x", 180.0, degrees=True).as_quat()),
}
SWEEP = 2.0
"""s"""
PROFILES = 20
"""per second"""
RAYS = 80
NOISE = 3e-4
"""m along the ray, 1 sigma"""

_STONES = np.random.default_rng(77)
_STONE_AT = _STONES.uniform([-1.5, -1.0], [2.0, 1.0], (120, 2))
_STONE_HEIGHT = _STONES.uniform(-0.03, 0.07, 120)
_STONE_WIDTH = _STONES.uniform(0.06, 0.14, 120)


def wavy(x: Floats, y: Floats) -> Floats:
    """Height (n,) m of a floor of ripples and a hundred smooth stones and pits."""
    z = -3.0 + 0.03 * np.sin(4.0 * x + 1.0) + 0.03 * np.sin(3.4 * y + 1.5 * x)
    for (cx, cy), height, width in zip(_STONE_AT, _STONE_HEIGHT, _STONE_WIDTH, strict=True):
        z = z + height * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * width**2))
    return z


def flat(x: Floats, y: Floats) -> Floats:
    """A floor on which nothing is to be seen."""
    return np.full(np.shape(x), -3.0)


Floor = Callable[[Floats, Floats], Floats]


def position(t: Floats) -> Floats:
    """Base_link (n, 3) m: forth and back within a metre in 24 s, with 4 cm of sway in every axis; begins at x = y = 0."""
    x = 0.4 * np.sin(0.26 * t) + 0.04 * np.sin(1.5 * t)
    y = 0.15 * np.sin(0.13 * t) + 0.04 * (np.sin(1.2 * t + 0.5) - np.sin(0.5))
    return np.stack([x, y, -1.6 + 0.04 * np.sin(0.9 * t + 1.0)], axis=-1)


def rotation(t: Floats) -> Rotation:
    """map <- base_link: two degrees of roll and pitch, a slow yaw of some degrees."""
    roll, pitch = 0.035 * np.sin(1.1 * t), 0.035 * np.sin(0.8 * t + 0.7)
    return Rotation.from_euler("ZYX", np.stack([0.3 + 0.1 * np.sin(0.2 * t), pitch, roll], axis=-1))


@dataclass(frozen=True)
class Suite:
    """What is wrong with the sensors: constant unless it says per sample."""

    rate: float = 3e-4  # rad/s per sample
    rate_bias: tuple[float, float, float] = (1e-3, -8e-4, 5e-4)  # rad/s
    force: float = 0.01  # m/s^2 per sample
    force_bias: tuple[float, float, float] = (0.04, -0.03, 0.02)  # m/s^2
    tilt: float = 3e-3  # rad, slow
    dvl: float = 4e-3  # m/s per sample
    dvl_scale: float = 0.005
    depth: float = 3e-3  # m per sample


@dataclass(frozen=True)
class Dive:
    """Stored sweeps, the other sensors, and the floor they were taken of."""

    store: SweepStore
    log: Navigation
    floor: Floor


def dive(
    folder: Path,
    duration: float,
    floor: Floor = wavy,
    seed: int = 0,
    suite: Suite | None = None,
    sensors: tuple[str, ...] = ("attitude", "pressure", "dvl"),
) -> Dive:
    """A dive of so many seconds, always with an IMU; `sensors`: what else is aboard."""
    suite, random = suite or Suite(), np.random.default_rng(seed)
    log = Navigation(
        imu=_imu(random, duration, suite, "attitude" in sensors),
        pressure=_pressure(random, duration, suite) if "pressure" in sensors else None,
        dvl=_dvl(random, duration, suite) if "dvl" in sensors else None,
        mounts=MOUNTS,
    )
    store = SweepStore(folder)
    for number in range(int(duration / SWEEP)):
        store.add(sweep(number, floor, random))
    store.finish([])
    return Dive(store, log, floor)


def sweep(number: int, floor: Floor, random: np.random.Generator, finer: int = 1) -> Sweep:
    """What the scanner sees of the floor from SWEEP * number seconds on; finer: times as many profiles and rays."""
    profiles, rays = PROFILES * finer, RAYS * finer
    t = SWEEP * number + np.arange(0.5 / profiles, SWEEP, 1 / profiles)
    alpha = np.deg2rad(20.0) * (2.0 * (t / SWEEP - number) - 1.0) * (-1) ** number
    across = np.deg2rad(np.linspace(-17.0, 17.0, rays))
    ray = np.stack(
        [
            np.broadcast_to(np.sin(alpha)[:, None], (len(t), rays)),
            np.cos(alpha)[:, None] * np.sin(across),
            np.cos(alpha)[:, None] * np.cos(across),
        ],
        axis=-1,
    ).reshape(-1, 3)
    profile = np.repeat(np.arange(len(t)), rays)
    mount = MOUNTS["rig"]
    turned = (rotation(t) * Rotation.from_quat(mount.quaternion))[profile].apply(ray)
    origin = (position(t) + rotation(t).apply(mount.translation))[profile]
    length = _hit(origin, turned, floor) + random.normal(0.0, NOISE, len(ray))
    n = len(ray)
    return Sweep(
        index=number,
        stamp_ns=BEGIN_NS + np.round(t * 1e9).astype(np.int64),
        alpha=alpha,
        points=ray * length[:, None],
        sigma=np.full(n, NOISE, np.float32),
        intensity=np.full(n, 100.0, np.float32),
        profile=profile.astype(np.int32),
        row=np.tile(np.arange(rays, dtype=np.int32), len(t)),
    )


def true_trajectory(stamp_ns: Stamps) -> Trajectory:
    """Where the vehicle was."""
    t = seconds(stamp_ns)
    return Trajectory(stamp_ns, position(t), rotation(t).as_quat(), np.zeros((len(t), 6, 6)))


def points_of(one: Dive, trajectory: Trajectory) -> Floats:
    """All points (n, 3) of a dive as a trajectory of base_link places them."""
    rig = trajectory.mounted(MOUNTS["rig"])
    return np.concatenate([place(each, rig) for each in one.store])


def register_dive(one: Dive, scanner: Any = None, **drift: float) -> tuple[Registered, NavigationResult]:
    """The whole of the register room on a dive, with voxels for so coarse a scanner."""
    navigate_settings = NavigateSettings()
    navigated = navigate(one.log, navigate_settings, one.store.stamps())
    settings = RegisterSettings(
        drift=DriftSettings.model_validate(
            {"surfel_size": 0.06, "coarse_surfel_size": 0.08, "surfel_points": 6} | drift
        )
    )
    return register(one.store, one.log, navigated, settings, navigate_settings, scanner=scanner), navigated


def floor_error(one: Dive, trajectory: Trajectory) -> float:
    """Median distance, m, of the points from the true floor after one rigid alignment of the whole map."""
    true = true_trajectory(one.store.stamps())
    turn, shift = rigid_alignment(trajectory.at(true.stamp_ns), true)
    points = turn.apply(points_of(one, trajectory))[::7] + shift
    for _ in range(5):
        distance, normal = _distance(points, one.floor)
        centre = points.mean(axis=0)
        rows = np.hstack([normal, np.cross(points - centre, normal)])
        weight = 1.0 / (1.0 + np.abs(distance) / 0.005)
        step = np.linalg.lstsq(rows * weight[:, None], -distance * weight, rcond=None)[0]
        points = Rotation.from_rotvec(step[3:]).apply(points - centre) + centre + step[:3]
    return float(np.median(np.abs(_distance(points, one.floor)[0])))


def _distance(points: Floats, floor: Floor) -> tuple[Floats, Floats]:
    x, y, z = points.T
    h = 1e-4
    slope_x = (floor(x + h, y) - floor(x - h, y)) / (2 * h)
    slope_y = (floor(x, y + h) - floor(x, y - h)) / (2 * h)
    normal = np.stack([-slope_x, -slope_y, np.ones(len(x))], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return (z - floor(x, y)) * normal[:, 2], normal


def _hit(origin: Floats, direction: Floats, floor: Floor) -> Floats:
    """Where rays (n, 3) meet the floor, m along them; a fixed point that contracts for a floor less steep than the rays."""
    length = (origin[:, 2] + 3.0) / -direction[:, 2]
    for _ in range(12):
        x, y, z = (origin + direction * length[:, None]).T
        length = length + (z - floor(x, y)) / -direction[:, 2]
    return length


def _imu(random: np.random.Generator, duration: float, suite: Suite, attitude: bool) -> Imu:
    at = stamps(duration, 100.0)
    t, n = seconds(at), len(at)
    slope = derivative(lambda s: rotation(s).as_matrix(), t, 1)
    skew = rotation(t).as_matrix().transpose(0, 2, 1) @ slope
    rate = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    arm = MOUNTS["imu_link"].translation
    acceleration = derivative(lambda s: position(s) + rotation(s).apply(arm), t, 2)
    force = rotation(t).inv().apply(acceleration + GRAVITY)
    slow = suite.tilt * np.sin(0.1 * t[:, None] + random.uniform(0, 6, 3)) * [1.0, 1.0, 3.0]
    told = (Rotation.from_rotvec(slow) * rotation(t)).as_quat() if attitude else np.full((n, 4), np.nan)
    return Imu(
        at,
        at,
        rate + suite.rate_bias + random.normal(0, suite.rate, (n, 3)),
        force + suite.force_bias + random.normal(0, suite.force, (n, 3)),
        told,
        np.broadcast_to(np.eye(3) * suite.tilt**2, (n, 3, 3)),
    )


def _pressure(random: np.random.Generator, duration: float, suite: Suite) -> Pressure:
    at = stamps(duration, 10.0, 0.003)
    t = seconds(at)
    height = (position(t) + rotation(t).apply(MOUNTS["pressure_link"].translation))[:, 2]
    height = height + random.normal(0, suite.depth, len(t))
    return Pressure(at, at, 101325.0 - height * 1025.0 * 9.80665)


def _dvl(random: np.random.Generator, duration: float, suite: Suite) -> Dvl:
    at = stamps(duration, 8.0, 0.007)
    t, mount = seconds(at), MOUNTS["dvl_link"]
    velocity = derivative(lambda s: position(s) + rotation(s).apply(mount.translation), t, 1)
    told = (rotation(t) * Rotation.from_quat(mount.quaternion)).inv().apply(velocity) / (1.0 + suite.dvl_scale)
    told = told + random.normal(0, suite.dvl, told.shape)
    return Dvl(at, at, told, np.broadcast_to(np.eye(3) * suite.dvl**2, (len(at), 3, 3)))
