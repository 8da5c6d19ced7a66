"""Cover a bounded area with lanes whose spacing follows the view's real width; holes afterwards; done when seen.

A vehicle that slides outwards in its turns has no use for tight ones: lanes are joined by turning on the spot.
"""

from __future__ import annotations

import numpy as np

from behaviours.coverage import Coverage
from behaviours.settings import SurveySettings
from behaviours.situation import Situation
from behaviours.steering import steer
from behaviours.types import Command, Pose, Proposal
from garbi_map.log.records import Floats

TURN = 0.25  # rad, off the lane's heading, beyond which it turns on the spot
REACHED = 0.2  # m
LOOK_NS = 5_000_000_000  # at most, before the first lane is laid as if the view were narrow


class Survey:
    """Lanes along x; a lane is laid when the one before is done, next to what has been seen."""

    name = "survey"

    def __init__(self, settings: SurveySettings, ahead: float) -> None:
        """ahead: m before base_link at which the ground is seen, by the rig's mount."""
        self.settings = settings
        assert settings.area is not None
        west, south, east, north = settings.area
        grown = (west - settings.margin, south - settings.margin, east + settings.margin, north + settings.margin)
        self._area = grown
        self.coverage = Coverage(settings, grown)
        self.lanes = 0
        self._ahead = ahead
        self._lane: tuple[Floats, Floats] | None = None
        self._way, self._y = 1.0, grown[1]
        self.begun = False
        self._since_ns: int | None = None
        self._holes_left = 20

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        settings, pose = self.settings, situation.pose
        for profile in situation.profiles:
            self.coverage.see(profile)
        share = self.coverage.share
        facts = {"coverage": share, "lanes": float(self.lanes)}
        if share >= settings.coverage:
            return self._proposal(Command(), f"done: {100 * share:.1f} % of the area seen", facts)
        if self._since_ns is None:
            self._since_ns = situation.now_ns
        if self.lanes == 0 and self.coverage.width is None and situation.now_ns - self._since_ns < LOOK_NS:
            return self._proposal(Command(), "looking how wide the view is", facts)
        if self._lane is None:
            self._lane = self._next_lane(pose)
        if self._lane is None:
            return self._proposal(Command(), f"{100 * share:.1f} % seen; what is left cannot be reached", facts)
        start, end = self._lane
        heave = self._altitude(pose)
        if not self.begun:
            if np.linalg.norm(start - pose.position[:2]) < REACHED:
                self.begun = True
            command = self._towards(pose, start, heave)
            return self._proposal(command, f"to the next lane's start; {100 * share:.1f} % seen", facts)
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        if float((end - pose.position[:2]) @ along) < REACHED:
            self._lane, self.begun = None, False
            return self._proposal(Command(0.0, heave), f"lane done; {100 * share:.1f} % seen", facts)
        ahead = pose.position[:2] + along * 0.6
        aim = start + along * float((ahead - start) @ along)
        command = self._towards(pose, aim, heave)
        return self._proposal(command, f"on the lane; {100 * share:.1f} % seen", facts)

    def _proposal(self, command: Command, words: str, facts: dict[str, float]) -> Proposal:
        return Proposal(self.name, 1.0, command, words, self.settings.priority, facts=facts)

    def _towards(self, pose: Pose, aim: Floats, heave: float) -> Command:
        path = np.array([[*pose.position[:2], pose.position[2]], [*aim, pose.position[2]]])
        command, _ = steer(pose, path, self.settings.speed, 0.3)
        return Command(command.surge, heave, command.yaw, command.pitch)

    def _altitude(self, pose: Pose) -> float:
        return self.coverage.climb(pose, self.settings.altitude)

    def _view(self) -> tuple[float, float]:
        """How far the view reaches to starboard (negative) and to port, m."""
        return self.coverage.width or (-0.3, 0.3)

    def _next_lane(self, pose: Pose) -> tuple[Floats, Floats] | None:
        """The next strip to the north of what is seen, or the nearest hole."""
        west, south, east, north = self._area
        width = self._view()
        reach = max(width[1] - width[0], 0.2)
        y = self._y
        if y < north:
            # The view lies aside of the vehicle: put its lower edge where the unseen begins, less the overlap.
            lower, upper = (width[0], width[1]) if self._way > 0 else (-width[1], -width[0])
            middle = y - lower if y > south else south - lower
            lane = min(middle, north - upper) if north - south > reach else (north + south) / 2 - (lower + upper) / 2
            ends = (
                [west - self._ahead, east - self._ahead] if self._way > 0 else [east + self._ahead, west + self._ahead]
            )
            self._y = lane + upper - self.settings.overlap * reach if lane + upper < north - 1e-6 else north
            self._way = -self._way
            self.lanes += 1
            return np.array([ends[0], lane]), np.array([ends[1], lane])
        hole = self.coverage.nearest_hole(pose)
        if hole is None or self._holes_left == 0:
            return None
        self._holes_left -= 1
        away = hole - pose.position[:2]
        along = away / max(float(np.linalg.norm(away)), 1e-9)
        return hole - along * (self._ahead + 0.5), hole - along * (self._ahead - 0.3)
