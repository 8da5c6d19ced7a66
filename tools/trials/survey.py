"""Survey of 4 x 4 m with relief: adaptive lanes against a lawnmower at a fixed height."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from behaviours.pilot import Pilot
from behaviours.settings import AvoidanceSettings, BehaviourSettings, Prior, SurveySettings
from behaviours.survey import Survey
from tools.simulator.sensors import START_NS
from tools.trials.feed import DiveFeed
from tools.trials.scenario import open_water
from tools.trials.world import World

PERIOD = 0.1
AREA = (0.5, -2.0, 4.5, 2.0)


@dataclass(frozen=True)
class Surveyed:
    """coverage share of the area's cells; path m; seconds; best: m, straight lanes of the
    median width with the overlap asked for, and the steps between them."""

    seed: int
    coverage: float
    path: float
    seconds: float
    best: float

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


def run(seed: int, longest: float = 600.0, relief: float = 0.1) -> Surveyed:
    """A rig that looks down, its sheet laid across the way, and the operator's word that the water above is free."""
    rig = {
        "mount": {"xyz": (0.25, 0.0, -0.1), "turn": float(np.pi / 2)},
        "camera": {"focal": 560.0, "rate": 12.5},
        "laser": {"range": (-0.2, 0.6), "sweep": 2.0, "fan": 0.6},
    }
    scenario = open_water(seed, rig, altitude=1.4, seabed={"relief": relief, "stones": 0.1, "stone_size": (0.05, 0.2)})
    dive = World().make(scenario)
    settings = BehaviourSettings(
        travel=None,
        avoidance=AvoidanceSettings(),
        prior=Prior(free_above=0.2, speed=0.15),
        survey=SurveySettings(area=AREA, altitude=1.3, speed=0.15),
    )
    feed = DiveFeed(dive, settings.feed)
    pilot = Pilot(settings, feed.rig, feed.mount)
    now, path, before, share, widths = 0.0, 0.0, dive.vehicle.position.copy(), 0.0, [1.0]
    while now < longest:
        now += PERIOD
        decision = pilot.decide(feed.until(START_NS + round(now * 1e9)))
        feed.step(decision.command, PERIOD)
        path += float(np.linalg.norm(dive.vehicle.position - before))
        before = dive.vehicle.position.copy()
        proposal = decision.proposal("survey")
        if proposal is not None:
            widths += [right - left for left, right in [_width(pilot)] if right > left]
            share = proposal.facts["coverage"]
            if proposal.reason.startswith("done"):
                break
    width, overlap, side = float(np.median(widths)), 0.2, AREA[3] - AREA[1]
    lanes = 1 + int(np.ceil(max(side - width, 0.0) / (width * (1 - overlap))))
    return Surveyed(seed, share, path, now, lanes * (AREA[2] - AREA[0]) + max(side - width, 0.0))


def _width(pilot: Pilot) -> tuple[float, float]:
    survey = next(one for one in pilot.behaviours if isinstance(one, Survey))
    return survey.coverage.width or (0.0, 0.0)
