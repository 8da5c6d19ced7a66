"""Wander over the bottom: where a metre of way shows the most that has not been seen."""

from __future__ import annotations

import numpy as np

from behaviours import kernels
from behaviours.coverage import Coverage
from behaviours.settings import SurveySettings
from behaviours.situation import Situation
from behaviours.types import Command, Pose, Proposal, within_half_turn
from garbi_map.log.records import Floats

BEARINGS = np.linspace(-np.pi, np.pi, 24, endpoint=False)  # rad off the bow
LEG = 1.5  # m that are looked ahead
TURN_PRICE = 0.8  # m of way that a radian of turning is worth
HABIT = 1.1  # the bearing of before counts this much more
RANGE = 10.0  # m about the start that are remembered
EVERY_NS = 1_000_000_000


class Wander:
    """Of the bearings along which nothing stands, the one with the most new ground per metre."""

    name = "wander"

    def __init__(self, settings: SurveySettings, ahead: float) -> None:
        """ahead: m before base_link at which the ground is seen, by the rig's mount."""
        self.settings, self._ahead = settings, ahead
        self.coverage = Coverage(settings, (-RANGE, -RANGE, RANGE, RANGE))
        self._heading: float | None = None
        self._gain = 0.0
        self._chosen_ns = 0

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        settings, pose = self.settings, situation.pose
        for profile in situation.profiles:
            self.coverage.see(profile)
        if self._heading is None or abs(situation.now_ns - self._chosen_ns) >= EVERY_NS:
            self._choose(situation)
        seen = float((self.coverage.count > 0).sum()) * settings.cell**2
        facts = {"seen": seen, "gain": self._gain}
        heave = self.coverage.climb(pose, settings.altitude)
        if self._heading is None:
            return Proposal(
                self.name, 1.0, Command(0.0, heave, 0.2), "no free way: looking about", settings.priority, facts=facts
            )
        error = within_half_turn(self._heading - pose.heading)
        surge = settings.speed * max(float(np.cos(error)), 0.0) ** 4
        words = f"towards {self._gain:.2f} m2 of new ground per metre; {seen:.1f} m2 seen"
        command = Command(
            surge, heave, float(np.clip(0.9 * error, -0.3, 0.3)), float(np.clip(-0.6 * pose.tilt, -0.1, 0.1))
        )
        return Proposal(self.name, 1.0, command, words, settings.priority, facts=facts)

    def _choose(self, situation: Situation) -> None:
        pose = situation.pose
        self._chosen_ns = situation.now_ns
        best, chosen = 0.0, None
        for bearing in BEARINGS:
            heading = pose.heading + float(bearing)
            if self._stands_in_the_way(situation, heading):
                continue
            gain = self._new(pose, heading) / (LEG + TURN_PRICE * abs(float(bearing)))
            off = 0.0 if self._heading is None else abs(within_half_turn(heading - self._heading))
            if gain * (HABIT if off < 0.15 else 1.0) > best:
                best, chosen = gain, heading
        if chosen is None and (hole := self.coverage.nearest_hole(pose)) is not None:
            away = hole - pose.position[:2]
            heading = float(np.arctan2(away[1], away[0]))
            chosen = None if self._stands_in_the_way(situation, heading) else heading
        self._heading, self._gain = chosen, best

    def _stands_in_the_way(self, situation: Situation, heading: float) -> bool:
        along, aside = _axes(heading)
        step = 0.9 * situation.space.voxel
        x, y, z = np.meshgrid(np.arange(0.4, LEG + 0.7, step), np.arange(-0.5, 0.51, step), np.arange(-0.3, 0.31, step))
        points = x.reshape(-1, 1) * along + y.reshape(-1, 1) * aside + z.reshape(-1, 1) * np.array([0.0, 0.0, 1.0])
        return bool((situation.space.state(points + situation.pose.position) == kernels.OCCUPIED).any())

    def _new(self, pose: Pose, heading: float) -> float:
        """Unseen ground, m^2, that a leg along a heading would show."""
        width = self.coverage.width or (-0.3, 0.3)
        along, aside = _axes(heading)
        cell = self.settings.cell
        x, y = np.meshgrid(np.arange(0.0, LEG, cell) + self._ahead + 0.2, np.arange(*width, cell))
        points = pose.position + x.reshape(-1, 1) * along + y.reshape(-1, 1) * aside
        return float(self.coverage.unseen(points[:, :2]).sum()) * cell**2


def _axes(heading: float) -> tuple[Floats, Floats]:
    c, s = np.cos(heading), np.sin(heading)
    return np.array([c, s, 0.0]), np.array([-s, c, 0.0])
