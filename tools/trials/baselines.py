"""Controllers to compare with: one that knows everything, one that avoids nothing, a potential field, a stop zone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from behaviours.decisions import Decision
from behaviours.feed import Seen
from behaviours.moving import Mover as Tracked
from behaviours.pilot import Pilot
from behaviours.situation import Situation
from behaviours.travel import Travel
from behaviours.types import Command, Pose, within_half_turn
from tools.simulator.dive import Dive
from tools.simulator.seabed import mover_centre
from tools.trials.world import World

STOP_ZONE = 0.8  # m before the bow
REFILL_NS = 450_000_000  # between two drawings of the truth: as often as it is planned
FIELD = 1.2  # m, reach of the repulsion


class Omniscient(Pilot):
    """The same behaviours with the truth for a view: what it cannot avoid within these limits is called unavoidable."""

    def know(self, world: World, dive: Dive) -> None:
        """What is true: obstacles, where the vehicle is, how it moves."""
        self._world, self._dive = world, dive
        self._start = dive.vehicle.position.copy()
        self._points = world.points() - self._start
        self._filled_ns = 0
        for one in self.behaviours:
            if isinstance(one, Travel):
                one.looked = True

    def decide(self, seen: Seen) -> Decision:
        """With everything known."""
        vehicle = self._dive.vehicle
        rotation = vehicle.attitude.as_matrix()
        rate = np.array(self._dive.motion.rows[-1, 11:14])
        pose = Pose(seen.now_ns, vehicle.position - self._start, rotation, rotation.T @ vehicle.velocity, rate)
        self.space.be_at(pose)
        if seen.now_ns - self._filled_ns >= REFILL_NS:
            self._fill(seen.now_ns)
            self._filled_ns = seen.now_ns
        return super().decide(Seen(seen.now_ns, pose, [], []))

    def _fill(self, now_ns: int) -> None:
        space = self.space
        now = space.milliseconds(now_ns)
        space.layers[0][:] = now
        space.layers[1][:] = now
        space.layers[3][:] = 0
        space.layers[7][:] = now - 60_000
        space._proof = [(now_ns, 3.0)] * 5
        ground = np.floor((0.05 - self._start[2]) / space.voxel).astype(int)
        for k in range(int(space.low[2]), ground + 1):
            space.layers[3][:, :, k % space.shape[2]] = 9
        index = np.floor(self._points / space.voxel).astype(np.int64)
        index = index[((index >= space.low) & (index < space.low + space.shape)).all(1)]
        space.layers[3][tuple(np.mod(index, space.shape).T)] = 9

    def _situation(self, seen: Seen, pose: Pose) -> Situation:
        situation = super()._situation(seen, pose)
        time = self._dive.motion.end
        movers = [
            Tracked(
                number, seen.now_ns, 0, mover_centre(one, time) - self._start, np.array(one.velocity), one.size / 2, 9
            )
            for number, one in enumerate(self._world.movers)
        ]
        return replace(situation, profiles=[], movers=movers)


class _Straight(Pilot):
    """Straight to the goal, whatever the space says; `_bend` makes the difference."""

    name: str

    def decide(self, seen: Seen) -> Decision:
        """One command."""
        command, goal = Command(), self.settings.travel.goal if self.settings.travel else None
        for profile in seen.profiles:
            self.space.see(profile)
        if seen.pose is not None and goal is not None:
            self.space.be_at(seen.pose)
            away = np.array(goal) - seen.pose.position
            command = self._bend(seen.pose, away / max(float(np.linalg.norm(away)), 1e-9))
        return Decision(
            seen.now_ns, seen.pose, [], command, self.name, self.name, command, [], False, seen.troubles, np.inf, ""
        )

    def _bend(self, pose: Pose, pull: np.ndarray) -> Command:
        return _towards(pose, pull, 0.2)


class NoAvoidance(_Straight):
    """Nothing is avoided."""

    name = "none"


class PotentialField(_Straight):
    """Attraction to the goal, repulsion from the occupied voxels that were seen (Khatib, 1986)."""

    name = "potential"

    def _bend(self, pose: Pose, pull: np.ndarray) -> Command:
        near = self.space.nearby(pose, FIELD)
        seen = ~near.unknown & (near.distance < FIELD)
        distance = np.maximum(near.distance[seen], 0.05)
        push = -(near.normal[seen] * (1 / distance - 1 / FIELD)[:, None] / distance[:, None]).sum(0) * 0.15
        return _towards(pose, pull + pose.rotation @ push, 0.2)


class StopZone(_Straight):
    """Stop while anything that was seen stands in a zone before the bow."""

    name = "stop"

    def _bend(self, pose: Pose, pull: np.ndarray) -> Command:
        near = self.space.nearby(pose, STOP_ZONE)
        blocked = bool((~near.unknown & (near.normal[:, 0] > 0.7) & (near.distance < STOP_ZONE)).any())
        command = _towards(pose, pull, 0.2)
        return Command(0.0, command.heave, 0.0, 0.0) if blocked else command


def _towards(pose: Pose, pull: np.ndarray, speed: float) -> Command:
    error = float(within_half_turn(np.arctan2(pull[1], pull[0]) - pose.heading))
    ahead = speed * float(np.clip(np.cos(error), -0.5, 1.0)) if abs(error) < 2.0 else -0.1
    return Command(
        ahead * min(float(np.linalg.norm(pull)), 1.0),
        float(np.clip(0.2 * pull[2], -0.12, 0.12)),
        float(np.clip(0.9 * error, -0.3, 0.3)),
        float(np.clip(-0.6 * pose.tilt, -0.1, 0.1)),
    )
