"""Water carries a vehicle without sway: it turns into the current while there is room to, and not before there is need."""

from __future__ import annotations

import numpy as np
import pytest

from behaviours.decisions import Decision
from behaviours.feed import Seen
from behaviours.kernels_rollout import moved_on
from behaviours.leeway import Leeway
from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, LeewaySettings, Vehicle
from behaviours.situation import Situation
from behaviours.space import Space
from behaviours.types import Command, Pose, Proposal
from tests.behaviour_parts import MOUNT, START, pose, rig, space

CURRENT = 0.1  # m/s, along x: on to the wall
HALF = np.array(Vehicle().hull) / 2
BROADSIDE = np.pi / 2


def water(at: Pose, wall: float | None) -> Space:
    """Seen and free all about, but for a wall across x at that distance from base_link, m."""
    found = space()
    found.be_at(at)
    found.layers[0][:] = found.milliseconds(at.stamp_ns)
    if wall is not None:
        found.layers[3][int(np.floor(wall / found.voxel)) % found.shape[0]] = 9
    return found


def carried(distance: float, guarded: bool = True, seconds: float = 30.0) -> tuple[float, float]:
    """Least gap, m, between hull and a wall that many m to leeward of its side, when the vehicle lies broadside and wants
    nothing but to stay so; and the heading, rad, in the end."""
    wall = distance + HALF[1]
    x, y, heading, surge, sway, rate = 0.0, 0.0, BROADSIDE, 0.0, -CURRENT, 0.0
    model = np.array([0.5, 0.6, Vehicle().sway_time, Vehicle().skid])
    current, least = np.array([CURRENT, 0.0]), np.inf
    leeway, free = Leeway(LeewaySettings(), Vehicle()), water(pose(0), wall)
    for n in range(round(seconds / 0.1)):
        at = pose(0.1 * n, (x, y, 0.0), heading, (surge, sway, 0.0))
        at = Pose(at.stamp_ns, at.position, at.rotation, at.velocity, np.array([0.0, 0.0, rate]))
        found = leeway.check(Command(), at, free, current, 0.3) if guarded else None
        command = found[0] if found else Command()
        x, y, heading, surge, sway, rate = moved_on(
            x, y, heading, surge, sway, rate, command.surge, 0.85 * command.yaw, current, 0.1, model
        )
        reach = abs(np.cos(heading)) * HALF[0] + abs(np.sin(heading)) * HALF[1]
        least = min(least, wall - x - float(reach))
    return least, heading


@pytest.mark.parametrize("distance", [0.8, 1.2, 2.0])
def test_broadside_it_turns_into_the_current_in_time(distance: float) -> None:
    """A quarter of a turn takes some seven seconds, in which it is carried half a metre; with more than that to leeward, the
    hull never comes to the wall, and holds bow or stern into the current."""
    gap, heading = carried(distance)
    assert gap > 0.1
    assert abs(np.sin(heading)) < 0.5


def test_without_the_barrier_the_water_carries_it_on_to_the_wall() -> None:
    """The same vehicle left to itself: the claim above is a claim about the barrier."""
    assert carried(2.0, guarded=False)[0] < 0.0


def test_with_no_time_left_to_turn_it_still_does_what_helps_most() -> None:
    """A quarter of a metre to leeward cannot be kept; it does not give up."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    got = Leeway(LeewaySettings(), Vehicle()).check(
        Command(), at, water(at, HALF[1] + 0.25), np.array([CURRENT, 0.0]), 0.3
    )
    assert got is not None and (got[0].surge, got[0].yaw) != (0.0, 0.0)


@pytest.mark.parametrize(
    ("wall", "current"),
    [(None, (CURRENT, 0.0)), (HALF[1] + 0.5, (0.0, 0.0)), (HALF[1] + 0.5, (-CURRENT, 0.0)), (4.0, (CURRENT, 0.0))],
)
def test_where_there_is_room_it_says_nothing(wall: float | None, current: tuple[float, float]) -> None:
    """No wall; no current; a current that leads away from it; or far enough: the command is let by."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE)
    assert Leeway(LeewaySettings(), Vehicle()).check(Command(), at, water(at, wall), np.array(current), 0.3) is None


