"""On to a goal, around what is in the way; without a goal straight on."""

from __future__ import annotations

import numpy as np

from behaviours.plan import Plan, Planner
from behaviours.retreat import Retreat
from behaviours.settings import TravelSettings, Vehicle
from behaviours.situation import Situation
from behaviours.types import Command, Pose, Proposal

WATCH, SIDE, KEPT = 4.5, 0.9, 0.2  # m, rad, rad: what is watched, and within which bearing it is kept
MISSED, MISSED_NEAR = (4.0, 20.0), 3.0  # s, m: what moves and was not seen for so long, and is near, is looked for
SIGHT, SIGHTLESS, RISEN = 0.5, 3.0, 0.3  # share of profiles that show something; s; m over the goal: see _too_high
NEAR, SLOW = 2.5, 0.1  # m, m/s: nearer than that it is waited for, else approached slowly
PASSES, LONGEST = 2, 8.0  # of the laser that are waited for before the first move; s, where passes never end


class Travel:
    """Rehearses manoeuvres through what was seen; what is unseen on the way draws the bow, not the hull. `looked`: whether
    it has looked before the first move, or need not."""

    name = "travel"

    def __init__(self, settings: TravelSettings, vehicle: Vehicle) -> None:
        self.settings, self.vehicle = settings, vehicle
        self._planner = Planner(vehicle, settings)
        self._retreat = Retreat(vehicle)
        self._plan: Plan | None = None
        self._planned_ns = 0
        self._height: float | None = None
        self._shown_ns: int | None = None
        self._passes: set[int] = set()
        self._begun_ns: int | None = None
        self.goal = settings.goal
        self.looked = False

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        pose, settings = situation.pose, self.settings
        if self._height is None:
            self._height = float(pose.position[2])
        if not self._has_looked(situation):
            words = f"looking before the first move, for {PASSES} passes of the laser"
            return self._say(self._command(pose, 0.0, 0.0, self._height), words)
        if self.goal is None:
            return self._say(self._command(pose, settings.speed, 0.0, self._height), "straight on")
        goal = np.array(self.goal)
        left = float(np.linalg.norm(goal - pose.position))
        if left < settings.arrived:
            return self._say(Command(), f"goal reached, {left:.2f} m from it")
        if self._plan is None or abs(situation.now_ns - self._planned_ns) >= settings.replan * 1e9:
            movers = situation.movers
            self._plan = self._planner.plan(situation.space, pose, goal, situation.current, movers)
            self._planned_ns = situation.now_ns
        if self._plan is None:
            look = Command(yaw=0.25 * situation.clearer_side(1.0))
            return self._say(look, "no way to the goal is known: looking about")
        plan = self._plan
        words = f"goal at {left:.1f} m: surge {plan.surge:.2f} m/s, yaw {plan.yaw:+.2f} rad/s, {plan.words}"
        if self._too_high(situation, float(goal[2])):
            down = self._command(pose, 0.0, 0.0, float(goal[2]))
            return self._say(down, f"goal at {left:.1f} m; nothing returns at this height: down to the goal's")
        back = self._retreat.propose(situation, plan.heading, plan.blind)
        watched = self._watch(situation, plan.surge, plan.yaw)
        if back is not None and not watched[2]:  # what may come nearer is looked for first
            surge, yaw, why = back
            return self._say(self._command(pose, surge, yaw, float(pose.position[2])), f"goal at {left:.1f} m; {why}")
        surge, yaw, why = watched
        return self._say(self._command(pose, surge, yaw, plan.height), words + why)

    def _has_looked(self, situation: Situation) -> bool:
        """Whether the passes have ended from which it can be told what moves: one shows where things are, two that they
        were elsewhere. Once told it is, it stays so."""
        if not self.looked:
            if self._begun_ns is None:
                self._begun_ns = situation.now_ns
            self._passes |= {profile.sweep for profile in situation.profiles}
            waited = (situation.now_ns - self._begun_ns) * 1e-9
            self.looked = len(self._passes) > PASSES or waited > LONGEST
        return self.looked

    def _too_high(self, situation: Situation, goal: float) -> bool:
        """Whether it is above the goal's height (m) where the scanner has shown little for long: out of sight of the ground
        nothing proves the water free, and there is no way on."""
        now = situation.now_ns
        if self._shown_ns is None or situation.space.returning(now) >= SIGHT:
            self._shown_ns = now
        return (now - self._shown_ns) * 1e-9 > SIGHTLESS and float(situation.pose.position[2]) - goal > RISEN

    def _watch(self, situation: Situation, surge: float, yaw: float) -> tuple[float, float, str]:
        """Surge and yaw that keep in view what may move, until it is known whether it does: out of view it never will be;
        and that find again what moves nearer."""
        for one in situation.undecided:
            x, y, _ = situation.pose.to_base(one.at(situation.now_ns)[None])[0]
            bearing = float(np.arctan2(y, x))
            if x > 0.0 and np.hypot(x, y) < WATCH and abs(bearing) < SIDE:
                words = f"; something {x:.1f} m ahead, {y:+.1f} m to port, was seen {one.passes} times: does it move?"
                surge = float(np.clip(surge, 0.0, SLOW if x > NEAR else 0.0))
                yaw = float(np.clip(0.5 * bearing, -0.2, 0.2)) if abs(bearing) > KEPT else 0.0
                return surge, yaw, words
        for one in situation.movers:
            age = (situation.now_ns - one.stamp_ns) * 1e-9
            x, y, _ = situation.pose.to_base(one.at(situation.now_ns)[None])[0]
            nearer = float((one.at(situation.now_ns) - situation.pose.position) @ one.velocity) < 0.0
            bearing = float(np.arctan2(y, x))
            if MISSED[0] < age < MISSED[1] and np.hypot(x, y) < MISSED_NEAR and nearer and abs(bearing) > KEPT:
                words = f"; what moves nearer was not seen for {age:.0f} s: looking for it"
                return min(surge, 0.0), float(np.clip(0.5 * bearing, -0.25, 0.25)), words
        return surge, yaw, ""

    def _say(self, command: Command, words: str) -> Proposal:
        return Proposal(self.name, 1.0, command, words, self.settings.priority)

    @staticmethod
    def _command(pose: Pose, surge: float, yaw: float, height: float) -> Command:
        """Level, at that height."""
        heave = float(np.clip(0.5 * (height - pose.position[2]), -0.1, 0.1))
        return Command(surge, heave, yaw, float(np.clip(-0.6 * pose.tilt, -0.1, 0.1)))
