"""On to a goal, around what is in the way; without a goal straight on."""

from __future__ import annotations

import numpy as np

from behaviours.plan import Planner
from behaviours.settings import TravelSettings, Vehicle
from behaviours.situation import Situation
from behaviours.types import Command, Pose, Proposal
from garbi_map.log.records import Floats

ASTERN_NS = 9_000_000_000  # a metre, from which the water beside the bow is in view


class Travel:
    """Plans through what is free, and through what is unseen at a price: the safety filter lets nobody into it unseen."""

    name = "travel"

    def __init__(self, settings: TravelSettings, vehicle: Vehicle) -> None:
        self.settings, self.vehicle = settings, vehicle
        self._planner = Planner(vehicle, settings.band)
        self._path: Floats | None = None
        self._planned_ns = 0
        self._height: float | None = None
        self.goal = settings.goal
        self._mark: tuple[int, Floats] | None = None
        self._astern_until_ns = 0

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        pose, settings = situation.pose, self.settings
        if self._height is None:
            self._height = float(pose.position[2])
        if self.goal is None:
            heave = float(np.clip(0.5 * (self._height - pose.position[2]), -0.1, 0.1))
            level = float(np.clip(-0.5 * pose.tilt, -0.1, 0.1))
            return Proposal(
                self.name, 1.0, Command(settings.speed, heave, 0.0, level), "straight on", settings.priority
            )
        goal = np.array(self.goal)
        left = float(np.linalg.norm(goal - pose.position))
        if left < settings.arrived:
            return Proposal(self.name, 1.0, Command(), f"goal reached, {left:.2f} m from it", settings.priority)
        if self._is_stuck(situation):
            command = Command(-0.12, float(np.clip(0.3 * (goal[2] - pose.position[2]), -0.08, 0.08)))
            words = "no progress: backing off to see more"
            return Proposal(self.name, 1.0, command, words, settings.priority)
        if self._path is None or abs(situation.now_ns - self._planned_ns) >= settings.replan * 1e9:
            self._path = self._planner.plan(situation.space, pose, goal)
            self._planned_ns = situation.now_ns
        if self._path is None:
            look = Command(yaw=0.25 * situation.clearer_side(1.0))
            return Proposal(self.name, 1.0, look, "no way to the goal is known: looking about", settings.priority)
        command, words = steer(pose, self._path, settings.speed)
        return Proposal(self.name, 1.0, command, f"goal at {left:.1f} m: {words}", settings.priority)

    def _is_stuck(self, situation: Situation) -> bool:
        """Whether it is time to back off: what is unseen beside the bow comes into view from farther away."""
        now, position = situation.now_ns, situation.pose.position
        if now < self._astern_until_ns:
            return True
        if self._mark is None or np.linalg.norm(position - self._mark[1]) > 0.25:
            self._mark = (now, position.copy())
        if now - self._mark[0] < self.settings.patience * 1e9:
            return False
        self._mark, self._path = None, None
        self._astern_until_ns = now + ASTERN_NS
        return True


def steer(pose: Pose, path: Floats, speed: float, lookahead: float = 0.9) -> tuple[Command, str]:
    """Towards a path (n, 3), odom, without sway: the bow is turned to a point ahead on it, and into what drifts abeam."""
    flat = np.linalg.norm(path[:, :2] - pose.position[:2], axis=1)
    near = int(flat.argmin())
    beyond = np.flatnonzero(flat[near:] >= lookahead)
    aim = path[near + beyond[0]] if len(beyond) else path[-1]
    away = aim - pose.position
    bearing = float(np.arctan2(away[1], away[0]))
    error = (bearing - pose.heading + np.pi) % (2 * np.pi) - np.pi
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
