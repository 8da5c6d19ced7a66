"""What map can be expected of a log: rough figures, from samples and a few simple assumptions.

The ground is taken to be as far away as the sampled points, the vehicle to move straight at its median speed, and the
laser to sweep at its median rate. Motion, which is most of a map's error, is not in the figures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.health.motor import Motor
from garbi_map.health.pictures import Look
from garbi_map.health.sample import Stretch, of_role
from garbi_map.log.records import Floats
from garbi_map.rig import Rig
from garbi_map.stripe.settings import StripeSettings

LEAST_POINTS = 500
FOOTPRINT = (2.0, 98.0)  # percentiles of the points, across


@dataclass(frozen=True)
class Expected:
    """Rough figures; None where the log does not tell enough.

    range_m           median distance of the ground along the optical axis, m
    point_sigma_m     1 sigma of a point from the stripe alone, m: median and 95th percentile
    swath_m           width of the ground that a sweep covers, m: mean of its two sides
    points_per_sweep
    points_per_cm2    all points over that area
    overlap           how many sweeps see a piece of it
    area_m2           the first footprint, and the swath times the way: as if no way were gone twice
    speed_m_s         median
    """

    range_m: float
    point_sigma_m: tuple[float, float]
    swath_m: float
    points_per_sweep: float
    points_per_cm2: float | None
    overlap: float | None
    area_m2: float | None
    speed_m_s: float | None


def expect(
    found: list[Stretch],
    looks: list[Look],
    rig: Rig | None,
    motor: Motor | None,
    image_rate: float,
    duration: float,
    settings: StripeSettings,
) -> Expected | None:
    """Figures where there is a rig, a stripe in the samples, and an angle to each."""
    good = [one for one in looks if one.stripe is not None and np.isfinite(one.alpha) and len(one.stripe.row)]
    if rig is None or not good:
        return None
    points, sigma = [], []
    for one in good:
        assert one.stripe is not None
        found_there = rig.triangulate(one.stripe.u.astype(float), one.stripe.row.astype(float), one.alpha)
        depth = rig.depth(found_there.points)
        near = (depth > settings.min_range) & (depth < settings.max_range)
        points.append(found_there.points[near])
        sigma.append(np.linalg.norm(found_there.d_du[near], axis=1) * one.stripe.sigma[near])
    cloud, sigmas = np.concatenate(points), np.concatenate(sigma)
    if len(cloud) < LEAST_POINTS:
        return None
    low, high = np.percentile(cloud[:, 1:], FOOTPRINT, axis=0)
    footprint = float(np.maximum(high - low, 1e-3).prod())
    swath = float(np.sqrt(footprint))
    sweep = motor.sweep if motor and motor.sweep else 1.0
    per_second = len(cloud) / len(good) * image_rate
    speed = _speed(found)
    overlap = area = dense = None
    if motor is not None and motor.sweep and speed is not None:
        area = footprint + swath * speed * duration
        overlap = footprint / area * max(duration / sweep, 1.0)
        dense = per_second * duration / area * 1e-4
    return Expected(
        range_m=float(np.median(rig.depth(cloud))),
        point_sigma_m=(float(np.median(sigmas)), float(np.percentile(sigmas, 95))),
        swath_m=swath,
        points_per_sweep=float(per_second * sweep),
        points_per_cm2=dense,
        overlap=overlap,
        area_m2=area,
        speed_m_s=speed,
    )


def _speed(found: list[Stretch]) -> float | None:
    """Median speed, m/s, by the DVL, else by somebody else's odometry."""
    means = [good.mean(axis=0) for _, said in of_role(found, "dvl") if len(good := _finite(said.values[:, :3]))]
    if means:
        return float(np.median(np.linalg.norm(means, axis=1)))  # of stretches, as single readings are noisy
    steps = []
    for _, said in of_role(found, "odometry", 2):
        seconds = np.diff(said.stamp_ns) * 1e-9
        moved = np.linalg.norm(np.diff(said.values[:, :3], axis=0), axis=1)
        steps.append(moved[seconds > 0] / seconds[seconds > 0])
    return float(np.median(np.concatenate(steps))) if steps and len(np.concatenate(steps)) else None


def _finite(rows: Floats) -> Floats:
    return rows[np.isfinite(rows).all(axis=1)]
