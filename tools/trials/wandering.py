"""Wandering over the bottom: how much of it a metre of way shows, closed loop, with boulders in the way."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, Prior, SurveySettings
from behaviours.wander import Wander
from tools.simulator.sensors import START_NS
from tools.trials.feed import DiveFeed
from tools.trials.scenario import ACROSS, open_water
from tools.trials.survey import ALTITUDE, CELL, HALF, PERIOD, WAVE, light, make_world

SIDE = 24.0  # m, of the square about the start in which ground counts: all that is remembered, and a view more
LONGEST = 120.0  # s


@dataclass(frozen=True)
class Wandered:
    """What became of it, by the true motion.

    seen   m^2 of ground that were truly lit; claimed: what the behaviour believes
    path   m, the waves' to and fro left out; width: m, of the view, the median
    share  of what a straight way of that length would have shown
    gap    least distance, m, between hull and boulders
    """

    seed: int
    seen: float
    claimed: float
    path: float
    width: float
    share: float
    gap: float

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


def run(seed: int, longest: float = LONGEST) -> Wandered:
    """A rig that looks down, without a bounded area."""
    world = make_world(seed)
    scenario = open_water(seed, ACROSS, altitude=ALTITUDE + 0.1, seabed={"relief": 0.1, "margin": SIDE / 2 + 1.0})
    dive = world.make_plain(scenario)
    settings = BehaviourSettings(
        travel=None,
        prior=Prior(free_above=0.2, speed=0.15),
        survey=SurveySettings(altitude=ALTITUDE, speed=0.15, cell=CELL),
    )
    feed = DiveFeed(dive, settings.feed)
    pilot = Pilot(settings, feed.rig, feed.mount)
    wander = pilot.behaviours[-1]
    assert isinstance(wander, Wander)
    start, points = dive.vehicle.position.copy(), world.points()
    lit = np.zeros((round(SIDE / CELL),) * 2, bool)
    way, widths, gap = [], [], np.inf
    for n in range(1, round(longest / PERIOD) + 1):
        seen = feed.until(START_NS + round(n * PERIOD * 1e9))
        feed.step(pilot.decide(seen).command, PERIOD)
        light(lit, (-SIDE / 2, -SIDE / 2), seen, dive, start)
        way.append(dive.vehicle.position.copy())
        rotation = dive.vehicle.attitude.as_matrix()
        gap = min(gap, world.gap(points, dive.vehicle.position, rotation, HALF, n * PERIOD))
        if wander.coverage.width is not None:
            widths.append(wander.coverage.width[1] - wander.coverage.width[0])
    mean = np.stack([np.convolve(axis, np.ones(WAVE) / WAVE, "valid") for axis in np.array(way).T], 1)
    path, width = float(np.linalg.norm(np.diff(mean, axis=0), axis=1).sum()), float(np.median(widths))
    area, claimed = float(lit.sum()) * CELL**2, float((wander.coverage.count > 0).sum()) * CELL**2
    return Wandered(seed, area, claimed, path, width, area / (path * width), float(gap))
