"""An analytic sea floor scanned by an ideal slit scanner: the truth for tests of the seabed and of what is exported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import Seabed
from garbi_map.sweep.types import Sweep

Floats = NDArray[np.float64]
Height = Callable[[Floats, Floats], Floats]

ALTITUDE = 1.5  # of the rig's origin above z = 0, m
LOOKING_DOWN = Rotation.from_matrix([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # map <- rig: X down, Y north, Z east


def scan(
    height: Height,
    index: int = 0,
    *,
    begin: float = 0.0,
    length: float = 0.6,
    width: float = 0.6,
    profiles: int = 60,
    rows: int = 300,
    sigma: float = 0.0005,
    pose_sigma: float = 0.0,
    shift: Floats | None = None,
    seed: int | None = None,
) -> tuple[Sweep, Trajectory]:
    """One sweep of `profiles` lines along y, from x = `begin` on, over z = height(x, y).

    The rig stands over the middle. Each point is off by sigma along its ray; the whole sweep by `shift`, which the
    poses do not know, or by a draw of pose_sigma along every axis, which their covariances do.
    """
    rng = np.random.default_rng(index if seed is None else seed)
    x = begin + (np.arange(profiles) + rng.uniform(0, 1)) * length / profiles
    y = (np.arange(rows) + rng.uniform(0, 1)) * width / rows
    grid_x, grid_y = (g.ravel() for g in np.meshgrid(x, y, indexing="ij"))
    eye = np.array([begin + length / 2, width / 2, ALTITUDE])
    true = np.stack([grid_x, grid_y, height(grid_x, grid_y)], 1)
    ray = (true - eye) / np.linalg.norm(true - eye, axis=1, keepdims=True)
    measured = true + sigma * rng.standard_normal(len(true))[:, None] * ray
    measured = measured + (pose_sigma * rng.standard_normal(3) if shift is None else shift)
    stamp = 1_790_000_000_000_000_000 + (index * profiles + np.arange(profiles)) * 40_000_000
    covariance = np.zeros((profiles, 6, 6))
    covariance[:, :3, :3] = pose_sigma**2 * np.eye(3)
    poses = Trajectory(stamp, np.tile(eye, (profiles, 1)), np.tile(LOOKING_DOWN.as_quat(), (profiles, 1)), covariance)
    sweep = Sweep(
        index=index,
        stamp_ns=stamp,
        alpha=np.linspace(-0.2, 0.2, profiles),
        points=LOOKING_DOWN.inv().apply(measured - eye),
        sigma=np.full(len(true), sigma, np.float32),
        intensity=np.full(len(true), 120, np.float32),
        profile=np.repeat(np.arange(profiles, dtype=np.int32), rows),
        row=np.tile(np.arange(rows, dtype=np.int32), profiles),
    )
    return sweep, poses


def plane(x: Floats, y: Floats) -> Floats:
    """A floor that slopes 20 % to the east."""
    return 0.2 * x + 0.0 * y


def dome(x: Floats, y: Floats, centre: tuple[float, float] = (0.3, 0.3), radius: float = 0.15) -> Floats:
    """A half sphere on a level floor."""
    rest = radius**2 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2
    return np.sqrt(np.maximum(rest, 0.0))


def snowed(sweep: Sweep, flakes: int, seed: int = 0) -> tuple[Sweep, NDArray[np.bool_]]:
    """The sweep with so many flakes of 1 to 5 rows between the rig and the floor, and which points they are."""
    rng = np.random.default_rng(seed)
    share = np.ones(len(sweep.points))
    for start, rows, where in zip(
        rng.integers(0, len(share), flakes), rng.integers(1, 6, flakes), rng.uniform(0.3, 0.95, flakes), strict=True
    ):
        mine = slice(start, start + rows)
        share[mine][sweep.profile[mine] == sweep.profile[start]] = where
    return replace(sweep, points=sweep.points * share[:, None]), share < 1


def error(seabed: Seabed, height: Height) -> Floats:
    """Elevation less the truth at the cells' centres, NaN where there is no data."""
    x, y = np.meshgrid(*seabed.centres())
    return seabed.elevation - height(x, y)
