"""A sweep as it is when the encoder's stamps are not the camera's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from garbi_map.rig import Rig
from garbi_map.sweep.angle import Angle
from garbi_map.sweep.types import Sweep


def retimed(sweep: Sweep, rig: Rig, angle: Angle, latency: float) -> Sweep:
    """The sweep triangulated again with alpha(stamp + latency): what an encoder says whose stamps are late by so many s.

    Points without a place then, where the encoder's record ends or the ray misses the sheet, are left out.
    """
    alpha, _ = angle.at(sweep.stamp_ns + round(latency * 1e9))
    u = rig.project(sweep.points)[:, 0]
    points = rig.triangulate(u, sweep.row, alpha[sweep.profile]).points
    seen = np.isfinite(points).all(axis=1)
    return replace(
        sweep,
        alpha=np.where(np.isfinite(alpha), alpha, sweep.alpha),
        points=points[seen],
        sigma=sweep.sigma[seen],
        intensity=sweep.intensity[seen],
        profile=sweep.profile[seen],
        row=sweep.row[seen],
    )
