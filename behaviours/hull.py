"""The vehicle as rehearsals see it: discs along its hull, and how it answers a command."""

from __future__ import annotations

import numpy as np

from behaviours.settings import Vehicle
from garbi_map.log.records import Floats

LAG = 0.5  # s, of surge and of yaw


def discs(vehicle: Vehicle) -> tuple[Floats, float]:
    """Where the middles (3,) m along the hull are of discs that cover it from above, and their radius, m."""
    length, width, _ = vehicle.hull
    spacing = length / 3
    return np.array([-spacing, 0.0, spacing]), float(np.hypot(spacing / 2, width / 2))


def rollout_model(vehicle: Vehicle) -> Floats:
    """(4,) lag of surge s, of yaw s, of sway s, share of surge times yaw rate that becomes sway: see `moved_on`."""
    return np.array([LAG, LAG, vehicle.sway_time, vehicle.skid])
