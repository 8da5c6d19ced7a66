"""Where the vehicle is relative to a surface that was seen before: point to plane, profile by profile.

An error-state Kalman filter. Dead reckoning carries the pose from one profile to the next, so that a range is never older
than the newest reading of navigation; each profile corrects position, attitude and the velocity that dead reckoning has
wrong. Directions that the surface does not tell apart (along a wall; along and about a pipe) are left to dead reckoning:
Zhang, Kaess and Singh, On degeneracy of optimization-based state estimation problems, 2016.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from behaviours.types import Pose
from garbi_map.log.records import Floats

START = (0.05, 0.05, 0.03)  # m, rad, m/s: 1 sigma of position, attitude and velocity when a surface is new
WALK = (0.003, 0.004)  # m, rad per root second: what position and attitude wander besides the velocity's error
FADE, SLOW = 4.0, 0.015  # s, m/s: the velocity's error is a Gauss-Markov process
NOISE = 0.06  # m, 1 sigma of a point with the error that it has in common with its whole profile
KNOWN = (0.03, 0.03)  # m, rad, 1 sigma: what is known worse is not told
MEMORY = 4.0  # s, over which it is counted which directions the surface tells apart
FLAT = 0.004  # share of the normals' spread below which a direction is not told apart: 4 degrees of slope


class Surface(Protocol):
    """What a profile is registered to."""

    def off(self, points: Floats) -> tuple[Floats, Floats]:
        """Signed distance (n,) m of points (n, 3) from the surface, NaN where it does not reach; normals (n, 3)."""
        ...


@dataclass(frozen=True)
class Placed:
    """position (3,) m and rotation (3, 3) of base_link in the surface's frame; velocity (3,) m/s, axes of base_link;
    told (6,) bool: which of x, y, z and of the turns about base_link's axes the surface fixes."""

    position: Floats
    rotation: Floats
    velocity: Floats
    told: NDArray[np.bool_]


class Registration:
    """Begins where navigation says the vehicle is: the surface's frame is odom as it was then."""

    def __init__(self, pose: Pose) -> None:
        self._pose = pose
        self.position, self.rotation = pose.position.copy(), pose.rotation.copy()
        self._slip = np.zeros(3)  # m/s, surface's frame: true velocity less that of navigation
        self.covariance = np.diag(np.repeat(np.square(START), 3))
        self._scatter = np.zeros((6, 6))

    def carry(self, pose: Pose) -> None:
        """On to a later pose of navigation."""
        dt = max((pose.stamp_ns - self._pose.stamp_ns) * 1e-9, 0.0)  # the first profile may be older than the beginning
        before = self.position
        self.position, self.rotation = self._carried(pose)
        step = np.eye(9)
        step[:3, 3:6] = _cross(before - self.position)
        step[:3, 6:] = dt * np.eye(3)
        keep = np.exp(-dt / FADE)
        step[6:, 6:] *= keep
        added = np.repeat([WALK[0] ** 2 * dt, WALK[1] ** 2 * dt, SLOW**2 * (1 - keep**2)], 3)
        self.covariance = step @ self.covariance @ step.T + np.diag(added)
        self._slip = keep * self._slip
        self._scatter *= np.exp(-dt / MEMORY)
        self._pose = pose

    def see(self, points: Floats, surface: Surface, gate: float) -> float:
        """Correct by the points (n, 3) of one profile, base_link; the share of them that lies on the surface.

        gate: m, beyond which a point belongs to something else."""
        arm = points @ self.rotation.T
        off, normal = surface.off(arm + self.position)
        on = np.abs(off) < gate  # NaN is not
        if on.sum() < 5:
            return float(on.mean()) if len(on) else 0.0
        off, normal, arm = off[on], normal[on], arm[on]
        rows = np.concatenate([normal, np.cross(arm, normal)], axis=1)
        weight = (1 - (off / gate) ** 2) ** 2 / NOISE**2
        self._scatter += (weight[:, None] * rows).T @ rows
        rows = rows @ self._told_apart()
        information = np.linalg.inv(self.covariance)
        information[:6, :6] += (weight[:, None] * rows).T @ rows
        self.covariance = np.linalg.inv(information)
        change = -self.covariance[:, :6] @ (rows.T @ (weight * off))
        self.position = self.position + change[:3]
        self.rotation = Rotation.from_rotvec(change[3:6]).as_matrix() @ self.rotation
        self._slip = self._slip + change[6:]
        return float(on.mean())

    def _told_apart(self) -> Floats:
        """Projection (6, 6) onto the shifts, and onto the turns, that the profiles of the last seconds tell apart."""
        kept = np.zeros((6, 6))
        least = FLAT * max(float(np.trace(self._scatter[:3, :3])), 1e-12)
        for block in (slice(0, 3), slice(3, 6)):
            values, vectors = np.linalg.eigh(self._scatter[block, block])
            good = vectors[:, values > least]
            kept[block, block] = good @ good.T
        return kept

    def _carried(self, pose: Pose) -> tuple[Floats, Floats]:
        dt = (pose.stamp_ns - self._pose.stamp_ns) * 1e-9
        moved = self._pose.rotation.T @ (pose.position - self._pose.position)
        turned = self._pose.rotation.T @ pose.rotation
        return self.position + self.rotation @ moved + self._slip * dt, self.rotation @ turned

    def at(self, pose: Pose) -> Placed:
        """Where the vehicle is at a pose of navigation not long after the newest profile."""
        position, rotation = self._carried(pose)
        turn = np.kron(np.eye(2), rotation.T)
        share = np.diag(turn @ self._told_apart() @ turn.T)
        sigma = np.sqrt(np.diag(turn @ self.covariance[:6, :6] @ turn.T))
        told = (share > 0.75) & (sigma < np.repeat(KNOWN, 3))
        return Placed(position, rotation, pose.velocity + rotation.T @ self._slip, told)


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
