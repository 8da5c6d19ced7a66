"""From the images of a log to its sweeps: decode, find the stripe, triangulate, cut at the turning points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from garbi_map.config import Config
from garbi_map.log import Image, Log, Navigation
from garbi_map.progress import Progress
from garbi_map.rig import Rig
from garbi_map.stripe import ImageLosses, Stripe, StripeDetector, detect_all
from garbi_map.sweep import Sweep, laser_angle, make_sweeps
from garbi_map.sweep.sweeps import SweepLosses


@dataclass
class ScanLosses:
    """Images, profiles and sweeps that were left out."""

    images: ImageLosses = field(default_factory=ImageLosses)
    sweeps: SweepLosses = field(default_factory=SweepLosses)

    def lines(self) -> list[str]:
        """One line each."""
        return [*self.images.lines(), *self.sweeps.lines()]


def scan(
    log: Log,
    rig: Rig,
    navigation: Navigation,
    config: Config,
    span_ns: tuple[int | None, int | None],
    workers: int,
    losses: ScanLosses,
    progress: Progress,
) -> Iterator[Sweep]:
    """The sweeps of a log as a stream; `losses` is filled on the way."""
    angle = laser_angle(navigation.encoder, rig, config.sweep)
    detector = StripeDetector(config.stripe, rig)

    def images() -> Iterator[Image]:
        for image in log.images(*span_ns):
            progress.advance()
            yield image

    def alpha_of(stamp_ns: int) -> float:
        return float(angle.at(np.array([stamp_ns]))[0][0])

    stripes: Iterator[Stripe] = detect_all(images(), detector, alpha_of, workers, losses.images)
    return make_sweeps(stripes, rig, angle, config.sweep, losses.sweeps)
