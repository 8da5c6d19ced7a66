"""Randomised avoidance trials: a goal behind walls, pillars, cables, overhangs and moving things."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, TravelSettings, Vehicle
from tools.simulator.dive import Dive
from tools.simulator.record import write_log
from tools.simulator.scenario import Model, Mover, Scenario
from tools.simulator.sensors import START_NS
from tools.trials.baselines import NoAvoidance, Omniscient, PotentialField, StopZone
from tools.trials.feed import DiveFeed, Level
from tools.trials.scenario import open_water
from tools.trials.sources import fingerprint
from tools.trials.world import Block, Rod, World, shown

KINDS = ("wall", "pillar", "cable", "overhang", "moving")
PERIOD = 0.1  # s
SMALL = {"width": 384, "height": 288, "focal": 280.0}  # a quarter of the pixels: the same view, four times as fast
CLEAR = 1.2  # m of free water about the hull at the start, as the operator states it
LONGEST = 200.0  # s
REACHED = 0.5  # m from the goal
GIVEN_UP = 30.0  # s in one place, after which a baseline is not flown on
Controller = Literal["garbi", "omniscient", "none", "potential", "stop"]
BLIND = ("omniscient", "none")  # look at nothing
PILOTS: dict[str, type[Pilot]] = {
    "garbi": Pilot,
    "omniscient": Omniscient,
    "none": NoAvoidance,
    "potential": PotentialField,
    "stop": StopZone,
}
VEHICLES = {
    "garbi": Vehicle(),
    "bluerov2": Vehicle(hull=(0.46, 0.58, 0.37), sway_time=1.5, skid=0.95),
}


@dataclass(frozen=True)
class Outcome:
    """What became of a trial: gap is the least distance, m, between hull and obstacle; passes: of the laser that showed
    what moves (0 where nothing looks): from fewer than two nothing can tell that it does; sources: what it was flown
    with, see `fingerprint`."""

    seed: int
    kind: str
    controller: str
    collided: bool
    reached: bool
    gap: float
    seconds: float
    length: float
    passes: int
    sources: str = ""

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


def make_world(seed: int) -> tuple[World, str, tuple[float, float, float]]:
    """Obstacles between the start and the goal, which kind dominates, and the goal (relative to the start)."""
    rng = np.random.default_rng([seed, 77])
    kind = KINDS[seed % len(KINDS)]
    goal = (float(rng.uniform(4.5, 6.0)), float(rng.uniform(-1.0, 1.0)), 0.0)
    x, y = float(rng.uniform(2.4, 3.4)), float(rng.uniform(-0.5, 0.5))
    still: list[Block | Rod] = []
    movers: tuple[Mover, ...] = ()
    if kind == "wall":
        turn = float(rng.uniform(-0.5, 0.5))
        still.append(Block((x, y, 1.2), (0.08, float(rng.uniform(0.5, 1.2)), 1.6), turn))
    elif kind == "pillar":
        for _ in range(rng.integers(1, 4)):
            px, py = float(rng.uniform(2.2, 4.0)), float(rng.uniform(-1.3, 1.3))
            still.append(Rod((px, py, -0.3), (px, py, 3.2), float(rng.uniform(0.08, 0.25))))
    elif kind == "cable":
        if rng.uniform() < 0.5:
            still.append(Rod((x, y, -0.2), (x + float(rng.uniform(-0.4, 0.4)), y, 3.2), 0.01, "cable"))
        else:
            height = float(rng.uniform(0.8, 1.4))
            reach = float(rng.uniform(0.8, 1.6))
            still.append(Rod((x, y - reach, height), (x, y + reach, height + 0.1), 0.01, "cable"))
    elif kind == "overhang":
        bottom = float(rng.uniform(1.25, 1.6))
        still.append(Block((x, y, bottom + 0.6), (0.4, float(rng.uniform(0.7, 1.3)), 0.6), 0.0, "overhang"))
    else:
        speed, angle = float(rng.uniform(0.05, 0.15)), float(rng.uniform(-0.7, 0.7))
        meeting = np.array([float(rng.uniform(1.4, 3.2)), float(rng.uniform(-0.4, 0.4))])
        way = -np.array([np.cos(angle), np.sin(angle)])
        lead = float(rng.uniform(12.0, 20.0))
        begin = meeting - way * speed * lead
        while np.hypot(max(begin[0] - 0.65, 0.0), max(abs(begin[1]) - 0.45, 0.0)) < CLEAR + 0.3:  # as the operator said
            begin = begin - 0.1 * way
        height = float(rng.uniform(0.9, 1.3))
        movers = (
            Mover(
                kind="sphere",
                size=float(rng.uniform(0.3, 0.5)),
                start=(float(begin[0]), float(begin[1]), height),
                velocity=(float(way[0] * speed), float(way[1] * speed), 0.0),
            ),
        )
    return World(still, movers), kind, goal


@dataclass(frozen=True)
class Flight:
    """A trial flown: what became of it, the dive with its motion, the world and the goal."""

    outcome: Outcome
    dive: Dive
    world: World
    goal: tuple[float, float, float]


def run(seed: int, controller: Controller = "garbi", level: Level = "profiles", longest: float = LONGEST) -> Outcome:
    """What becomes of one trial, see `fly`."""
    return fly(seed, controller, level, longest).outcome


def fly(
    seed: int,
    controller: Controller = "garbi",
    level: Level = "profiles",
    longest: float = LONGEST,
    model: Model = "garbi",
    settings: BehaviourSettings | None = None,
) -> Flight:
    """Fly one trial: 5 % of the images lost, one dropout of 3 s, a current of up to 0.1 m/s, waves."""
    world, kind, goal = make_world(seed)
    if controller in BLIND:
        level = "blind"
    scenario = water_of(seed, model)
    dive = world.make(scenario) if level == "images" else world.make_plain(scenario)
    silent = float(np.random.default_rng([seed, 79]).uniform(5.0, 25.0))
    settings = settings or BehaviourSettings()
    settings = settings.model_copy(update={"travel": TravelSettings(goal=goal), "vehicle": VEHICLES[model]})
    feed = DiveFeed(dive, settings.feed, level, lost=0.05, silent=((silent, silent + 3.0),))
    pilot = PILOTS[controller](settings, feed.rig, feed.mount)
    if isinstance(pilot, Omniscient):
        pilot.know(world, dive)
    half = np.array(settings.vehicle.hull) / 2
    points = world.points()
    start = dive.vehicle.position.copy()
    target = start + dive.vehicle.attitude.as_matrix() @ np.array(goal)
    gap, length, reached, now, passes = np.inf, 0.0, False, 0.0, set[int]()
    before, mark, since = start, start, 0.0
    while now < longest and gap > 0.0 and not reached:
        now += PERIOD
        seen = feed.until(START_NS + round(now * 1e9))
        passes |= {profile.sweep for profile in seen.profiles if shown(dive, world.movers, profile)}
        feed.step(pilot.decide(seen).command, PERIOD)
        position, rotation = dive.vehicle.position.copy(), dive.vehicle.attitude.as_matrix()
        gap = min(gap, world.gap(points, position, rotation, half, now))
        length += float(np.linalg.norm(position - before))
        reached = bool(gap > 0.0 and np.linalg.norm(position - target) < REACHED)
        before = position
        if np.linalg.norm(position - mark) > 0.25:
            mark, since = position, now
        if controller != "garbi" and not world.movers and now - since > GIVEN_UP:
            break
    found = Outcome(seed, kind, controller, gap <= 0.0, reached, float(gap), now, length, len(passes), fingerprint())
    return Flight(found, dive, world, goal)


def water_of(seed: int, model: Model, **more: Any) -> Scenario:
    """The water and the vehicle of a trial."""
    rng = np.random.default_rng([seed, 78])
    drift, way = float(rng.uniform(0.0, 0.1)), float(rng.uniform(-np.pi, np.pi))
    water = {"current": (drift * float(np.cos(way)), drift * float(np.sin(way))), "current_sigma": 0.01}
    mount = {} if model == "garbi" else {"mount": {"xyz": (0.15, 0.0, 0.0)}}
    return open_water(seed, water=water, camera=SMALL, sensors={"imu": {"rate": 50.0}}, vehicle=model, **mount, **more)


def save(flight: Flight, path: Path) -> None:
    """The flight as a log with images, that `garbi view` shows and `garbi replay` decides on again."""
    seed, model = flight.outcome.seed, flight.dive.scenario.vehicle
    seconds = max(flight.outcome.seconds - 0.6, 1.0)  # the last readings are interpolated
    dive = flight.world.make(water_of(seed, model, duration=seconds))
    dive.vehicle = flight.dive.vehicle
    goal = ", ".join(f"{value:.3f}" for value in flight.goal)
    plan = f"behaviours: {{travel: {{goal: [{goal}]}}}}\nexpectations: []\n"
    write_log(dive, path, workers=0, metadata={"garbi.expectations": {"yaml": plan}}, truth=False)
