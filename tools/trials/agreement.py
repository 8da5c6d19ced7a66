"""The two levels of the trials against each other, on worlds drawn at random: what a cast profile and a rendered, searched
image of the same moment show; and where the vehicle is after the same seconds of closed loop on either."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.stripe import StripeDetector, StripeSettings
from garbi_map.stripe.decode import decode
from tools.simulator.dive import FIRST_IMAGE
from tools.simulator.scan import laser_angle
from tools.trials.avoidance import fly, water_of

LONGEST = 12.0  # s of closed loop
MOMENTS = 12  # images of it that are compared
NEAR = 3.0  # px within which two columns are the same line


@dataclass(frozen=True)
class Agreed:
    """One world.

    rows    that either level shows; both: share of them that both do, at the same place; only_cast, only_rendered: shares
    sigma   rms of the columns' differences over the sigmas that both state: 1 where their noise is what they say
    bias    px, median of the differences
    gap     m, the least to an obstacle, cast and rendered; apart: m between the two ends
    """

    seed: int
    kind: str
    rows: int
    both: float
    only_cast: float
    only_rendered: float
    sigma: float
    bias: float
    gap_cast: float
    gap_rendered: float
    apart: float

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


def run(seed: int, longest: float = LONGEST) -> Agreed:
    """Fly on cast profiles, look again at some of its moments with rendered images; then fly on rendered images."""
    cast = fly(seed, "garbi", "profiles", longest)
    dive = cast.world.make(water_of(seed, "garbi", duration=longest))
    dive.vehicle = cast.dive.vehicle
    detector = StripeDetector(StripeSettings(), dive.rig)
    camera = dive.scenario.camera
    size = (dive.rig.camera.width, dive.rig.camera.height)
    last = int((min(longest, cast.outcome.seconds) - 0.5 - FIRST_IMAGE) * camera.rate)
    counts = np.zeros(3, int)
    off: list[Floats] = []
    sigmas: list[Floats] = []
    for number in np.linspace(5, last, MOMENTS).astype(int):
        one, image = cast.dive.stripe(int(number)), dive.image(int(number))
        alpha = float(laser_angle(dive.scenario.laser, FIRST_IMAGE + number / camera.rate)[0])
        other = detector.detect(decode(image, size), image.stamp_ns, alpha)
        _, i, j = np.intersect1d(one.row, other.row, return_indices=True)
        apart = other.u[j].astype(float) - one.u[i].astype(float)
        same = np.abs(apart) < NEAR
        counts += [same.sum(), len(one.row) - same.sum(), len(other.row) - same.sum()]
        off.append(apart[same])
        sigmas.append(np.hypot(one.sigma[i][same].astype(float), other.sigma[j][same].astype(float)))
    difference, sigma, total = np.concatenate(off), np.concatenate(sigmas), max(int(counts.sum()), 1)
    rendered = fly(seed, "garbi", "images", longest)
    both, only_cast, only_rendered = (float(count) / total for count in counts)
    ends = [flight.dive.motion.at(longest - 0.1).position[0] for flight in (cast, rendered)]
    return Agreed(
        seed, cast.outcome.kind, total, both, only_cast, only_rendered,
        float(np.sqrt(np.mean((difference / sigma) ** 2))), float(np.median(difference)),
        cast.outcome.gap, rendered.outcome.gap, float(np.linalg.norm(ends[0] - ends[1])),
    )  # fmt: skip
