"""The last word on every command: a velocity control barrier filter over what has been seen.

For each thing near the hull, at distance d along the normal n from the hull's point q, the command u has to satisfy

    n . (v + w x q)  <=  limit(d - clearance) + n . v_thing          (Ames et al., Control Barrier Functions, 2019)

where the limit is the class-K gain times the margin, and never more than the speed from which the vehicle stops within the
margin (reaction time and braking included). Unseen space is such a thing. The smallest change of u that satisfies all of
them is a QP in four variables; Hildreth's method solves its dual. Backing off into seen-free space meets no constraint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from behaviours.kernels_qp import project
from behaviours.moving import Mover
from behaviours.settings import Prior, SafetySettings, Vehicle
from behaviours.space import Corridor, Nearby
from behaviours.types import AXES, Command, Pose
from garbi_map.log.records import Floats

WEIGHT = np.array([1.0, 1.0, 0.35, 0.35])  # what a change on each axis costs, s or m
NOTICEABLE = 0.005
PASSED = 12.0  # s, within which a command leads past what moves


@dataclass(frozen=True)
class Filtered:
    """The command that is safe, and in words what was changed and because of what.

    allowed    (k, 5): allowed[:, :4] . command <= allowed[:, 4] is what every safe command satisfies
    """

    command: Command
    changes: list[str]
    braked: bool
    allowed: Floats


@dataclass(frozen=True)
class Constraint:
    """row (4,) . command <= bound; `relaxed` bound where not everything can be had; `why` in words."""

    row: Floats
    bound: float
    relaxed: float
    why: str


class SafetyFilter:
    """Stateless but for its settings."""

    def __init__(self, vehicle: Vehicle, settings: SafetySettings, sees_ahead: bool, prior: Prior | None) -> None:
        self.vehicle, self.settings, self.sees_ahead, self.prior = vehicle, settings, sees_ahead, prior
        self._half = np.array(vehicle.hull) / 2

    def filter(
        self, wanted: Command, pose: Pose, nearby: Nearby, corridor: Corridor, movers: list[Mover], troubles: list[str]
    ) -> Filtered:
        """The nearest command to `wanted` that every constraint allows."""
        return self._nearest(
            wanted, [*self._still(wanted, pose, nearby), *self._movers(wanted, pose, movers)], corridor, troubles
        )

    def rehearsed(
        self, wanted: Command, why: str, pose: Pose, corridor: Corridor, movers: list[Mover], troubles: list[str]
    ) -> Filtered:
        """The same for a way out that was rehearsed against all that stands: a turn brings a corner nearer to it at first,
        and it is the only one; so that only what moves and the view's age still bound it. why: in words."""
        got = self._nearest(wanted, self._movers(wanted, pose, movers), corridor, troubles)
        return replace(got, changes=[f"{_spoken(got.command)}: {why}", *got.changes])

    def _movers(self, wanted: Command, pose: Pose, movers: list[Mover]) -> list[Constraint]:
        return [one for mover in movers if (one := self._moving(wanted.array(), pose, mover)) is not None]

    def _nearest(
        self, wanted: Command, constraints: list[Constraint], corridor: Corridor, troubles: list[str]
    ) -> Filtered:
        limits = np.array(self.vehicle.limits)
        low, high = -limits, limits.copy()
        low[0] = -self.vehicle.astern
        fastest, why_slow = self.speed_limit(corridor, troubles)
        high[0] = min(high[0], fastest)
        rows = np.array([one.row for one in constraints]).reshape(-1, 4)
        start = np.clip(wanted.array(), low, high)
        strict = np.array([one.bound for one in constraints])
        bounds = strict
        command, met = project(start, rows, strict, low, high, WEIGHT)
        if not met:  # what cannot be had together gives way: never closer, even if not farther
            bounds = np.array([one.relaxed for one in constraints])
            command, met = project(start, rows, bounds, low, high, WEIGHT)
            if not met:
                command = np.zeros(4)
        return Filtered(
            Command.of(command),
            *self._explain(wanted.array(), start, command, constraints, why_slow, fastest),
            np.c_[np.r_[rows, np.eye(4), -np.eye(4)], np.r_[bounds, high, -low]],
        )

    def speed_limit(self, corridor: Corridor, troubles: list[str]) -> tuple[float, str]:
        """Fastest surge ahead, m/s, by how far and how lately the way ahead was seen: what may have entered since, and
        braking, must fit in between."""
        settings, vehicle = self.settings, self.vehicle
        if not self.sees_ahead:
            if self.prior is None:
                return 0.0, "the rig does not see ahead and no prior is stated"
            return self.prior.speed, "the rig does not see ahead: the stated prior's speed"
        if "navigation is silent" in troubles:
            return 0.0, "navigation is silent"
        if corridor.age > settings.stale:
            return 0.0, f"the view ahead is {_age(corridor.age)} old"
        braking = vehicle.reaction + vehicle.limits[0] / (2 * vehicle.brake)
        margin = corridor.length - settings.clearance
        allowed = max(margin / (corridor.age + braking) - settings.unseen_speed, 0.0)
        fade = min(1.0, (settings.stale - corridor.age) / (settings.stale - settings.fresh))
        floor = settings.creep * max(fade, 0.0)
        why = f"the view ahead reaches {corridor.length:.1f} m ({corridor.end}) and is {_age(corridor.age)} old"
        return max(allowed * max(fade, 0.0), floor), why

    def limit(self, margin: float) -> float:
        """Largest approach speed, m/s, at a margin (m) beyond the clearance."""
        if margin <= 0.0:
            return 0.0
        brake, delay = self.vehicle.brake, self.vehicle.reaction
        stopping = np.sqrt((brake * delay) ** 2 + 2 * brake * margin) - brake * delay
        return float(min(self.settings.gain * margin, stopping))

    def _still(self, wanted: Command, pose: Pose, nearby: Nearby) -> list[Constraint]:
        settings = self.settings
        found: list[Constraint] = []
        for distance, normal, point, unknown in zip(
            nearby.distance, nearby.normal, nearby.point, nearby.unknown, strict=True
        ):
            row, drift = _row(normal, point), max(float(normal[1] * pose.velocity[1]), 0.0)  # sway is taken as it is
            what = "unseen space" if unknown else "an obstacle"
            why = f"{what} {_where(normal, point)} at {max(float(distance), 0.0):.2f} m"
            if unknown:
                slow = self.limit(float(distance) - settings.clearance_unknown)
                found += _unseen(wanted, normal, row, slow, max(slow - drift, settings.nudge), why)
                continue
            margin = float(distance) - settings.clearance
            relaxed = self.limit(margin)
            bound = relaxed if margin >= 0.0 else -min(settings.gain * -margin, settings.retreat)
            found.append(Constraint(row, bound - drift, relaxed, why))
        return found

    def _moving(self, wanted: Floats, pose: Pose, mover: Mover) -> Constraint | None:
        centre = pose.to_base(mover.at(pose.stamp_ns)[None])[0]
        point = np.clip(centre, -self._half, self._half)
        away = centre - point
        gap = float(np.linalg.norm(away))
        if gap < 1e-6 or gap > self.settings.horizon + 1.0 or self._clears(wanted, pose, mover, centre, gap):
            return None
        normal = away / gap
        margin = gap - mover.radius - self.settings.clearance_moving
        closing = -float(normal @ (pose.rotation.T @ mover.velocity))
        bound = self.limit(margin) if margin > 0 else -min(self.settings.gain * -margin, self.settings.retreat)
        bound -= max(closing, 0.0) if margin < closing * 3.0 + 0.2 else 0.0
        why = f"something moving {_where(normal, point)} at {gap - mover.radius:.2f} m, closing at {closing:.2f} m/s"
        return Constraint(_row(normal, point), bound, max(bound, self.settings.nudge), why)

    def _clears(self, wanted: Floats, pose: Pose, mover: Mover, centre: Floats, gap: float) -> bool:
        """Whether the command, kept up, leads past it without coming nearer than it is, or than the clearance."""
        sway = float(pose.velocity[1])
        approach = pose.rotation.T @ mover.velocity - np.array([wanted[0], sway, wanted[1]])
        way = centre + np.arange(0.0, PASSED, 0.5)[:, None] * approach
        least = np.linalg.norm(way - np.clip(way, -self._half, self._half), axis=1).min()
        return bool(least > min(gap - 0.02, mover.radius + self.settings.clearance_moving))

    def _explain(
        self, wanted: Floats, start: Floats, got: Floats, constraints: list[Constraint], why_slow: str, fastest: float
    ) -> tuple[list[str], bool]:
        changes = []
        if wanted[0] > start[0] + NOTICEABLE and start[0] >= fastest - 1e-9:
            changes.append(f"surge {wanted[0]:.2f} -> {start[0]:.2f} m/s: {why_slow}")
        changed = np.abs(got - start) > NOTICEABLE
        if changed.any():
            tight = [one for one in constraints if one.row @ got > one.bound - 1e-3 and one.row @ start > one.bound]
            tight.sort(key=lambda one: float(one.bound - one.row @ start))
            said = "; ".join(one.why for one in tight[:2]) or "constraints that exclude each other"
            axes = ", ".join(f"{name} {start[i]:.2f} -> {got[i]:.2f}" for i, name in enumerate(AXES) if changed[i])
            changes.append(f"{axes}: {said}")
        braked = bool(wanted[0] > NOTICEABLE and got[0] < 0.5 * wanted[0])
        return changes, braked


