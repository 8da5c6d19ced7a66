"""The pilot of an open-loop dive: follows the route at constant depth."""

from __future__ import annotations

import numpy as np

from tools.simulator.route import Reference
from tools.simulator.vehicle import Command, Vehicle

PERIOD = 0.02  # s, between commands


def pilot(vehicle: Vehicle, reference: Reference, altitude: float) -> Command:
    """The command that leads to where the reference is now: cross-track errors turn the bow, for there is no sway."""
    x, y, heading, speed, turn = reference.at(vehicle.time)
    yaw, pitch, _ = vehicle.attitude.as_euler("ZYX")
    east, north = x - vehicle.position[0], y - vehicle.position[1]
    along = np.cos(heading) * east + np.sin(heading) * north
    across = -np.sin(heading) * east + np.cos(heading) * north
    sliding = -np.sin(heading) * vehicle.velocity[0] + np.cos(heading) * vehicle.velocity[1]
    aim = np.sign(speed) * np.clip(1.2 * across - 3.0 * sliding, -0.6, 0.6)
    error = (heading + aim - yaw + np.pi) % (2 * np.pi) - np.pi
    return Command(
        surge=float(np.clip(speed + 0.5 * along, -0.4, 0.4)),
        heave=float(np.clip(0.8 * (altitude - vehicle.position[2]), -0.2, 0.2)),
        yaw=float(np.clip(turn + 0.7 * error, -0.7, 0.7)),
        pitch=float(np.clip(-0.5 * pitch, -0.2, 0.2)),
    )
