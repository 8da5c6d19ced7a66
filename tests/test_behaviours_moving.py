"""What moves: told from what stands by where it is from pass to pass, and got out of the way of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from behaviours import kernels
from behaviours.escape import Escape
from behaviours.moving import Mover, Movers
from behaviours.safety import SafetyFilter
from behaviours.settings import EscapeSettings, SafetySettings, TravelSettings, Vehicle
from behaviours.situation import Situation
from behaviours.space import Corridor, Nearby, Space
from behaviours.travel import Travel
from behaviours.types import Command, Pose
from garbi_map.log.records import Floats
from tests.behaviour_parts import START, obeyed, pose, profile, space, wall
from tests.test_behaviours_space import sweep

NOTHING = Nearby(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, bool))
HALF = np.array([0.65, 0.45, 0.35])


def patch(x: float, y: float = 0.0) -> Floats:
    """What the scanner shows of a ball: a patch of 0.3 m, square to x."""
    yy, zz = np.meshgrid(np.linspace(-0.15, 0.15, 30), np.linspace(-0.15, 0.15, 90))
    return np.stack([np.full(yy.size, x), y + yy.ravel(), zz.ravel()], 1)


def watch(speed: float, passes: int) -> tuple[Movers, Space, bool]:
    """A ball 2.4 m ahead that has been there since the first look, coming nearer at a speed; and whether it was undecided
    after its first pass."""
    volume, movers, undecided = space(), Movers(288), False
    for number in range(passes):
        ball = patch(2.4 - speed * 3.0 * number)
        for one, (surprising, newly) in sweep(volume, np.concatenate([wall(2.8), ball]), 3.0 * number, number):
            movers.see(one, surprising, newly)
            for place in movers.left():
                volume.forget(*place)
        undecided = undecided or (number == 0 and len(movers.undecided(pose(3.0).stamp_ns)) == 1)
    return movers, volume, undecided


def test_what_is_nearer_in_the_next_pass_moves() -> None:
    """A ball that was there at the first look, so that no water about it had long been free: its velocity to 3 cm/s."""
    movers, volume, undecided = watch(0.12, 3)
    (found,) = movers.now()
    assert undecided
    assert found.passes == 3 and found.velocity == pytest.approx([-0.12, 0.0, 0.0], abs=0.03)
    assert found.doubt < 0.03
    assert volume.state(np.array([[2.4, 0.0, 0.0]]))[0] != kernels.OCCUPIED, "where it was is no obstacle any more"


def test_what_stands_is_never_called_moving() -> None:
    """The same ball at rest: undecided at first, then nothing."""
    movers, volume, undecided = watch(0.0, 5)
    assert undecided
    assert movers.now() == [] and movers.undecided(pose(15.0).stamp_ns) == []
    assert volume.state(np.array([[2.4, 0.0, 0.0]]))[0] == kernels.OCCUPIED


def open_water() -> Space:
    """A volume all of which was seen free."""
    volume = space()
    volume.be_at(pose(0))
    volume.layers[0][:] = volume.milliseconds(pose(0).stamp_ns)
    return volume


def moment(at: Pose, mover: Mover | None, volume: Space, undecided: list[Mover] | None = None) -> Situation:
    """What the behaviours are asked about."""
    movers = [] if mover is None else [mover]
    corridor = Corridor(3.0, 0.1, "nothing")
    return Situation(at.stamp_ns, at, [], volume, NOTHING, corridor, movers, [], np.zeros(2), undecided or [])


def escaped(
    begin: tuple[float, float, float], velocity: tuple[float, float, float], volume: Space
) -> tuple[float, Pose]:
    """Least gap, m, between a ball of 0.2 m radius and the hull of a vehicle that goes on at 0.1 m/s but for its escapes."""
    escape, at, least = Escape(EscapeSettings(), Vehicle()), pose(0), np.inf
    centre, speed = np.array(begin), np.array(velocity)
    for _ in range(400):
        asked = escape.propose(moment(at, Mover(1, at.stamp_ns, START, centre, speed, 0.2, 3, 0.01), volume))
        surge, heave, yaw = (asked[0].surge, asked[0].heave, asked[0].yaw) if asked else (0.1, 0.0, 0.0)
        at = obeyed(at, surge, heave, yaw, 0.1)
        centre = centre + 0.1 * speed
        outside = np.maximum(np.abs(at.to_base(centre[None])[0]) - HALF, 0.0)
        least = min(least, float(np.linalg.norm(outside)) - 0.2)
    return least, at


@pytest.mark.parametrize(
    ("begin", "velocity"),
    [
        ((0.3, 2.2, 0.0), (0.0, -0.12, 0.0)),  # from abeam, where a vehicle without sway cannot back off to
        ((2.6, 0.0, 0.0), (-0.15, 0.0, 0.0)),  # head on
        ((-2.2, 0.3, 0.0), (0.15, 0.0, 0.0)),  # from astern, faster than it goes
    ],
)
def test_a_vehicle_without_sway_is_missed_by_what_comes(begin: tuple, velocity: tuple) -> None:
    """From every side it gets out of the way in time, though backing off along the line between them would not do."""
    least, _ = escaped(begin, velocity, open_water())
    assert least > 0.3


def test_an_escape_stays_in_water_that_was_seen_free() -> None:
    """With nothing known above, it does not rise into it; and it still is not hit."""
    volume = open_water()
    above = np.mod(np.arange(5, 5 + int(volume.shape[2]) // 2 - 5), volume.shape[2])
    volume.layers[0][:, :, above] = kernels.NEVER
    least, at = escaped((0.3, 2.6, 0.0), (0.0, -0.1, 0.0), volume)
    assert least > 0.2
    assert at.position[2] < 0.2


def test_what_passes_by_is_left_alone() -> None:
    """Nothing is done about something that moves away, or that will miss by a metre."""
    escape = Escape(EscapeSettings(), Vehicle())
    for centre, velocity in (((2.0, 0.0, 0.0), (0.15, 0.0, 0.0)), ((2.0, 2.0, 0.0), (-0.15, 0.0, 0.0))):
        mover = Mover(1, START, START, np.array(centre), np.array(velocity), 0.2, 3, 0.01)
        assert escape.propose(moment(pose(0), mover, open_water())) is None


def test_the_longer_it_was_not_seen_the_wider_a_berth_it_is_given() -> None:
    """What will pass at 0.75 m is left alone when it was seen just now; seen 15 s ago, its speed known to 2.5 cm/s, not."""
    speed, doubt = np.array([-0.1, 0.0, 0.0]), 0.025
    for seconds, escapes in ((0.0, False), (15.0, True)):
        centre = np.array([2.0, 1.4, 0.0]) - seconds * speed
        mover = Mover(1, START - round(seconds * 1e9), START, centre, speed, 0.2, 3, doubt)
        asked = Escape(EscapeSettings(), Vehicle()).propose(moment(pose(0), mover, open_water()))
        assert (asked is not None) is escapes


def under_way() -> Travel:
    """To a goal 3 m ahead, by someone who has looked."""
    travel = Travel(TravelSettings(goal=(3.0, 0.0, 0.0)), Vehicle())
    travel.looked = True
    return travel


def test_before_its_first_move_it_looks_for_two_passes() -> None:
    """One pass shows where things are, two that they were elsewhere: until the second has ended it stays. Passes that never
    end are not waited for."""
    seen = [replace(profile(wall(2.4), pose(0.0)), sweep=number) for number in range(4)]

    def waited(sweep_seconds: float) -> float:
        travel = Travel(TravelSettings(goal=(3.0, 0.0, 0.0)), Vehicle())
        for tick in range(200):
            at, number = pose(0.1 * tick), min(int(0.1 * tick / sweep_seconds), 3)
            known = replace(moment(at, None, open_water()), profiles=[seen[number]])
            if travel.propose(known).command.surge > 0.0:
                return 0.1 * tick
        return np.inf

    assert waited(2.5) == pytest.approx(5.0)
    assert 8.0 <= waited(1e9) < 9.0


def test_what_may_move_is_kept_in_view_and_waited_for() -> None:
    """A thing seen once at the edge of the view: the bow comes round to it, and the vehicle does not go on until it is
    known."""
    thing = Mover(1, START, START, np.array([1.6, 1.1, 0.0]), np.zeros(3), 0.2, 1, 0.15)
    travel = under_way()
    asked = travel.propose(moment(pose(0), None, open_water(), [thing]))
    assert asked.command.surge == 0.0 and asked.command.yaw > 0.0 and "does it move" in asked.reason
    later = travel.propose(moment(replace(pose(0), stamp_ns=START + 10**9), None, open_water()))
    assert later.command.surge > 0.1


def test_what_moves_nearer_and_was_not_seen_lately_is_looked_for() -> None:
    """Abeam and not seen for six seconds: the bow comes round to it. What was just seen or moves away is left alone."""
    at = replace(pose(0), stamp_ns=START + 6 * 10**9)

    def asked(seen_ns: int, velocity: tuple[float, float, float]) -> float:
        mover = Mover(1, seen_ns, START, np.array([0.3, 2.2, 0.0]), np.array(velocity), 0.2, 3, 0.01)
        proposal = under_way().propose(moment(at, mover, open_water()))
        return proposal.command.yaw if "looking for it" in proposal.reason else 0.0

    assert asked(START, (0.0, -0.1, 0.0)) > 0.1
    assert asked(at.stamp_ns, (0.0, -0.1, 0.0)) == 0.0
    assert asked(START, (0.0, 0.1, 0.0)) == 0.0


def test_safety_lets_by_what_leads_past_something_that_moves() -> None:
    """What is leaving sideways, though it is nearer than the clearance, is not fled from; the same thing at rest is."""
    filter_, corridor = SafetyFilter(Vehicle(), SafetySettings(), True, None), Corridor(3.0, 0.1, "nothing")
    wanted, place = Command(surge=0.02), np.array([1.15, 0.4, 0.0])
    leaving = Mover(1, START, START, place, np.array([0.0, 0.15, 0.0]), 0.2, 3, 0.01)
    standing = replace(leaving, velocity=np.zeros(3))
    assert filter_.filter(wanted, pose(0), NOTHING, corridor, [leaving], []).command == wanted
    assert filter_.filter(wanted, pose(0), NOTHING, corridor, [standing], []).command.surge < -0.02
