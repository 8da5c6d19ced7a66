"""Out of water where nothing can be seen or done: carried into the unseen, or risen out of sight of the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from behaviours.escape import Escape
from behaviours.moving import Mover
from behaviours.retreat import BACKED, PATIENCE, Retreat
from behaviours.settings import EscapeSettings, TravelSettings, Vehicle
from behaviours.situation import Situation
from behaviours.space import Space
from behaviours.travel import Travel
from behaviours.types import Pose
from tests.behaviour_parts import SECOND, START, pose, profile, space, wall

STILL = np.zeros(2)


def situation(volume: Space, at: Pose, movers: list[Mover] | None = None) -> Situation:
    corridor = volume.corridor(at, 3.0, STILL)
    return Situation(at.stamp_ns, at, [], volume, volume.nearby(at, 1.3), corridor, movers or [], [], STILL)


def carried_abeam() -> Space:
    """A volume of which only the launch and what the hull passed are known: 3 m to starboard, heading east."""
    volume = space(launch_clearance=0.3)
    for n in range(31):
        volume.be_at(pose(0.1 * n, (0.0, -0.1 * n, 0.0)))
    return volume


def test_known_water_astern_is_that_which_the_hull_came_through() -> None:
    """Heading east there is none; heading south the way that it was carried lies astern."""
    volume, at = carried_abeam(), pose(3.0, (0.0, -3.0, 0.0))
    assert volume.known_astern(at, 0.0, 0.8, STILL) < 0.15
    assert volume.known_astern(at, -np.pi / 2, 0.8, STILL) == pytest.approx(0.8, abs=0.11)


def test_a_current_abeam_shortens_what_is_known_astern() -> None:
    """It would carry the hull out of the water that it came through before it has backed off."""
    at = pose(3.0, (0.0, -3.0, 0.0))
    for aside in (0.6, -0.6):
        assert carried_abeam().known_astern(at, -np.pi / 2, 0.8, np.array([aside, 0.0])) < 0.6


def test_carried_into_the_unseen_it_turns_its_stern_to_the_way_it_came_and_backs_off() -> None:
    """After some patience; the turn is to starboard, and there it goes astern until it has really backed off."""
    volume, retreat = carried_abeam(), Retreat(Vehicle())
    got = [retreat.propose(situation(volume, pose(3.0 + 0.1 * n, (0.0, -3.0, 0.0))), 0.0, False) for n in range(80)]
    waited = 0.1 * got.index(next(one for one in got if one is not None))
    assert PATIENCE - 1.1 < waited < PATIENCE + 0.3
    surge, yaw, words = got[-1] or (0.0, 0.0, "")
    assert surge == 0.0 and yaw < -0.1 and "carried into unseen water" in words
    surge, yaw, _ = retreat.propose(situation(volume, pose(11.0, (0.0, -3.0, 0.0), -np.pi / 2)), 0.0, False) or (
        0.0,
        0.0,
        "",
    )
    assert surge < -0.05 and abs(yaw) < 0.1
    volume.layers[0][:] = volume.milliseconds(
        pose(12.0).stamp_ns
    )  # all is seen now, but a step back is made all the same
    near, far = (pose(12.0 + n, (0.0, -3.0 + n * (BACKED + 0.1), 0.0), -np.pi / 2) for n in range(2))
    assert retreat.propose(situation(volume, near), 0.0, False) is not None
    assert retreat.propose(situation(volume, far), 0.0, False) is None


def test_with_known_water_ahead_there_is_nothing_to_retreat_from() -> None:
    """However long it stands there."""
    volume, retreat = space(), Retreat(Vehicle())
    volume.be_at(pose(0))
    volume.layers[0][:] = volume.milliseconds(pose(0).stamp_ns)
    assert all(retreat.propose(situation(volume, pose(0.1 * n)), 0.0, False) is None for n in range(100))


def test_where_every_way_on_leads_into_the_unseen_it_backs_off_with_the_bow_towards_it() -> None:
    """A turn to port into water that it has not seen, again and again: after some patience it goes astern, its bow to port
    as far as the known water lets it, and once it has backed off it goes on."""
    volume, retreat = space(), Retreat(Vehicle())
    volume.be_at(pose(0))
    volume.layers[0][:] = volume.milliseconds(pose(0).stamp_ns)
    got = [retreat.propose(situation(volume, pose(0.1 * n)), np.pi / 2, True) for n in range(150)]
    waited = 0.1 * got.index(next(one for one in got if one is not None))
    assert PATIENCE < waited < 2 * PATIENCE + 0.3
    surge, yaw, _ = got[-1] or (0.0, 0.0, "")
    assert surge == 0.0 and yaw > 0.1
    turned = retreat.propose(situation(volume, pose(15.0, heading=np.pi / 3)), np.pi / 2, True) or (0.0, 0.0, "")
    assert turned[0] < -0.05 and abs(turned[1]) < 0.1
    far = pose(20.0, (-BACKED - 0.1, 0.0, 0.0), np.pi / 3)
    assert retreat.propose(situation(volume, far), np.pi / 2, True) is None


def test_in_a_current_it_backs_off_along_it_not_abeam_of_it() -> None:
    """All about is known and the way leads north: in still water the bow goes there; a current to the east turns it to the
    east or the west, whichever it has the bow nearer to, for abeam of it the hull would be carried off its way."""
    volume, at = space(), pose(0, heading=np.pi / 4)
    volume.be_at(at)
    volume.layers[0][:] = volume.milliseconds(at.stamp_ns)
    headings = []
    for current in (STILL, np.array([0.08, 0.0]), np.array([-0.08, 0.0])):
        retreat, where = Retreat(Vehicle()), replace(situation(volume, at), current=current)
        headings.append(retreat._way_back(where, np.pi / 2)[0])
    assert headings[0] > np.pi / 4
    assert max(abs(heading) for heading in headings[1:]) < np.pi / 4


def shown(volume: Space, seconds: float, height: float, anything: bool) -> Pose:
    """Two seconds of profiles at that height, with or without a wall in view; the last pose."""
    for n in range(20):
        at = pose(seconds + 0.1 * n, (0.0, 0.0, height))
        volume.be_at(at)
        volume.see(profile(wall(2.0, width=0.01) if anything else np.empty((0, 3)), at))
    return at


def test_returns_are_counted_over_the_last_second() -> None:
    """All profiles show something, then none."""
    volume = space()
    assert volume.returning(shown(volume, 0.0, 0.0, True).stamp_ns) == 1.0
    assert volume.returning(shown(volume, 2.0, 0.0, False).stamp_ns) == 0.0
    assert volume.returning(START + 60 * SECOND) == 1.0  # no profile at all says nothing about the water


def test_above_the_goal_where_nothing_returns_it_goes_down_and_at_its_height_it_does_not() -> None:
    """Out of sight of the ground nothing proves the water free: down, but never below where it is wanted anyway."""
    for height, expected in ((0.9, -0.1), (0.1, None)):
        volume, travel = space(), Travel(TravelSettings(goal=(3.0, 0.0, 0.0)), Vehicle())
        travel.looked = True
        travel.propose(situation(volume, shown(volume, 0.0, height, True)))
        for begin in (2.0, 4.0, 6.0):
            got = travel.propose(situation(volume, shown(volume, begin, height, False)))
        assert ("nothing returns at this height" in got.reason) == (expected is not None)
        if expected is not None:
            assert got.command.heave == pytest.approx(expected) and got.command.surge == 0.0


def escape(volume: Space, at: Pose, ahead: float = 1.2) -> float:
    """m/s, the heave with which it escapes something that comes head on, that far ahead, m."""
    volume.layers[3][:] = 0
    coming = Mover(1, START, START, np.array([ahead, 0.0, 0.0]), np.array([-0.15, 0.0, 0.0]), 0.2, 5, 0.01)
    got = Escape(EscapeSettings(), Vehicle()).propose(situation(volume, at, [coming]))
    assert got is not None
    return got[0].heave


def test_an_escape_rises_out_of_sight_of_the_ground_only_where_nothing_else_helps() -> None:
    """In open water it rises while something returns, and finds another way where nothing does; in a shaft it rises."""
    seen, unseen, shaft = space(), space(), space(launch_clearance=0.05)
    for n in range(19):  # known is only what it sank through
        shaft.be_at(pose(-2.0 + 0.1 * n, (0.0, 0.0, 1.8 - 0.1 * n)))
    places = [shown(volume, 0.0, 0.0, volume is seen) for volume in (seen, unseen, shaft)]
    for volume in (seen, unseen):
        volume.layers[0][:] = volume.milliseconds(places[0].stamp_ns)
    assert escape(seen, places[0]) > 0.0
    assert escape(unseen, places[1]) == 0.0
    assert escape(shaft, places[2], 2.4) > 0.0