def test_what_was_never_seen_to_leeward_is_not_free() -> None:
    """The same wall, not seen: unseen water in its place."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE)
    unseen = water(at, None)
    first = int(np.floor((HALF[1] + 0.3) / unseen.voxel))
    for n in range(first, 40):
        unseen.layers[0][n % unseen.shape[0]] = -(2**30)
    current = np.array([CURRENT, 0.0])
    assert Leeway(LeewaySettings(), Vehicle()).check(Command(), at, unseen, current, 0.3) is not None
    assert Leeway(LeewaySettings(), Vehicle()).check(Command(), at, unseen, current, 0.3, shun_unseen=False) is None


@pytest.mark.parametrize("faces", [True, False])
def test_who_faces_something_is_turned_away_by_what_stands_only(faces: bool) -> None:
    """Holding before a wall in a current along it, water carries the vehicle on to where nobody has looked: it drifts and
    says so. On the way somewhere it turns in."""

    class Stay:
        name = "stay"

        def propose(self, situation: Situation) -> Proposal:
            return Proposal("stay", 1.0, Command(), "whatever", 10**6, faces=faces)

    pilot = Pilot(BehaviourSettings(), rig(), MOUNT)
    pilot.behaviours.append(Stay())
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    pilot.space = water(at, None)
    for n in range(int(np.floor((HALF[1] + 0.3) / pilot.space.voxel)), 40):
        pilot.space.layers[0][n % pilot.space.shape[0]] = -(2**30)
    pilot.drift.current = np.array([CURRENT, 0.0])
    turned = any("current" in change for change in pilot.decide(Seen(START, at)).changes)
    assert turned is not faces


def test_no_surge_ahead_is_rehearsed_that_the_view_does_not_allow() -> None:
    """With an old view of what is ahead, an escape ahead is none."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE)
    got = Leeway(LeewaySettings(), Vehicle()).check(
        Command(), at, water(at, HALF[1] + 0.5), np.array([CURRENT, 0.0]), 0.0
    )
    assert got is not None and got[0].surge <= 0.0


def beside_the_stern(at: Pose, distance: float = 0.65) -> Space:
    """Known and free, but for something that many m to leeward of the stern and of what lies astern; ahead there is room."""
    found = water(at, None)
    along = np.mod(np.arange(-40, -2), found.shape[1])
    found.layers[3][int(np.floor((HALF[1] + distance) / found.voxel)) % found.shape[0], along] = 9
    return found


@pytest.mark.parametrize(("bold", "goes_on"), [(0.2, True), (0.0, False)])
def test_an_old_view_does_not_stop_what_stopping_would_carry_on_to_something(bold: float, goes_on: bool) -> None:
    """Only ahead is there room. What may have come there since is a lesser danger than what is there for sure; but where
    even a fresh view would not let it, it does not go."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    current = np.array([CURRENT, 0.0])
    got = Leeway(LeewaySettings(), Vehicle()).check(Command(), at, beside_the_stern(at), current, 0.0, bold)
    assert got is not None
    assert (got[0].surge > 0.1, got[2]) == (goes_on, goes_on)


def test_an_old_view_bounds_it_as_long_as_another_way_keeps_clear() -> None:
    """With a hand's breadth more to leeward backing off and turning in is enough, though ahead there would be more room."""
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    got = Leeway(LeewaySettings(), Vehicle()).check(
        Command(), at, beside_the_stern(at, 0.95), np.array([CURRENT, 0.0]), 0.0, 0.2
    )
    assert got is not None and got[0].surge < 0.0 and not got[2]


@pytest.mark.parametrize(("troubles", "goes_on"), [([], True), (["navigation is silent"], False)])
def test_the_pilot_goes_on_with_an_old_view_but_never_blind(troubles: list[str], goes_on: bool) -> None:
    """The same through a pilot whose view ahead is ten seconds old: it goes on and says so; without navigation it stops."""
    pilot = Pilot(BehaviourSettings(), rig(), MOUNT)
    at = pose(10.0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    pilot.space = beside_the_stern(at)
    pilot.space.layers[0][:] -= 10_000
    pilot.drift.current = np.array([CURRENT, 0.0])
    decision = pilot.decide(Seen(at.stamp_ns, at, [], troubles))
    assert (decision.command.surge > 0.1) is goes_on
    assert any("faster than the view ahead allows" in change for change in decision.changes) is goes_on


def test_the_pilot_flies_it_whatever_is_proposed_and_says_why() -> None:
    """Any behaviour that would stay broadside: the decision turns the vehicle in, in words."""

    class Stay:
        name = "stay"

        def propose(self, situation: Situation) -> Proposal:
            return Proposal("stay", 1.0, Command(), "whatever", 10**6)

    pilot = Pilot(BehaviourSettings(), rig(), MOUNT)
    pilot.behaviours.append(Stay())
    at = pose(0, (0.0, 0.0, 0.0), BROADSIDE, (0.0, -CURRENT, 0.0))
    pilot.space = water(at, HALF[1] + 0.7)
    pilot.drift.current = np.array([CURRENT, 0.0])
    decision: Decision = pilot.decide(Seen(START, at))
    assert abs(decision.command.yaw) > 0.2 or abs(decision.command.surge) > 0.05
    assert "current" in decision.changes[0]
