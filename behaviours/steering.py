"""Towards a path without sway."""

from __future__ import annotations

import numpy as np

from behaviours.types import Command, Pose, within_half_turn
from garbi_map.log.records import Floats


def steer(pose: Pose, path: Floats, speed: float, lookahead: float = 0.9) -> tuple[Command, str]:
    """Towards a path (n, 3), odom, without sway: the bow is turned to a point ahead on it, and into what drifts abeam."""
    flat = np.linalg.norm(path[:, :2] - pose.position[:2], axis=1)
    near = int(flat.argmin())
    beyond = np.flatnonzero(flat[near:] >= lookahead)
    aim = path[near + beyond[0]] if len(beyond) else path[-1]
    away = aim - pose.position
    bearing = float(np.arctan2(away[1], away[0]))
    error = within_half_turn(bearing - pose.heading)
    drift = float(np.clip(-pose.velocity[1] / max(speed, 0.1), -0.7, 0.7))
    error += float(np.arcsin(drift)) * min(1.0, float(np.hypot(away[0], away[1])) / 0.5)
    forward = speed * max(float(np.cos(error)), 0.0) ** 4
    if abs(error) > 0.5:
        forward = 0.0
    command = Command(
        min(forward, 0.5 * float(np.hypot(away[0], away[1])) + 0.03),
        float(np.clip(0.5 * away[2], -0.12, 0.12)),
        float(np.clip(0.9 * error, -0.3, 0.3)),
        float(np.clip(-0.6 * pose.tilt, -0.1, 0.1)),
    )
    return command, f"bow {np.degrees(error):+.0f} deg off"