def _unseen(wanted: Command, normal: Floats, row: Floats, slow: float, nudge: float, why: str) -> list[Constraint]:
    """What keeps the hull out of an unseen voxel. Surge leads it into what lies wholly before the bow or the stern, heave
    into what lies wholly above or below. What lies beyond a side, or over or under the way, it passes by: the unseen close
    about a known way must shut it neither ahead nor back. Where surge and heave together lead into it, the slower of them
    gives way. Turning sweeps the corners only, and where water carries the hull into the unseen, turning may help and
    standing still does not: that much of it is let by."""
    nx, ny, nz = normal
    if nz != 0.0 and nx != 0.0 and ny == 0.0 and nx * wanted.surge > 0.0 and nz * wanted.heave > 0.0:
        gives = [nx, 0.0, 0.0, 0.0] if abs(wanted.surge) < abs(wanted.heave) else [0.0, nz, 0.0, 0.0]
        return [Constraint(np.array(gives), slow, slow, why)]
    if nz == 0.0 and ny != 0.0:  # abeam
        return [Constraint(row * [0.0, 0.0, 1.0, 1.0], nudge, nudge, why)]
    if nz == 0.0 or (nx == 0.0 and ny == 0.0):
        straight = np.array([nx, nz, 0.0, 0.0])
        return [Constraint(straight, slow, slow, why), Constraint(row, nudge, nudge, why)]
    return []


def _row(normal: Floats, point: Floats) -> Floats:
    """d(n . velocity of the hull's point) / d(surge, heave, yaw, pitch)."""
    nx, ny, nz = normal
    x, y, z = point
    return np.array([nx, nz, -nx * y + ny * x, nx * z - nz * x])


def _age(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 1e5 else "unboundedly"


def _spoken(command: Command) -> str:
    return f"surge {command.surge:.2f} m/s, yaw {command.yaw:+.2f} rad/s"


def _where(normal: Floats, point: Floats) -> str:
    words = []
    if normal[0] > 0.5 or (abs(normal[0]) > 0.3 and normal[0] > 0):
        words.append("ahead")
    elif normal[0] < -0.5:
        words.append("astern")
    if abs(normal[1]) > 0.5:
        words.append("to port" if normal[1] > 0 else "to starboard")
    if abs(normal[2]) > 0.5:
        words.append("above" if normal[2] > 0 else "below")
    return " ".join(words) or "beside"
