"""A handful of closed-loop trials: the vehicle in its water, the behaviours on what the scanner sees."""

from __future__ import annotations

import numpy as np

from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, TravelSettings
from tools.simulator.sensors import START_NS
from tools.trials.avoidance import KINDS, make_world
from tools.trials.feed import DiveFeed
from tools.trials.scenario import open_water
from tools.trials.stabilisation import run as hold
from tools.trials.world import Block, Rod, World

HALF = np.array([0.65, 0.45, 0.35])


def fly(world: World, seconds: float, seed: int = 3) -> tuple[float, float, list[str]]:
    """Straight on: least gap to the obstacle, distance made good, what was said."""
    dive = world.make(open_water(seed, water={"current": (0.03, 0.0)}))
    settings = BehaviourSettings(travel=TravelSettings(speed=0.25))
    feed = DiveFeed(dive, settings.feed, lost=0.05)
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


def test_in_open_water_it_goes_on() -> None:
    """The ground proves the water clear: nothing stops it for long."""
    _, made, _ = fly(World([]), 14.0)
    assert made > 1.2


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
