"""Away from what is near, and from what comes nearer."""

from __future__ import annotations

import numpy as np

from behaviours.moving import Mover
from behaviours.settings import AvoidanceSettings, Vehicle
from behaviours.situation import Situation
from behaviours.types import Command, Pose, Proposal
from garbi_map.log.records import Floats


class Avoidance:
    """Activation rises as the nearest thing in the way of the motion comes nearer; the proposal points away from it."""

    name = "avoidance"

    def __init__(self, settings: AvoidanceSettings, vehicle: Vehicle) -> None:
        self.settings = settings
        self._half = np.array(vehicle.hull) / 2
        self._side = 1.0

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        best = (0.0, Command(), "nothing near")
        for activation, normal, reason in [*self._still(situation), *self._moving(situation)]:
            if activation > best[0]:
                best = (activation, self._away(normal, situation), reason)
        return Proposal(self.name, *best, priority=self.settings.priority)

    def _still(self, situation: Situation) -> list[tuple[float, Floats, str]]:
        settings, nearby, corridor = self.settings, situation.nearby, situation.corridor
        found = []
        if corridor.end == "obstacle":
            activation = (settings.notice - corridor.length) / (settings.notice - settings.full)
            words = f"an obstacle {corridor.length:.2f} m ahead"
            found.append((float(np.clip(activation, 0.0, 1.0)), np.array([1.0, 0.0, 0.0]), words))
        for distance, normal, unknown in zip(nearby.distance, nearby.normal, nearby.unknown, strict=True):
            # What the way does not lead into matters only once it is close: the vehicle passes by.
            activation = float(np.clip(2.0 - 2.0 * distance / settings.beside, 0.0, 1.0))
            if activation > 0.0 and not unknown:
                found.append((activation, normal, f"an obstacle beside the hull at {max(distance, 0.0):.2f} m"))
        return found

    def _moving(self, situation: Situation) -> list[tuple[float, Floats, str]]:
        found = []
        for mover in situation.movers:
            seen = self._approach(situation.pose, mover)
            if seen is None:
                continue
            gap, closing, normal = seen
            seconds = gap / closing if closing > 0.02 else np.inf
            nearness = float(np.clip((self.settings.notice - gap) / self.settings.notice, 0.0, 1.0))
            haste = float(np.clip(1.5 - 0.5 * seconds / self.settings.escape_time, 0.0, 1.0)) if seconds < 1e6 else 0.0
            activation = max(nearness if closing > -0.02 else 0.5 * nearness, haste)
            if activation > 0.0:
                words = f"something moving at {gap:.2f} m, closing at {closing:.2f} m/s"
                found.append((activation, normal, words))
        return found

    def _approach(self, pose: Pose, mover: Mover) -> tuple[float, float, Floats] | None:
        centre = pose.to_base(mover.at(pose.stamp_ns)[None])[0]
        away = centre - np.clip(centre, -self._half, self._half)
        distance = float(np.linalg.norm(away))
        if distance < 1e-6:
            return None
        normal = away / distance
        velocity = pose.rotation.T @ mover.velocity
        towards = float(-normal @ velocity)
        # It only matters if its way leads past the hull: the closest it will come.
        miss = centre + velocity * min(max(-(centre @ velocity) / max(float(velocity @ velocity), 1e-6), 0.0), 15.0)
        if np.linalg.norm(miss - np.clip(miss, -self._half, self._half)) > mover.radius + 0.6 and distance > 0.8:
            return None
        return max(distance - mover.radius, 0.0), towards, normal

    def _away(self, normal: Floats, situation: Situation) -> Command:
        """Back off along the normal as far as surge and heave can, and turn the bow to the clearer side."""
        speed = self.settings.speed
        self._side = situation.clearer_side(self._side)
        surge, heave = -speed * normal[0], -speed * normal[2] if abs(normal[2]) > 0.6 else 0.0
        yaw = 0.25 * self._side if normal[0] > 0.5 else -0.2 * np.sign(normal[1]) * max(normal[0], 0.0)
        return Command(float(surge), float(heave), float(yaw), 0.0)
