"""Simulated profiles of a site of any size: a slow vehicle over ripples and stones, on its way along lanes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.navigate import Trajectory
from garbi_map.seabed import JudgedPoints
from garbi_map.sweep import Sweep

Floats = NDArray[np.float64]

SUBMAP_POINTS = 300_000
"""What half a minute of 20 images a second gives."""
SWATH, SPEED = 1.0, 0.12
"""m and m/s: the ground that a slow vehicle covers in that time, so that the area grows with the points."""
SWEEPS, PROFILES = 8, 75
REACH = 1.0
"""m, along the way, that a sweep covers."""
LANE = 36.0
HEIGHT = 1.3
SIGMA = 3e-4
"""m, 1 sigma of a point."""
SWEEP_NS, PROFILE_NS = 4_000_000_000, 50_000_000

_WAVES = np.random.default_rng(9)
_TURN = _WAVES.uniform(0.0, 2 * np.pi, 16)
_NUMBER = 2 * np.pi / _WAVES.uniform(0.2, 1.5, 16)
_WAVE = np.stack([np.cos(_TURN), np.sin(_TURN)]) * _NUMBER
_HIGH = 0.06 / _NUMBER


def floor(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Height (n,) m and slope (n, 2): waves every way, so that no place is like another."""
    phase = np.stack([x, y], axis=1) @ _WAVE + _TURN
    return np.sin(phase) @ _HIGH, (np.cos(phase) * _HIGH) @ _WAVE.T


def swath(number: int, dive: int = 0) -> tuple[list[Sweep], Trajectory, list[Floats]]:
    """Half a minute of sweeps, the rig's poses at their profiles, and the slopes at their points; the rig looks along -z."""
    rng = np.random.default_rng([dive, number])
    length = SPEED * 30.0
    lane, along = divmod(number, round(LANE / length))
    each = SUBMAP_POINTS // SWEEPS
    sweeps, eyes, stamps, slopes = [], [], [], []
    for k in range(SWEEPS):
        profile = (np.arange(each) * PROFILES // each).astype(np.int32)
        there = np.arange(PROFILES) / PROFILES
        x = along * length + (k + 0.5) * length / SWEEPS + REACH * ((there if k % 2 else 1.0 - there) - 0.5)
        row = np.arange(each, dtype=np.int32) % (each // PROFILES)
        y = 0.9 * SWATH * lane + SWATH * (row + rng.uniform(0, 1, each)) * PROFILES / each
        x_of = x[profile] + rng.uniform(0, REACH / PROFILES, each)  # the vehicle moves
        z, slope = floor(x_of, y)
        eye = np.column_stack([x, np.full(PROFILES, 0.9 * SWATH * lane + SWATH / 2), np.full(PROFILES, HEIGHT)])
        stamp = (SWEEPS * number + k) * SWEEP_NS + np.arange(PROFILES) * PROFILE_NS + dive * 10**15
        placed = np.column_stack([x_of, y, z + SIGMA * rng.normal(size=each)])
        light = rng.uniform(50, 200, each).astype(np.float32)
        sigma = np.full(each, SIGMA, np.float32)
        index = SWEEPS * number + k
        sweeps.append(Sweep(index, stamp, np.zeros(PROFILES), placed - eye[profile], sigma, light, profile, row))
        eyes.append(eye)
        stamps.append(stamp)
        slopes.append(slope)
    position = np.concatenate(eyes)
    covariance = np.tile((2e-4**2 * np.eye(6)).astype(np.float32), (len(position), 1, 1))
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(position), 1))
    return sweeps, Trajectory(np.concatenate(stamps), position, still, covariance), slopes


def judged_swath(number: int) -> list[tuple[int, JudgedPoints, Floats]]:
    """The same as points that have been accepted, and where the camera was at each: what a submap is written from."""
    sweeps, path, slopes = swath(number)
    parts = []
    for sweep, slope in zip(sweeps, slopes, strict=True):
        eye = path.at(sweep.stamp_ns).position[sweep.profile]
        n = len(sweep.points)
        points = JudgedPoints(
            sweep.point_stamp_ns, sweep.points + eye, sweep.sigma, sweep.intensity, np.zeros(n, np.uint8),
            gradient=slope, noise=np.full(n, SIGMA**2), pose=np.full(n, 2e-4),
        )  # fmt: skip
        parts.append((sweep.index, points, eye))
    return parts
