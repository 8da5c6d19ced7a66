"""Away from what is near, and out of the way of what comes nearer."""

from __future__ import annotations

import numpy as np

from behaviours.escape import Escape
from behaviours.settings import AvoidanceSettings, Vehicle
from behaviours.situation import Situation
from behaviours.types import AXES, Command, Proposal
from garbi_map.log.records import Floats

ABEAM = 0.6  # of a normal: neither surge nor heave leads away
UPRIGHT = 0.3  # of a normal's part along the hull: surge does not lead away
Found = tuple[float, Floats, str]  # activation, normal, why in words


class Avoidance:
    """Activation rises as the nearest thing in the way of the motion comes nearer; the proposal points away from it. What
    moves is escaped fully or not at all: half an escape is none."""

    name = "avoidance"

    def __init__(self, settings: AvoidanceSettings, vehicle: Vehicle) -> None:
        self.settings = settings
        self._half = np.array(vehicle.hull) / 2
        self._side = 1.0
        self._escape = Escape(settings.escape, vehicle)

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        escape = self._escape.propose(situation)
        if escape is not None:
            command, why, dares = escape
            return Proposal(self.name, 1.0, command, why, priority=self.settings.priority, dares=dares)
        for found, axes in zip(self._still(situation), (AXES, ("heave",)), strict=True):
            if found:
                activation, normal, reason = max(found, key=lambda one: one[0])
                away = self._away(normal, situation)
                return Proposal(self.name, activation, away, reason, priority=self.settings.priority, axes=axes)
        return Proposal(self.name, 0.0, Command(), "nothing near", priority=self.settings.priority)

    def _still(self, situation: Situation) -> tuple[list[Found], list[Found]]:
        """What lies in the way of surge; and what lies above or below, which only heave has to leave: to stop under or over
        it is not to leave it, and to let the water press the vehicle on to what else is near."""
        settings, nearby, corridor = self.settings, situation.nearby, situation.corridor
        level: list[Found] = []
        upright: list[Found] = []
        if corridor.end == "obstacle":
            activation = (settings.notice - corridor.length) / (settings.notice - settings.full)
            words = f"an obstacle {corridor.length:.2f} m ahead"
            if activation > 0.0:
                level.append((min(activation, 1.0), np.array([1.0, 0.0, 0.0]), words))
        for distance, normal, unknown in zip(nearby.distance, nearby.normal, nearby.unknown, strict=True):
            # What the way does not lead into matters only once it is close: the vehicle passes by. And what lies abeam a
            # vehicle without sway cannot back off from: to stop beside it is to let the water press it on; travel goes on.
            if abs(normal[1]) > ABEAM:
                continue
            activation = float(np.clip(2.0 - 2.0 * distance / settings.beside, 0.0, 1.0))
            if activation > 0.0 and not unknown:
                words = f"an obstacle beside the hull at {max(distance, 0.0):.2f} m"
                (upright if abs(normal[0]) < UPRIGHT else level).append((activation, normal, words))
        return level, upright

    def _away(self, normal: Floats, situation: Situation) -> Command:
        """Back off along the normal as far as surge and heave can, and turn the bow to the clearer side."""
        speed = self.settings.speed
        self._side = situation.clearer_side(self._side)
        surge, heave = -speed * normal[0], -speed * normal[2] if abs(normal[2]) > 0.6 else 0.0
        yaw = 0.25 * self._side if normal[0] > 0.5 else -0.2 * np.sign(normal[1]) * max(normal[0], 0.0)
        return Command(float(surge), float(heave), float(yaw), 0.0)
