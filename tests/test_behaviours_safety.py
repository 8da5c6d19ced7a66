"""The barrier, the age limit and the unknown rule: each claim fails once its rule is broken."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from behaviours.kernels_qp import project
from behaviours.moving import Mover
from behaviours.safety import SafetyFilter
from behaviours.settings import Prior, SafetySettings, Vehicle
from behaviours.space import Corridor, Nearby
from behaviours.types import Command, Pose
from tests.behaviour_parts import START, obeyed, pose, space

OPEN = Corridor(3.0, 0.2, "nothing")
NOTHING = Nearby(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, bool))
AHEAD = np.array([1.0, 0.0, 0.0])


def safety(**changed: object) -> SafetyFilter:
    return SafetyFilter(Vehicle(), SafetySettings.model_validate(changed), True, None)


def near(distance: float, normal: np.ndarray = AHEAD, unknown: bool = False) -> Nearby:
    """One thing at a distance from the hull's face."""
    point = np.sign(normal) * np.array([0.65, 0.45, 0.35]) * (np.abs(normal) > 0.5)
    return Nearby(np.array([distance]), normal[None], point[None], np.array([unknown]))


def approach(filter_: SafetyFilter, unknown: bool = False) -> float:
    """Distance left when a vehicle that wants on at full speed has come to rest before a wall 2 m away."""
    at, wall = pose(0), 2.0
    for _ in range(400):
        gap = wall - float(at.position[0])
        got = filter_.filter(Command(0.3), at, near(gap, unknown=unknown), Corridor(3.0, 0.1, "nothing"), [], [])
        at = obeyed(at, got.command.surge, 0.0, 0.0, 0.1)
    return wall - float(at.position[0])


def test_the_barrier_stops_before_the_clearance() -> None:
    """A vehicle that wants on comes to rest at the clearance, not nearer."""
    assert approach(safety()) == pytest.approx(0.3, abs=0.03)


def test_without_the_barrier_it_would_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same approach with the limit taken away ends in the wall: the claim above is a claim about the barrier."""
    monkeypatch.setattr(SafetyFilter, "limit", lambda self, margin: 9.0)
    assert approach(safety(), unknown=True) < 0.0


def test_without_the_unknown_rule_it_would_enter_the_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unseen space taken for free: the vehicle goes in."""
    still = SafetyFilter._still
    monkeypatch.setattr(
        SafetyFilter,
        "_still",
        lambda self, wanted, at, nearby: still(self, wanted, at, NOTHING if nearby.unknown.any() else nearby),
    )
    assert approach(safety(), unknown=True) < 0.0


def blindfold(filter_: SafetyFilter) -> float:
    """m that a vehicle that wants on makes in a minute after its last look at the water ahead."""
    at = pose(0)
    for n in range(600):
        got = filter_.filter(Command(0.3), at, NOTHING, Corridor(3.0, 0.1 * n, "nothing"), [], [])
        at = obeyed(at, got.command.surge, 0.0, 0.0, 0.1)
    return float(at.position[0])


def test_a_view_that_ages_brings_it_to_rest() -> None:
    """Within the three metres that it saw."""
    assert blindfold(safety()) < 3.0 - 0.3


def test_without_the_age_limit_it_would_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same with every view taken for fresh."""
    limit = SafetyFilter.speed_limit
    monkeypatch.setattr(
        SafetyFilter,
        "speed_limit",
        lambda self, seen, troubles: limit(self, Corridor(seen.length, 0.0, seen.end), troubles),
    )
    assert blindfold(safety()) > 3.0


def test_unseen_space_at_the_hull_lets_it_turn_and_back_off() -> None:
    """Unseen water beside the bow's corner: past it, a slow turn, and astern as asked: never trapped."""
    corner = Nearby(np.array([0.0]), np.array([[0.7, 0.7, 0.0]]), np.array([[0.65, 0.45, 0.0]]), np.array([True]))
    ahead = safety().filter(Command(0.2), pose(0), corner, OPEN, [], []).command
    turning = safety().filter(Command(yaw=0.3), pose(0), corner, OPEN, [], []).command
    back = safety().filter(Command(-0.12, yaw=-0.2), pose(0), corner, OPEN, [], []).command
    assert ahead.surge == pytest.approx(0.2) and ahead.yaw == 0.0
    assert 0.05 < turning.yaw <= 0.3
    assert back.surge == pytest.approx(-0.12) and back.yaw == pytest.approx(-0.2)


