"""The simulated vehicle moves as GARBI would."""

from __future__ import annotations

import numpy as np
import pytest

from tools.simulator.route import plan
from tools.simulator.scenario import Route, Scenario, Sway, Water
from tools.simulator.vehicle import Command, Vehicle

STILL = Scenario(sway=Sway(translation=0, rotation=0))


def started(scenario: Scenario) -> Vehicle:
    """At the origin, 1.3 m up, heading east."""
    return Vehicle(scenario, np.array([0.0, 0.0, 1.3]), 0.0)


@pytest.mark.parametrize("command", [Command(surge=0.2), Command(heave=-0.1), Command(yaw=0.2), Command(pitch=0.05)])
def test_the_four_degrees_of_freedom_obey(command: Command) -> None:
    """After some seconds the vehicle moves as told."""
    vehicle = started(STILL)
    vehicle.step(command, 8.0 if not command.pitch else 2.0)
    now = vehicle.motion.at(vehicle.time)
    body = now.rotation.inv().apply(now.velocity)[0]
    reached = [body[0], body[2], now.rate[0, 2], now.rate[0, 1]]
    assert np.allclose(reached, [command.surge, command.heave, command.yaw, command.pitch], atol=0.02)


def test_a_beam_current_carries_it_away() -> None:
    """There is no sway thruster: across the bow it ends up moving with the water, along it it holds."""
    vehicle = started(STILL.model_copy(update={"water": Water(current=(0.1, 0.1))}))
    vehicle.step(Command(), 40.0)
    velocity = vehicle.motion.at(vehicle.time).velocity[0]
    assert velocity[0] == pytest.approx(0.0, abs=0.005)
    assert velocity[1] == pytest.approx(0.1, abs=0.01)


def test_waves_sway_it_by_what_the_scenario_says() -> None:
    """Sideways it goes with the water: 1 sigma as asked, within the spread of a minute of irregular waves."""
    vehicle = started(Scenario(sway=Sway(translation=0.04, rotation=0.03)))
    vehicle.step(Command(), 60.0)
    motion = vehicle.motion.at(np.arange(10, 60, 0.05))
    sideways = motion.position[:, 1] - np.polyval(
        np.polyfit(np.arange(1000), motion.position[:, 1], 1), np.arange(1000)
    )
    assert 0.025 < sideways.std() < 0.055
    roll = motion.rotation.as_euler("ZYX")[:, 2]
    assert 0.015 < roll.std() < 0.06


def test_closed_loop_steps_join() -> None:
    """Many short steps of one command are one long step."""
    scenario = Scenario(water=Water(current_sigma=0.02))
    one, many = started(scenario), started(scenario)
    one.step(Command(surge=0.1), 2.0)
    for _ in range(20):
        many.step(Command(surge=0.1), 0.1)
    assert np.array_equal(one.motion.rows, many.motion.rows)


@pytest.mark.parametrize("kind", ["lawnmower", "shuttle", "straight"])
def test_a_route_is_flown_at_its_speed_with_the_bow_along_it(kind: str) -> None:
    """The reference is continuous, never faster than asked, and its heading is its direction (astern: opposite)."""
    reference = plan(Route(kind=kind, lanes=3, heading=0.5, centre=(3.0, -2.0)), 90.0)  # type: ignore[arg-type]
    step = np.diff(reference.position, axis=0)
    speed = np.linalg.norm(step, axis=1) / np.diff(reference.time)
    assert reference.time[-1] >= 90.0
    assert speed.max() < 0.121
    assert np.linalg.norm(step, axis=1).max() < 0.03
    way = step * np.sign(reference.speed[1:, None])
    off = np.arctan2(way[:, 1], way[:, 0]) - reference.heading[1:]
    assert np.percentile(np.abs((off + np.pi) % (2 * np.pi) - np.pi), 75 if kind == "shuttle" else 100) < 0.06


def test_a_bluerov_comes_to_rest_and_obeys() -> None:
    """With the signs corrected the published model damps: let go at speed it slows down; told to go, it goes."""
    vehicle = started(STILL.model_copy(update={"vehicle": "bluerov2"}))
    vehicle.step(Command(surge=0.4), 6.0)
    assert np.linalg.norm(vehicle.velocity) == pytest.approx(0.4, abs=0.02)
    vehicle.step(Command(), 6.0)
    assert np.linalg.norm(vehicle.velocity) < 0.02
    vehicle.step(Command(yaw=0.3), 6.0)
    assert vehicle.motion.at(vehicle.time).rate[0, 2] == pytest.approx(0.3, abs=0.02)
