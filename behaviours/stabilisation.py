"""Hold range, relative yaw and pitch to an object.

What is read badly never moves the vehicle: without a believable target it holds depth and heading, and says why. Depth and
heading to hold are taken where the behaviour is armed, and again whenever it is re-armed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from behaviours.settings import HoldSettings
from behaviours.situation import Situation
from behaviours.target import Relative, TargetFit
from behaviours.types import AXES, Command, Pose, Proposal
from garbi_map.log.records import Floats

PAUSE_NS = 2_000_000_000  # not asked for this long, the behaviour is armed anew
FASTEST = 0.2  # m/s, before damping
DRIFT = 0.04  # m/s abeam that is worth saying


@dataclass
class _Belief:
    """The target as it is believed: range m when last fitted, since when it is doubted, how it is."""

    range: float
    fitted_ns: int
    doubted_ns: int | None = None
    trusted: bool = False
    since_ns: int = 0


class Stabilisation:
    """Station on an object."""

    name = "hold"

    def __init__(self, settings: HoldSettings, eye: Floats) -> None:
        self.settings = settings
        self.target = TargetFit(settings, eye)
        self.wanted = settings.range
        self._asked_ns: int | None = None
        self._belief: _Belief | None = None
        self._heights: deque[float] = deque(maxlen=10)
        self.depth, self.heading = 0.0, 0.0

    def rearm(self, pose: Pose) -> None:
        """Begin anew: hold the depth and heading of now, believe nothing of before."""
        self.target.forget()
        self._belief = None
        self._heights.clear()
        self.depth, self.heading = float(pose.position[2]), pose.heading

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        pose, now = situation.pose, situation.now_ns
        if self._asked_ns is None or not 0 <= now - self._asked_ns <= PAUSE_NS:
            self.rearm(pose)
        self._asked_ns = now
        for profile in situation.profiles:
            self.target.see(profile)
        found = None if not situation.profiles and situation.troubles else self.target.now(pose)
        belief, words = self._believe(found, pose, now)
        if not belief or found is None:
            return self._station(pose, words)
        return self._hold(found, pose, words)

    def _believe(self, found: Relative | None, pose: Pose, now: int) -> tuple[bool, str]:
        """Whether the fit may move the vehicle, and why or why not."""
        settings, belief = self.settings, self._belief
        if found is None:
            if belief is None:
                return False, "no target yet"
            silent = (now - belief.fitted_ns) * 1e-9
            if silent > settings.lost:
                belief.trusted = False
                return False, f"target lost {silent:.1f} s ago"
            return False, f"no fit for {silent:.1f} s"
        if not settings.nearest <= found.range <= settings.farthest:
            return False, f"target out of range at {found.range:.2f} m"
        if belief is None:
            self._belief = belief = _Belief(found.range, now, since_ns=now)
        predicted = belief.range - float(pose.velocity[0]) * min((now - belief.fitted_ns) * 1e-9, 2.0)
        if abs(found.range - predicted) > settings.jump:
            belief.doubted_ns = belief.doubted_ns or now
            if now - belief.doubted_ns < settings.confirm * 1e9:
                return False, f"glitch: range jumps from {predicted:.2f} to {found.range:.2f} m"
            belief.trusted, belief.since_ns = True, now
        belief.doubted_ns = None
        belief.range, belief.fitted_ns = found.range, now
        if not belief.trusted:
            if belief.since_ns == 0 or now - belief.since_ns > 60e9:
                belief.since_ns = now
            if now - belief.since_ns < settings.confirm * 1e9:
                return False, "target found: waiting until it lasts"
            belief.trusted = True
        return True, f"range {found.range:.2f} m, wanted {self.wanted:.2f} m"

    def _hold(self, found: Relative, pose: Pose, words: str) -> Proposal:
        settings = self.settings
        gain, yaw_gain, pitch_gain = settings.gains
        # The speed that is measured counts against the command: a stiffer loop than the vehicle's own, against waves.
        approach = np.clip(gain * (found.range - self.wanted), -FASTEST, FASTEST)
        surge = float(approach - settings.damping * pose.velocity[0])
        yaw = float(np.clip(yaw_gain * found.yaw, -0.3, 0.3))
        pitch = float(np.clip(pitch_gain * found.pitch, -0.15, 0.15))
        if "yaw" not in found.axes:
            yaw = self._to_heading(pose)
        else:
            self.heading = pose.heading
        if "pitch" not in found.axes:
            pitch = float(np.clip(-0.5 * pose.tilt, -0.15, 0.15))
        drift = float(pose.velocity[1])
        if abs(drift) > DRIFT:
            side = "to port" if drift > 0 else "to starboard"
            words += f"; drifting {side} at {abs(drift):.2f} m/s, which cannot be countered"
        facts = {"target": 1.0, "range": found.range, "yaw_error": found.yaw, "pitch_error": found.pitch}
        command = Command(surge, self._to_depth(pose), yaw, pitch)
        return Proposal(self.name, 1.0, command, words, settings.priority, AXES, facts=facts)

    def _station(self, pose: Pose, words: str) -> Proposal:
        command = Command(
            0.0, self._to_depth(pose), self._to_heading(pose), float(np.clip(-0.5 * pose.tilt, -0.1, 0.1))
        )
        return Proposal(
            self.name,
            1.0,
            command,
            f"{words}: holding depth and heading",
            self.settings.priority,
            AXES,
            facts={"target": 0.0},
        )

    def _to_depth(self, pose: Pose) -> float:
        """Heave to the depth that was armed; the median of the last second, so that a glitch moves nothing."""
        self._heights.append(float(pose.position[2]))
        off = self.depth - float(np.median(self._heights))
        return float(np.clip(0.5 * off, -0.1, 0.1)) if abs(off) < 1.0 else 0.0

    def _to_heading(self, pose: Pose) -> float:
        error = (self.heading - pose.heading + np.pi) % (2 * np.pi) - np.pi
        return float(np.clip(0.6 * error, -0.2, 0.2))
