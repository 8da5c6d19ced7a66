"""The simulator as a feed, with the loop closed: a command in, and later what became known of its effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from behaviours.angle import LiveAngle
from behaviours.feed import Intake, Seen, Sighting
from behaviours.settings import FeedSettings
from behaviours.types import Command
from garbi_map.log.records import Image
from garbi_map.stripe import Stripe, StripeDetector, StripeSettings
from garbi_map.stripe.decode import decode
from tools.simulator.dive import FIRST_IMAGE, Dive
from tools.simulator.sensors import START_NS
from tools.simulator.vehicle import Command as Thrusters

Level = Literal["profiles", "images", "blind"]
SHORTEST = 0.02  # s of motion that holds a reading of every quick sensor


class DiveFeed:
    """See `behaviours.feed.Feed`. level: "profiles" are cast directly, "images" are rendered and searched, "blind" has none.

    lost       share of images that never arrive
    silent     (from, to) s in which no image arrives
    """

    def __init__(
        self,
        dive: Dive,
        settings: FeedSettings,
        level: Level = "profiles",
        lost: float = 0.0,
        silent: tuple[tuple[float, float], ...] = (),
        keep: Callable[[Image], None] | None = None,
    ) -> None:
        self.dive, self.rig, self.level = dive, dive.rig, level
        self._lost, self._silent, self._keep = lost, silent, keep
        self._rng = np.random.default_rng([dive.scenario.seed, 91])
        self._intake = Intake(dive.rig, dive.mounts, settings)
        self.mount = self._intake.mount
        self._late = settings.processing
        self._angle = LiveAngle(dive.rig.laser.fixed_angle, settings.encoder_reach, settings.encoder_stuck)
        self._detector = StripeDetector(StripeSettings(), dive.rig)
        self._next = 0
        self._until = 0.0
        self.time = 0.0

    def step(self, command: Command, dt: float) -> None:
        """The vehicle obeys for dt seconds."""
        self.dive.step(Thrusters(command.surge, command.heave, command.yaw, command.pitch), dt)
        self.time += dt

    def until(self, now_ns: int) -> Seen:
        """See `Feed`."""
        now = min((now_ns - START_NS) * 1e-9, self.dive.motion.end)
        if now - self._until < SHORTEST:
            return self._intake.until(now_ns)
        readings = self.dive.navigation(self._until, now)
        self._until = now
        self._intake.read(readings)
        if readings.encoder is not None:
            for stamp, angle in zip(readings.encoder.stamp_ns, readings.encoder.angle, strict=True):
                self._angle.add(int(stamp), float(angle))
        camera = self.dive.scenario.camera
        while FIRST_IMAGE + self._next / camera.rate + camera.latency <= now:
            number, self._next = self._next, self._next + 1
            moment = FIRST_IMAGE + number / camera.rate
            gone = self._rng.uniform() < self._lost or any(a <= moment < b for a, b in self._silent)
            if gone or self.level == "blind":
                continue
            stripe = self._stripe(number)
            arrival = START_NS + round((moment + camera.latency) * 1e9)
            known = arrival + round(self._late * 1e9)
            alpha = self._angle.at(stripe.stamp_ns)
            stuck = self._angle.stuck(stripe.stamp_ns)
            self._intake.sight(Sighting(stripe, known, alpha, self._angle.sweep, stuck))
        return self._intake.until(now_ns)

    def _stripe(self, number: int) -> Stripe:
        if self.level == "profiles":
            return self.dive.stripe(number)
        image = self.dive.image(number)
        if self._keep is not None:
            self._keep(image)
        size = (self.rig.camera.width, self.rig.camera.height)
        return self._detector.detect(decode(image, size), image.stamp_ns, self._angle.at(image.stamp_ns))
