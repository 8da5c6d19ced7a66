"""Survey of 4 x 4 m with 0.4 m of relief and boulders: adaptive lanes against a lawnmower at a fixed height."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from behaviours.feed import Seen
from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, Prior, SurveySettings
from behaviours.survey import Survey
from behaviours.types import Pose
from garbi_map.log.records import Floats
from tools.simulator.dive import Dive
from tools.simulator.sensors import START_NS
from tools.trials.feed import DiveFeed
from tools.trials.scenario import ACROSS, OBLIQUE, open_water
from tools.trials.world import Block, World

PERIOD = 0.1
AREA = (0.5, -2.0, 4.5, 2.0)
CELL = 0.1  # m
CELLS = (round((AREA[2] - AREA[0]) / CELL), round((AREA[3] - AREA[1]) / CELL))
OVERLAP = 0.2
ALTITUDE = 1.3  # m
WAVE = 40  # decisions: the path is that of the mean over a wave
HALF = np.array([0.65, 0.45, 0.35])
How = Literal["adaptive", "fixed", "oblique"]


@dataclass(frozen=True)
class Surveyed:
    """What became of a survey, by the true motion.

    coverage  share of the area's cells that were truly lit; claimed: what the behaviour believes
    overlap   of neighbouring lanes, the smallest share of the narrower one's cells
    path      m, the waves' to and fro left out, from the first lane's begin
    best      m: straight lanes as wide as the view over this terrain at the altitude asked for, with the overlap asked
              for, and the steps between them
    gap       least distance, m, between hull and boulders
    """

    seed: int
    how: str
    coverage: float
    claimed: float
    overlap: float
    lanes: int
    path: float
    best: float
    seconds: float
    gap: float

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


class FixedLawnmower(Survey):
    """The same lanes at the height and with the width that flat ground would have; no hole is revisited."""

    WIDTH = 2 * 0.5 * ALTITUDE  # m: the view's opening at the altitude over flat ground

    def __init__(self, settings: SurveySettings, ahead: float) -> None:
        super().__init__(settings, ahead)
        self._height: float | None = None
        self._holes_left = 0

    def _altitude(self, pose: Pose) -> float:
        self._height = float(pose.position[2]) if self._height is None else self._height
        return float(np.clip(0.5 * (self._height - pose.position[2]), -0.1, 0.1))

    def _view(self) -> tuple[float, float]:
        return -self.WIDTH / 2, self.WIDTH / 2


def make_world(seed: int) -> World:
    """Boulders of up to half a metre."""
    rng = np.random.default_rng([seed, 80])
    still = []
    for _ in range(4):
        x, y, height = float(rng.uniform(1.0, 4.0)), float(rng.uniform(-1.7, 1.7)), float(rng.uniform(0.25, 0.5))
        still.append(Block((x, y, height / 2), (0.15, 0.12, height / 2), float(rng.uniform(0, 3))))
    return World(list(still))


def run(seed: int, how: How = "adaptive", longest: float = 420.0, relief: float = 0.1) -> Surveyed:
    """A rig that looks down, or obliquely, its sheet laid across the way; the operator's word that the water above is free.

    relief: m, 1 sigma: 0.4 m from the lowest to the highest."""
    rig = OBLIQUE if how == "oblique" else ACROSS
    ground = {"relief": relief, "stones": 0.1, "stone_size": (0.05, 0.2)}
    scenario = open_water(seed, rig, altitude=ALTITUDE + 0.1, seabed=ground)
    world = make_world(seed)
    dive = world.make(scenario)
    settings = BehaviourSettings(
        travel=None,
        prior=Prior(free_above=0.2, speed=0.15),
        survey=SurveySettings(area=AREA, altitude=ALTITUDE, speed=0.15, overlap=OVERLAP, cell=CELL),
    )
    feed = DiveFeed(dive, settings.feed)
    pilot = Pilot(settings, feed.rig, feed.mount)
    if how == "fixed":
        assert settings.survey is not None
        pilot.behaviours[-1] = FixedLawnmower(settings.survey, float(feed.mount.translation[0]))
    survey = pilot.behaviours[-1]
    assert isinstance(survey, Survey)
    start, points = dive.vehicle.position.copy(), world.points()
    lit: dict[int, np.ndarray] = {}
    way, widths, gap, now = [], [], np.inf, 0.0
    while now < longest:
        now += PERIOD
        seen = feed.until(START_NS + round(now * 1e9))
        decision = pilot.decide(seen)
        feed.step(decision.command, PERIOD)
        lane = survey.lanes if survey.begun else 0  # nought: on the way to one
        light(lit.setdefault(lane, np.zeros(CELLS, bool)), AREA[:2], seen, dive, start)
        way.append((survey.begun, *dive.vehicle.position))
        gap = min(gap, world.gap(points, dive.vehicle.position, dive.vehicle.attitude.as_matrix(), HALF, now))
        proposal = decision.proposal("survey")
        if survey.coverage.width is not None and survey.begun:
            widths.append(survey.coverage.width[1] - survey.coverage.width[0])
        if proposal is not None and ("done:" in proposal.reason or "cannot be reached" in proposal.reason):
            break
    path = np.array(way)
    path = path[int(np.argmax(path[:, 0])) :, 1:]
    mean = np.stack([np.convolve(path[:, axis], np.ones(WAVE) / WAVE, "valid") for axis in range(3)], 1)
    width, side = float(np.median(widths)) if widths else FixedLawnmower.WIDTH, AREA[3] - AREA[1]
    lanes = 1 + int(np.ceil(max(side - width, 0.0) / (width * (1 - OVERLAP))))
    return Surveyed(
        seed, how, float(np.any(list(lit.values()), axis=0).mean()), survey.coverage.share, _overlap(lit), survey.lanes,
        float(np.linalg.norm(np.diff(mean, axis=0), axis=1).sum()),
        lanes * (AREA[2] - AREA[0]) + max(side - width, 0.0), now, float(gap),
    )  # fmt: skip


def light(cells: np.ndarray, corner: tuple[float, float], seen: Seen, dive: Dive, start: Floats) -> None:
    """Mark the cells of an area (nx, ny) from `corner` on, m from the start, that the profiles truly showed."""
    for profile in seen.profiles:
        true = dive.motion.at((profile.stamp_ns - START_NS) * 1e-9)
        base = profile.pose.to_base(profile.points[profile.solid])
        points = true.rotation[0].apply(base) + true.position[0] - start
        index = np.floor((points[:, :2] - corner) / CELL).astype(int)
        index = index[((index >= 0) & (index < cells.shape)).all(1)]
        cells[tuple(index.T)] = True


def _overlap(lit: dict[int, np.ndarray]) -> float:
    """Of each lane with the one before."""
    lanes = [lit[number] for number in sorted(lit) if number > 0]
    shares = [float((one & other).sum() / max(min(one.sum(), other.sum()), 1)) for one, other in pairwise(lanes)]
    return min(shares) if shares else float("nan")
