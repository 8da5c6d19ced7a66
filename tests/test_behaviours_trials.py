"""A handful of closed-loop trials: the vehicle in its water, the behaviours on what the scanner sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from behaviours.avoidance import Avoidance
from behaviours.leeway import Leeway
from behaviours.log_feed import LogFeed
from behaviours.pilot import Pilot
from behaviours.replay import decide_all, plan_of
from behaviours.safety import Filtered, SafetyFilter
from behaviours.settings import BehaviourSettings, TravelSettings
from behaviours.types import Command, Proposal
from garbi_map.log import open_log
from garbi_map.stripe import StripeSettings
from tools.simulator.scenario import Mover
from tools.simulator.sensors import START_NS
from tools.trials.avoidance import KINDS, SMALL, Outcome, make_world, run, save
from tools.trials.avoidance import fly as fly_trial
from tools.trials.feed import DiveFeed, Level
from tools.trials.scenario import open_water
from tools.trials.sources import fingerprint
from tools.trials.stabilisation import run as hold
from tools.trials.table import append, draw, judge, read, table
from tools.trials.world import Block, Rod, World

HALF = np.array([0.65, 0.45, 0.35])


def fly(world: World, seconds: float, seed: int = 3, level: Level = "profiles") -> tuple[float, float, list[str]]:
    """Straight on: least gap to the obstacle, distance made good, what was said."""
    scenario = open_water(seed, water={"current": (0.03, 0.0)}, camera=SMALL)
    dive = world.make(scenario) if level == "images" else world.make_plain(scenario)
    settings = BehaviourSettings(travel=TravelSettings(speed=0.25))
    feed = DiveFeed(dive, settings.feed, level, lost=0.05)
    pilot = Pilot(settings, feed.rig, feed.mount)
    points, gap, said = world.points(), np.inf, []
    for n in range(1, round(seconds * 10) + 1):
        decision = pilot.decide(feed.until(START_NS + n * 100_000_000))
        feed.step(decision.command, 0.1)
        said.append(decision.text())
        position, rotation = dive.vehicle.position, dive.vehicle.attitude.as_matrix()
        gap = min(gap, world.gap(points, position, rotation, HALF, 0.1 * n))
    return gap, float(dive.vehicle.position[0]), said


def test_the_vehicle_does_not_touch_a_wall_that_it_is_told_to_fly_into() -> None:
    """Straight on at full speed, current astern, 5 % of the images lost: it stops short of the wall."""
    gap, made, said = fly(World([Block((2.3, 0.0, 1.2), (0.1, 3.0, 1.6))]), 16.0)
    assert gap > 0.1
    assert made > 0.3
    assert any("an obstacle" in one for one in said)


def test_rendered_images_and_cast_profiles_end_alike() -> None:
    """The same approach to a wall at both levels: it comes to rest at the same place, within 8 cm."""
    world = World([Block((1.7, 0.0, 1.2), (0.1, 3.0, 1.6))])
    cast, rendered = (fly(world, 6.0, level=level) for level in ("profiles", "images"))
    assert cast[0] > 0.1 and rendered[0] > 0.1
    assert abs(cast[0] - rendered[0]) < 0.08 and abs(cast[1] - rendered[1]) < 0.08


def test_plain_shapes_are_met_where_their_meshes_are() -> None:
    """Rays at a block, a rod, a ball and the ground: distances to 3 mm of those to the triangles, normals to 5 degrees."""
    world = World(
        [Block((2.0, 0.5, 1.2), (0.1, 0.6, 0.8), 0.4), Rod((2.5, -1.2, -0.2), (2.6, -1.0, 2.5), 0.2)],
        (Mover(kind="sphere", size=0.5, start=(1.5, -0.4, 1.0)),),
    )
    scenario = open_water(5)
    plain, meshes = world.make_plain(scenario).scene, world.make(scenario).scene
    rng = np.random.default_rng(1)
    away = rng.normal(size=(4000, 3)) * [0.2, 0.5, 0.35] + [1.0, 0.0, -0.2]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    origin = np.broadcast_to([0.0, 0.0, 1.1], away.shape).copy()
    near, normal = plain.cast(origin, away, 2.0)
    expected, facing = meshes.cast(origin, away, 2.0)
    both = np.isfinite(near) & np.isfinite(expected) & (expected < 5.0)
    assert both.mean() > 0.5
    off = np.abs(near[both] - expected[both])
    assert np.percentile(off, 98) < 0.003
    angle = np.arccos(np.clip((normal[both] * facing[both]).sum(1), -1, 1))
    assert np.percentile(angle, 90) < np.radians(5.0)


def test_in_open_water_it_goes_on() -> None:
    """The ground proves the water clear: nothing stops it for long."""
    _, made, _ = fly(World([]), 14.0)
    assert made > 1.2


@pytest.mark.parametrize("seed", [1, 4])
def test_a_handful_of_trials(seed: int) -> None:
    """A pillar, and something that comes towards it: the goal is reached and nothing is touched, although a vehicle that
    looks at nothing may well hit it."""
    outcome = run(seed)
    assert outcome.reached and not outcome.collided and outcome.gap > 0.1


def test_the_barrier_is_what_keeps_it_off_the_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """Closed loop, told to fly into a wall, without the barriers (leeway's is one) and avoidance: it does. With them it does
    not."""
    wall = World([Block((1.6, 0.0, 1.2), (0.1, 3.0, 1.6))])
    monkeypatch.setattr(Avoidance, "propose", lambda self, situation: Proposal("avoidance", 0.0, Command(), "off"))
    assert fly(wall, 14.0)[0] > 0.1
    monkeypatch.setattr(SafetyFilter, "filter", lambda self, wanted, *_: Filtered(wanted, [], False, np.empty((0, 5))))
    monkeypatch.setattr(Leeway, "check", lambda self, *_: None)
    assert fly(wall, 14.0)[0] <= 0.0


def test_the_table_tells_what_was_avoidable(tmp_path: Path) -> None:
    """A collision that the omniscient controller avoids is avoidable; a goal that it does not reach is not feasible."""

    def outcome(seed: int, controller: str, collided: bool, reached: bool) -> Outcome:
        return Outcome(seed, "wall", controller, collided, reached, 0.1, 9.0, 1.0, 0)

    for one in (
        outcome(0, "omniscient", False, True), outcome(5, "omniscient", True, False), outcome(10, "omniscient", False, True),
        outcome(0, "garbi", True, False), outcome(5, "garbi", True, False), outcome(10, "garbi", False, True),
    ):  # fmt: skip
        append(tmp_path / "trials.csv", one)
    kept = read(tmp_path / "trials.csv")
    assert judge(kept)["garbi", "all"] == {
        "trials": 3,
        "collided": 2,
        "avoidable": 1,
        "unseen": 0,
        "feasible": 2,
        "reached": 1,
    }
    told = table(kept)
    assert "| garbi | all | 3 | 2 | 1 | 0 | 2 | 1 (50 %) | 9 |" in told
    assert "Not avoidable (omniscient collided): 5." in told and "garbi collided although avoidable: 0." in told
    draw(kept, tmp_path / "trials.svg")
    assert (tmp_path / "trials.svg").read_text().count("<rect") > 6


def test_a_trial_flown_again_replaces_what_earlier_sources_made_of_it(tmp_path: Path) -> None:
    """The later row counts, and the table says which sources the flights come from."""
    for sources, reached in (("1111", False), ("2222", True)):
        append(tmp_path / "trials.csv", Outcome(0, "wall", "garbi", False, reached, 0.1, 9.0, 1.0, 0, sources))
    append(tmp_path / "trials.csv", Outcome(5, "wall", "garbi", False, False, 0.1, 9.0, 1.0, 0, "1111"))
    kept = read(tmp_path / "trials.csv")
    assert [one.reached for one in kept] == [True, False]
    assert "sources 2222: 1 garbi" in table(kept) and "sources 1111: 1 garbi" in table(kept)


def test_only_what_decides_a_flight_is_in_its_fingerprint(tmp_path: Path) -> None:
    """Comments, docstrings and files that are not imported do not count; a number in an imported file does."""
    tools, behaviours = tmp_path / "tools", tmp_path / "behaviours"
    tools.mkdir()
    behaviours.mkdir()
    (tools / "fly.py").write_text('"""A flight."""\nfrom behaviours.pilot import GAIN\n')
    (behaviours / "pilot.py").write_text("GAIN = 1\n")

    def now() -> str:
        fingerprint.cache_clear()
        return fingerprint(tmp_path, "tools/fly.py")

    before = now()
    (tools / "fly.py").write_text('"""Another word for it."""\nfrom behaviours.pilot import GAIN  # louder\n')
    (behaviours / "unused.py").write_text("GAIN = 3\n")
    assert now() == before
    (behaviours / "pilot.py").write_text("GAIN = 2\n")
    assert now() != before


def test_a_flight_is_saved_as_a_log_that_replays(tmp_path: Path) -> None:
    """With its images, its navigation and its goal."""
    flight = fly_trial(1, longest=3.0)
    save(flight, tmp_path / "trial.mcap")
    log = open_log([tmp_path / "trial.mcap"])
    plan = plan_of(log, None)
    decisions = list(decide_all(LogFeed(log, plan.behaviours.feed, StripeSettings(), workers=1), plan))
    assert log.image_count > 50 and len(decisions) > 15
    assert plan.behaviours.travel is not None and plan.behaviours.travel.goal is not None
    assert plan.behaviours.travel.goal == pytest.approx(flight.goal, abs=1e-3)
    assert any("looking before the first move" in one.text() for one in decisions)


def test_trials_are_drawn_from_their_seed() -> None:
    """The same seed is the same world; five seeds in a row are five kinds."""
    assert make_world(12) == make_world(12)
    assert [make_world(seed)[1] for seed in range(5)] == list(KINDS)


def test_the_gap_is_that_of_plain_geometry() -> None:
    """From the hull's face to a pillar's skin, and nought inside."""
    world = World([Rod((2.0, 0.0, -1.0), (2.0, 0.0, 1.0), 0.2)])
    points = world.points()
    gap = world.gap(points, np.zeros(3), np.eye(3), HALF, 0.0)
    assert abs(gap - (2.0 - 0.2 - 0.65)) < 0.01
    assert world.gap(points, np.array([1.5, 0.0, 0.0]), np.eye(3), HALF, 0.0) <= 0.0


def test_station_is_kept_in_current_and_waves() -> None:
    """1.5 m before a wall, 0.1 m/s along the view, waves of 5 cm and 4 s: within 2 cm and a degree, rms."""
    held = hold("wall", 3, end=34.0)
    assert held.range_mm < 20.0
    assert held.yaw_deg < 1.0 and held.pitch_deg < 1.0
    assert held.target == 1.0 and held.takes == 1
