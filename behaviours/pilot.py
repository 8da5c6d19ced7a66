"""One decision: what became known goes into the space, each behaviour proposes, the coordinator merges, safety has the
last word."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.avoidance import Avoidance
from behaviours.coordinator import coordinate
from behaviours.decisions import Decision
from behaviours.drift import Drift
from behaviours.feed import Seen
from behaviours.leeway import Leeway
from behaviours.moving import Mover, Movers
from behaviours.safety import Filtered, SafetyFilter
from behaviours.settings import BehaviourSettings
from behaviours.situation import Situation
from behaviours.space import Space
from behaviours.stabilisation import Stabilisation
from behaviours.survey import Survey
from behaviours.travel import Travel
from behaviours.types import Command, Pose, Proposal
from behaviours.wander import Wander
from garbi_map.log.records import Floats, Mount
from garbi_map.rig import Rig
from garbi_map.words import many

LOOK = 3.0  # m before the bow
FARTHEST = 2.0  # m, at which the ground is looked for by a rig that looks ahead
DRAWN_NS = 1_000_000_000  # between two pictures of the volume


class Behaviour(Protocol):
    """From a situation to a proposal."""

    name: str

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        ...


class Pilot:
    """All behaviours of one vehicle. `decide` is called once per period, with what has become known since."""

    def __init__(self, settings: BehaviourSettings, rig: Rig, mount: Mount) -> None:
        self.settings = settings
        self.space = Space(rig, mount, settings.vehicle, settings.space, settings.feed, settings.water)
        self.movers = Movers(rig.camera.height)
        self.drift = Drift(settings.vehicle.skid, settings.vehicle.sway_time)
        self.sees_ahead = sees_ahead(rig, self.space, np.array(settings.vehicle.hull) / 2)
        self.safety = SafetyFilter(settings.vehicle, settings.safety, self.sees_ahead, settings.prior)
        self.leeway = Leeway(settings.leeway, settings.vehicle)
        self.behaviours: list[Behaviour] = []
        if settings.avoidance:
            self.behaviours.append(Avoidance(settings.avoidance, settings.vehicle))
        if settings.travel:
            self.behaviours.append(Travel(settings.travel, settings.vehicle))
        if settings.survey:
            kind = Survey if settings.survey.area else Wander
            self.behaviours.append(kind(settings.survey, ground_ahead(mount, settings.survey.altitude)))
        if settings.hold:
            self.behaviours.append(Stabilisation(settings.hold, mount.translation))
        self._half = np.array(settings.vehicle.hull) / 2
        self._drawn_ns = -DRAWN_NS

    def decide(self, seen: Seen) -> Decision:
        """The command of this moment, and why."""
        if seen.pose is None:
            stop = Command()
            return Decision(
                seen.now_ns, None, [], stop, "none", "nothing is known yet: stop", stop, [], False, [], np.inf, ""
            )
        for profile in seen.profiles:
            self.movers.see(profile, *self.space.see(profile))
            for place in self.movers.left():
                self.space.forget(*place)
        self.space.be_at(seen.pose)
        self.drift.see(seen.pose)
        self.space.assume_free(self.settings.prior.free_above if self.settings.prior and not self.sees_ahead else None)
        situation = self._situation(seen, seen.pose)
        proposals = [behaviour.propose(situation) for behaviour in self.behaviours]
        merged = coordinate(proposals, seen.now_ns)
        winner = next((one for one in proposals if one.name == merged.winner), None)
        safe = self._safe(merged.command, winner, situation)
        corridor = situation.corridor
        view = f"free {corridor.length:.1f} m ahead, then {corridor.end}; seen {min(corridor.age, 999.0):.1f} s ago"
        view += "".join(_words(mover, seen.pose) for mover in situation.movers)
        return Decision(
            seen.now_ns,
            seen.pose,
            proposals,
            merged.command,
            merged.winner,
            merged.words,
            safe.command,
            safe.changes,
            safe.braked,
            situation.troubles,
            self._obstacle(seen),
            view,
            situation.movers,
            safe.allowed,
            self._snapshot(seen.now_ns),
        )

    def _safe(self, wanted: Command, winner: Proposal | None, situation: Situation) -> Filtered:
        """What safety makes of a command; and where the water would carry the hull against something, the way out."""
        pose, movers, troubles = situation.pose, situation.movers, situation.troubles
        faces, dares = (winner.faces, winner.dares) if winner else (False, False)
        nearby = situation.nearby.hit() if dares else situation.nearby
        safe = self.safety.filter(wanted, pose, nearby, situation.corridor, movers, troubles)
        fresh = replace(situation.corridor, age=0.0)
        fastest, bold = (self.safety.speed_limit(view, troubles)[0] for view in (situation.corridor, fresh))
        way_out = self.leeway.check(
            safe.command, pose, self.space, situation.current, fastest, bold, not (faces or dares)
        )
        if way_out is None:
            return safe
        command, why, faster = way_out
        return self.safety.rehearsed(command, why, pose, fresh if faster else situation.corridor, movers, troubles)

    def _snapshot(self, now_ns: int) -> tuple[Floats, Floats] | None:
        """The volume, once a second."""
        if now_ns - self._drawn_ns < DRAWN_NS:
            return None
        self._drawn_ns = now_ns
        return self.space.snapshot()

    def _situation(self, seen: Seen, pose: Pose) -> Situation:
        troubles = list(seen.troubles)
        if self.sees_ahead and self.space.clear_range(seen.now_ns) == 0.0:
            troubles.append("nothing has returned lately: the water proves nothing")
        return Situation(
            seen.now_ns,
            pose,
            seen.profiles,
            self.space,
            self.space.nearby(pose, self.settings.safety.horizon),
            self.space.corridor(pose, LOOK, self.drift.current),
            self.movers.now(),
            troubles,
            self.drift.current,
            self.movers.undecided(seen.now_ns),
        )

    def _obstacle(self, seen: Seen) -> float:
        """Distance, m, from the bow to the nearest thing in its way that the new profiles themselves show; inf: none."""
        nearest = np.inf
        for profile in seen.profiles:
            if seen.pose is None:
                continue
            points = in_the_way(seen.pose.to_base(profile.points[profile.solid]), self._half)
            if len(points) >= 5:
                nearest = min(nearest, float(np.sort(points[:, 0])[4] - self._half[0]))
        return nearest


def _words(mover: Mover, pose: Pose) -> str:
    x, y, _ = pose.to_base(mover.at(pose.stamp_ns)[None])[0]
    speed = float(np.linalg.norm(mover.velocity))
    passes = many(mover.passes, "pass", "passes")
    return f"; something moving at {x:.1f} m ahead, {y:+.1f} m to port, {speed:.2f} m/s, seen in {passes}"


def in_the_way(points: Floats, half: Floats) -> Floats:
    """Those of points (n, 3), base_link, that the hull would meet going straight on, a hand's breadth added."""
    margin = 0.1
    meets = (
        (points[:, 0] > half[0]) & (np.abs(points[:, 1]) < half[1] + margin) & (np.abs(points[:, 2]) < half[2] + margin)
    )
    return points[meets]


def ground_ahead(mount: Mount, altitude: float) -> float:
    """m before base_link at which the middle of the view meets the ground, from an altitude (m); FARTHEST at most."""
    forward, _, up = Rotation.from_quat(mount.quaternion).apply([1.0, 0.0, 0.0])
    return float(mount.translation[0] + min(altitude * forward / max(-up, 1e-3), FARTHEST))


def sees_ahead(rig: Rig, space: Space, half: Floats) -> bool:
    """Whether the camera looks into the water that the hull would enter, two metres before the bow."""
    x, y, z = np.meshgrid(
        half[0] + np.array([1.5, 2.0, 2.5]), half[1] * np.array([-0.5, 0, 0.5]), half[2] * np.array([-0.5, 0, 0.5])
    )
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)
    pixels = rig.project(space.to_rig(points))
    size = np.array([rig.camera.width, rig.camera.height])
    inside = np.isfinite(pixels).all(1) & (pixels >= 0).all(1) & (pixels < size).all(1)
    return bool(inside.mean() > 0.5)
