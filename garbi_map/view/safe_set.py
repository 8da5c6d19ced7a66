"""The velocities that safety allows, as outlines in which an arrow's tip must end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BOW = np.array([0.65, 0.0, 0.0])
"""m, base_link."""
START = BOW + np.array([0.0, 0.0, 0.42])
"""m, base_link: where arrows begin, above the bow, that the hull does not hide them."""
AHEAD = 5.0
"""s: an arrow's tip is where the bow would be after this time."""


def bow_velocity(command: NDArray) -> NDArray[np.float64]:
    """Velocity (..., 3) m/s of the bow, base_link, of commands (..., 4) surge, heave, yaw, pitch."""
    surge, heave, yaw, pitch = np.moveaxis(np.asarray(command, float), -1, 0)
    return np.stack([surge, BOW[0] * yaw, heave - BOW[0] * pitch], axis=-1)


def outlines(allowed: NDArray, command: NDArray) -> list[NDArray[np.float32]]:
    """Closed outlines (n, 3) m, base_link, of what is allowed: (k, 5) rows and bounds.

    One lies flat (surge and yaw), one stands (surge and heave); the other two axes are as in the command (4,).
    """
    found = []
    for pair in ((0, 2), (0, 1)):
        rest = [axis for axis in range(4) if axis not in pair]
        bounds = allowed[:, 4] - allowed[:, rest] @ command[rest]
        corners = clipped(np.c_[allowed[:, list(pair)], bounds])
        if len(corners) == 0:
            continue
        commands = np.tile(command, (len(corners), 1))
        commands[:, list(pair)] = corners
        line = START + AHEAD * bow_velocity(commands)
        found.append(np.vstack([line, line[:1]]).astype(np.float32))
    return found


def clipped(half_planes: NDArray) -> NDArray[np.float64]:
    """Corners (n, 2) of the part of the square |x|, |y| <= 1 in which a x + b y <= c holds for all rows (k, 3); none where
    nothing is left. Sutherland and Hodgman, Reentrant polygon clipping, 1974."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for a, b, c in half_planes:
        side = corners @ (a, b) - c
        kept: list[NDArray] = []
        for k in range(len(corners)):
            here, there = side[k], side[(k + 1) % len(corners)]
            if here <= 1e-9:
                kept.append(corners[k])
            if (here <= 1e-9) != (there <= 1e-9):
                share = here / (here - there)
                kept.append(corners[k] + share * (corners[(k + 1) % len(corners)] - corners[k]))
        corners = np.array(kept).reshape(-1, 2)
    return corners
