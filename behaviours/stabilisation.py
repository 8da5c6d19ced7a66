"""Hold range, relative yaw and pitch to an object.

What is read badly never moves the vehicle: without a believable target it holds depth and heading, and says why. Depth and
heading to hold are taken where the behaviour is armed, and again whenever it is re-armed.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from behaviours.settings import HoldSettings
from behaviours.situation import Situation
from behaviours.target import Relative, Target
from behaviours.types import AXES, Command, Pose, Proposal, within_half_turn
from garbi_map.log.records import Floats

PAUSE_NS = 2_000_000_000  # not asked for this long, the behaviour is armed anew
DRIFT = 0.04  # m/s abeam, averaged over a wave, that is worth saying
AGREE = 0.1  # m, by which depth and the height over the target may differ
SECOND_HAND = 1.0  # s without the target in view that is worth saying


class Stabilisation:
    """Station on an object."""

    name = "hold"

    def __init__(self, settings: HoldSettings, eye: Floats) -> None:
        self.settings = settings
        self.target = Target(settings, eye)
        self.wanted = settings.range
        self._asked_ns: int | None = None
        self._heights: deque[float] = deque(maxlen=10)
        self._slides: deque[float] = deque(maxlen=40)
        self.depth, self.heading = 0.0, 0.0
        self._found_ns: int | None = None
        self._lost_ns: int | None = None

    def rearm(self, pose: Pose) -> None:
        """Begin anew: hold the depth and heading of now, believe nothing of before."""
        self.target.forget()
        self._heights.clear()
        self._slides.clear()
        self._found_ns = self._lost_ns = None
        self.depth, self.heading = float(pose.position[2]), pose.heading

    def propose(self, situation: Situation) -> Proposal:
        """The proposal of this moment."""
        pose, now = situation.pose, situation.now_ns
        if self._asked_ns is None or not 0 <= now - self._asked_ns <= PAUSE_NS:
            self.rearm(pose)
        self._asked_ns = now
        for profile in situation.profiles:
            self.target.see(profile)
        found = self.target.now(pose)
        believed, words = self._believe(found, pose, now)
        if not believed or found is None:
            return self._station(pose, words)
        return self._hold(found, pose, words)

    def _believe(self, found: Relative | None, pose: Pose, now: int) -> tuple[bool, str]:
        """Whether the target may move the vehicle, and why or why not."""
        settings, target = self.settings, self.target
        if found is not None and found.age > settings.lost:
            target.drop()
            self._lost_ns, found = now - round(found.age * 1e9), None
        if found is None:
            self._found_ns = None
            if self._lost_ns is None and target.place is not None:
                self._lost_ns = now
            if self._lost_ns is None:
                return False, "no target yet"
            words = f"target lost {(now - self._lost_ns) * 1e-9:.1f} s ago"
            if target.place is None:
                return False, words
            away = target.place - pose.position
            self.heading = float(np.arctan2(away[1], away[0]))  # it may only have gone out of view
            return False, f"{words}, turning to where it was seen last"
        if target.jump is not None:
            if now - target.since_ns > settings.confirm * 1e9:
                target.drop()
                return False, "what came before the target stays: it is the target now"
            return False, f"glitch: something is {target.jump:.2f} m nearer than the target"
        if not settings.nearest <= found.range <= settings.farthest:
            return False, f"target out of range at {found.range:.2f} m"
        self._found_ns, self._lost_ns = self._found_ns or now, None
        if now - self._found_ns < settings.confirm * 1e9:
            return False, f"target {'found again' if target.takes > 1 else 'found'}: waiting until it lasts"
        words = f"range {found.range:.2f} m, wanted {self.wanted:.2f} m"
        return True, words + (f", not seen for {found.age:.1f} s" if found.age > SECOND_HAND else "")

    def _hold(self, found: Relative, pose: Pose, words: str) -> Proposal:
        settings = self.settings
        gain, yaw_gain, pitch_gain = settings.gains
        closing = -float(found.slope @ found.velocity + found.swing @ pose.rate)
        hastening = -float(found.slope @ pose.acceleration)
        surge = self._towards(found.range - self.wanted, closing, hastening, gain)
        yaw = float(np.clip(yaw_gain * found.yaw, -0.3, 0.3))
        pitch = float(np.clip(pitch_gain * found.pitch, -0.15, 0.15))
        if "yaw" not in found.axes:
            yaw = self._to_heading(pose)
        else:
            self.heading = pose.heading
        if "pitch" not in found.axes:
            pitch = float(np.clip(-0.5 * pose.tilt, -0.15, 0.15))
        self._slides.append(float(found.velocity[1]))
        drift = float(np.mean(self._slides))
        if abs(drift) > DRIFT:
            side = "to port" if drift > 0 else "to starboard"
            words += f"; drifting {side} at {abs(drift):.2f} m/s, which cannot be countered"
        facts = {"target": 1.0, "range": found.range, "yaw_error": found.yaw, "pitch_error": found.pitch}
        facts |= {
            name: float(value)
            for name, value, told in zip(("ahead", "aside", "above"), found.moved, found.told, strict=True)
            if told
        }
        command = Command(surge, self._to_depth(pose, facts.get("above")), yaw, pitch)
        return Proposal(self.name, 1.0, command, words, settings.priority, AXES, facts=facts, faces=True)

    def _towards(self, off: float, speed: float, acceleration: float, gain: float) -> float:
        """The command, m/s, that brings a distance to go to nought: reckoned for when the propellers will answer, and
        stiffer than the vehicle's own loop, for a wave is over before that has countered it."""
        settings = self.settings
        lead = settings.lead
        ahead = off - speed * lead - 0.5 * acceleration * lead**2
        approach = float(np.clip(gain * ahead, -settings.fastest, settings.fastest))
        return approach + settings.stiffness * (approach - (speed + acceleration * lead))

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
            faces=True,
        )

    def _to_depth(self, pose: Pose, above: float | None = None) -> float:
        """Heave to the depth that was armed; the median of the last second, so that a glitch moves nothing. To the height
        that the target tells (m above where it was taken) as long as depth does not contradict it."""
        self._heights.append(float(pose.position[2]))
        off = self.depth - float(np.median(self._heights))
        if above is not None and abs(off + above) < AGREE:
            off = -above
        return float(np.clip(0.5 * off, -0.1, 0.1)) if abs(off) < 1.0 else 0.0

    def _to_heading(self, pose: Pose) -> float:
        error = within_half_turn(self.heading - pose.heading)
        return float(np.clip(0.6 * error, -0.2, 0.2))