def tunnel(ahead: float = 3.0, above: float = 0.4, height: float = -0.05) -> tuple[Pose, Nearby]:
    """A vehicle in a known way that is 1.8 m wide, ends `ahead` m before base_link, and above that much over its middle;
    its floor touches the unseen."""
    volume, at = space(launch_clearance=0.0), pose(0, (0.0, 0.0, height))
    volume.be_at(at)
    known = [
        np.arange(*np.round(np.array(ends) / volume.voxel).astype(int))
        for ends in ((-3, ahead), (-0.9, 0.9), (-0.4, above))
    ]
    volume.layers[0][np.ix_(*(np.mod(one, size) for one, size in zip(known, volume.shape, strict=True)))] = 0
    return at, volume.nearby(at, 1.3)


def test_the_unseen_close_above_and_below_does_not_shut_a_known_way() -> None:
    """Neither ahead nor astern; but up or down into it, or both ahead and up at once, it does not go."""
    at, around = tunnel()
    assert (around.unknown & (around.distance < 0.01)).any()
    for surge in (0.2, -0.12):
        got = safety().filter(Command(surge), at, around, OPEN, [], []).command
        assert got.surge == pytest.approx(surge) and abs(got.heave) < 1e-3
    down = safety().filter(Command(0.1, -0.1), at, around, OPEN, [], []).command
    assert down.heave > -1e-3


def test_a_known_way_ends_where_the_unseen_lies_before_the_bow() -> None:
    """However near the unseen beside, above and below is: it hides nothing that lies ahead."""
    for left in (0.0, 0.1, 0.3):
        at, around = tunnel(ahead=0.65 + 0.05 + left)
        got = safety().filter(Command(0.2), at, around, OPEN, [], []).command
        assert got.surge <= safety().limit(left + 0.05) + 1e-3


def test_it_rises_into_a_known_way_above_but_not_while_it_goes_under_the_unseen() -> None:
    """Where surge and heave together would lead the bow's edge into the unseen, the slower of the two gives way."""
    at, around = tunnel(above=0.8)
    assert safety().filter(Command(0.0, 0.1), at, around, OPEN, [], []).command.heave == pytest.approx(0.1)
    edge = Nearby(np.array([0.02]), np.array([[0.7, 0.0, 0.7]]), np.array([[0.65, 0.0, 0.35]]), np.array([True]))
    got = safety().filter(Command(0.2, 0.1), at, edge, OPEN, [], []).command
    assert got.surge == pytest.approx(0.2) and got.heave < 0.03
    got = safety().filter(Command(0.05, 0.1), at, edge, OPEN, [], []).command
    assert got.heave == pytest.approx(0.1) and got.surge < 0.03


def test_unseen_space_is_an_obstacle() -> None:
    """The vehicle does not enter what it has not seen."""
    assert approach(safety(), unknown=True) >= 0.0


@given(margin=st.floats(0.001, 3.0))
def test_the_speed_is_one_from_which_the_vehicle_stops(margin: float) -> None:
    """Reaction time and braking distance fit into the margin, whatever it is."""
    filter_, vehicle = safety(), Vehicle()
    speed = filter_.limit(margin)
    assert speed * vehicle.reaction + speed**2 / (2 * vehicle.brake) <= margin + 1e-9


@given(
    wanted=st.tuples(*[st.floats(-1, 1)] * 4),
    rows=st.lists(st.tuples(*[st.floats(-1, 1)] * 4, st.floats(0, 1)), max_size=12),
)
def test_the_projection_meets_every_constraint_and_changes_least(wanted: tuple, rows: list) -> None:
    """All rows hold; a command that already meets them is left alone; no other feasible command is nearer."""
    limits = np.array([0.3, 0.15, 0.35, 0.2])
    weight = np.array([1.0, 1.0, 0.35, 0.35])
    a, b = np.array([row[:4] for row in rows]).reshape(-1, 4), np.array([row[4] for row in rows])
    start = np.clip(np.array(wanted), -limits, limits)
    u, met = project(start, a, b, -limits, limits, weight)
    if not met:  # nearly parallel rows may need more rounds than there are; then the caller stops the vehicle
        return
    assert (a @ u <= b + 5e-3).all() and (np.abs(u) <= limits + 1e-12).all()
    if (a @ start <= b).all():
        assert u == pytest.approx(start, abs=1e-9)
    for share in (0.25, 0.5, 0.75):  # zero is always feasible here: the way there is, too
        other = share * u
        assert np.linalg.norm(weight * (u - start)) <= np.linalg.norm(weight * (other - start)) + 1e-2


def test_an_old_view_slows_and_then_stops() -> None:
    """The older the view ahead, the slower; too old, no speed at all; but astern is always allowed."""
    filter_ = safety()
    speeds = [filter_.speed_limit(Corridor(2.5, age, "nothing"), [])[0] for age in (0.1, 2.0, 4.0, 6.0, 7.5, 9.1)]
    assert all(slow <= fast + 1e-9 for fast, slow in itertools.pairwise(speeds))
    assert speeds[0] > 0.25 and speeds[-1] == 0.0
    assert speeds[4] <= 0.5 * SafetySettings().creep  # half way from fresh to stale even creeping is halved
    astern = filter_.filter(Command(-0.1), pose(0), NOTHING, Corridor(2.5, 60.0, "nothing"), [], []).command
    assert astern.surge == pytest.approx(-0.1)


def test_a_stale_view_is_named() -> None:
    """The reason says how old the view is."""
    got = safety().filter(Command(0.2), pose(0), NOTHING, Corridor(2.0, 12.0, "nothing"), [], [])
    assert got.command.surge == 0.0 and "12.0 s old" in got.changes[0]


def test_backing_off_is_never_forbidden() -> None:
    """With an obstacle touching the bow and old views everywhere, seen-free water astern may still be entered."""
    got = safety().filter(Command(-0.12), pose(0), near(0.0), Corridor(0.0, 100.0, "obstacle"), [], [])
    assert got.command.surge <= -0.11


def test_too_near_it_retreats_by_itself() -> None:
    """Inside the clearance the filter itself asks for the way out."""
    assert safety().filter(Command(), pose(0), near(0.1), OPEN, [], []).command.surge < -0.05


def test_what_comes_nearer_is_escaped() -> None:
    """A moving thing drives the vehicle astern before a still one at the same distance does."""
    mover = Mover(1, START, START, np.array([1.5, 0.0, 0.0]), np.array([-0.15, 0.0, 0.0]), 0.2, 3)
    still = Mover(1, START, START, np.array([1.5, 0.0, 0.0]), np.zeros(3), 0.2, 3)
    away = safety().filter(Command(0.1), pose(0), NOTHING, OPEN, [mover], []).command
    stays = safety().filter(Command(0.1), pose(0), NOTHING, OPEN, [still], []).command
    assert away.surge < 0.0 <= stays.surge


def test_nothing_asks_for_sway() -> None:
    """An obstacle abeam, with the water setting towards it, changes no axis that the vehicle lacks, nor surges into it."""
    side = near(0.2, np.array([0.0, 1.0, 0.0]))
    got = safety().filter(Command(0.1), pose(0, velocity=(0.0, 0.1, 0.0)), side, OPEN, [], []).command
    assert set(vars(got)) == {"surge", "heave", "yaw", "pitch"}


def test_a_rig_that_looks_down_needs_a_stated_prior() -> None:
    """Without it the vehicle does not go ahead and says so; with it, slowly."""
    blind = SafetyFilter(Vehicle(), SafetySettings(), False, None)
    got = blind.filter(Command(0.2), pose(0), NOTHING, OPEN, [], [])
    assert got.command.surge == 0.0 and "does not see ahead" in got.changes[0]
    told = SafetyFilter(Vehicle(), SafetySettings(), False, Prior(free_above=0.5, speed=0.07))
    assert told.filter(Command(0.2), pose(0), NOTHING, OPEN, [], []).command.surge == pytest.approx(0.07)


def test_silent_navigation_stops_the_vehicle() -> None:
    """Without knowing where it is it does not go on."""
    got = safety().filter(Command(0.2), pose(0), NOTHING, OPEN, [], ["navigation is silent"])
    assert got.command.surge == 0.0 and "navigation is silent" in got.changes[0]
