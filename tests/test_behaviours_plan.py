"""Charts, the way through them, and rehearsed manoeuvres: against plain geometry and brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from behaviours.avoidance import Avoidance
from behaviours.drift import Drift
from behaviours.kernels_charts import distance
from behaviours.kernels_plan import HEADINGS, TURN, manoeuvring
from behaviours.plan import Planner
from behaviours.settings import AvoidanceSettings, TravelSettings, Vehicle
from behaviours.situation import Situation
from behaviours.space import Nearby, Space
from behaviours.types import Pose
from tests.behaviour_parts import pose, space

GOAL = np.array([2.6, 0.0, 0.0])


def known(free: bool = True, wall: float | None = None) -> Space:
    """A volume all free, or free only at its launch; with a wall across, 1.6 m wide, at x = `wall`."""
    volume = space()
    volume.be_at(pose(0))
    if free:
        volume.layers[0][:] = volume.milliseconds(pose(0).stamp_ns)
    if wall is not None:
        lower, upper = (
            np.floor(np.array([wall, -0.8, -1.5]) / volume.voxel),
            np.array([wall, 0.8, 1.5]) / volume.voxel,
        )
        index = np.stack(
            np.meshgrid(*[np.arange(a, max(b, a + 1)) for a, b in zip(lower, upper, strict=True)], indexing="ij"), -1
        ).reshape(-1, 3)
        place = tuple(np.mod(index.astype(np.int64), volume.shape).T)
        volume.layers[3][place] = 9
        volume.layers[1][place], volume.layers[7][place] = 10_000, 0
    return volume


def plan(volume: Space, at: Pose, current: tuple[float, float] = (0.0, 0.0)):
    got = Planner(Vehicle(), TravelSettings()).plan(volume, at, GOAL, np.array(current), [])
    assert got is not None
    return got


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.001, 0.3))
def test_distances_are_those_of_scipy(seed: int, share: float) -> None:
    """Exact, cell by cell."""
    there = np.random.default_rng(seed).uniform(size=(30, 41)) < share
    expected = distance_transform_edt(~there) if there.any() else np.full(there.shape, 90.0)
    assert distance(there, 90.0) == pytest.approx(np.minimum(expected, 90.0), abs=1e-4)


def test_in_known_water_it_goes_straight_on() -> None:
    """Full speed, no turn."""
    got = plan(known(), pose(0))
    assert got.surge == pytest.approx(TravelSettings().speed) and got.yaw == 0.0


def test_a_wall_is_gone_around() -> None:
    """The way keeps half a hull and more from it, and is not much longer than it has to be."""
    got = plan(known(wall=1.6), pose(0))
    crossing = got.path[np.abs(got.path[:, 0] - 1.6) < 0.15]
    assert (np.abs(crossing[:, 1]) > 0.8 + 0.45).all()
    length = np.linalg.norm(np.diff(got.path[:, :2], axis=0), axis=1).sum()
    shortest = np.hypot(1.6, 1.25) + np.hypot(1.0, 1.25)
    assert length < 1.6 * shortest


def test_a_goal_abeam_in_unseen_water_is_looked_at_before_it_is_gone_to() -> None:
    """The hull stays where water was seen free; the bow turns."""
    volume = known(free=False)
    got = Planner(Vehicle(), TravelSettings()).plan(volume, pose(0), np.array([0.3, 3.0, 0.0]), np.zeros(2), [])
    assert got is not None and got.yaw > 0.1


def test_a_current_abeam_is_reckoned_with() -> None:
    """Carried sideways at 0.1 m/s past a pillar that is just clear of its way, the vehicle does not go straight on."""
    volume = known()
    index = np.floor(np.array([[1.5, 0.95, z] for z in np.arange(-1.2, 1.2, 0.1)]) / volume.voxel).astype(np.int64)
    place = tuple(np.mod(index, volume.shape).T)
    volume.layers[3][place], volume.layers[1][place], volume.layers[7][place] = 9, 10_000, 0
    still = plan(volume, pose(0), (0.0, 0.0))
    carried = plan(volume, pose(0, velocity=(0.0, 0.1, 0.0)), (0.0, 0.1))
    assert carried.yaw < still.yaw + 1e-9 and (carried.yaw < 0.0 or carried.surge < still.surge)


def test_turning_is_part_of_the_way() -> None:
    """In open water a heading astern of the goal costs half a turn more; in the unseen a turn on the spot is dear."""
    begin = np.full((24, 24), np.inf)
    begin[20, 12] = 0.0
    far = np.full((48, 48), 9.0, np.float32)
    open_, dark = (
        manoeuvring(begin, 0.2, far, far, unseen, np.array([-0.43, 0.0, 0.43]), 0.5, 0.3, 1.5, 0.5)
        for unseen in (far, np.zeros_like(far))
    )
    assert open_.shape[2] == HEADINGS
    assert open_[12, 12, 0] == pytest.approx(8 * 0.2)
    assert open_[12, 12, 2] - open_[12, 12, 0] == pytest.approx(2 * TURN)
    assert open_[12, 12, 4] - open_[12, 12, 0] <= 4 * TURN + 1e-9
    assert dark[12, 12, 2] - dark[12, 12, 0] > 2 * TURN + 2.0


def test_the_current_is_learnt_from_how_the_vehicle_slides() -> None:
    """Two headings show both parts of it; waves of 5 cm/s do not hide it."""
    rng, drift, current = np.random.default_rng(3), Drift(0.8, 3.0), np.array([0.05, -0.08])
    for n in range(900):
        heading = 0.0 if n < 450 else 1.2
        across = np.array([-np.sin(heading), np.cos(heading)])
        sway = float(across @ current) + 0.05 * np.sin(0.16 * n) + rng.normal(0, 0.004)
        drift.see(pose(0.1 * n, heading=heading, velocity=(0.2, sway, 0.0)))
    assert drift.current == pytest.approx(current, abs=0.02)


def test_what_the_water_presses_against_is_left_rather_than_stopped_at() -> None:
    """A long wall close abeam, the current setting on to it: it goes on along the wall, or off it, at more than half its
    speed; avoidance, which could do nothing there, is silent."""
    volume = known()
    index = np.floor(
        np.array([[x, 0.65, z] for x in np.arange(-1.0, 0.9, 0.1) for z in np.arange(-1.2, 1.2, 0.1)]) / 0.1
    )
    place = tuple(np.mod(index.astype(np.int64), volume.shape).T)
    volume.layers[3][place], volume.layers[1][place], volume.layers[7][place] = 9, 10_000, 0
    at, current = pose(0, velocity=(0.0, 0.05, 0.0)), (0.0, 0.05)
    assert abs(plan(volume, at, current).surge) > 0.5 * TravelSettings().speed
    corridor = volume.corridor(at, 3.0, np.array(current))
    moment = Situation(at.stamp_ns, at, [], volume, volume.nearby(at, 1.3), corridor, [], [], np.array(current))
    asked = Avoidance(AvoidanceSettings(), Vehicle()).propose(moment)
    assert asked.activation < 0.5 or abs(asked.command.surge) > 0.05


def test_any_place_as_near_as_arrived_is_the_goal() -> None:
    """The way ends at its edge: what stands close behind the goal makes it no harder to reach."""
    arrived = TravelSettings().arrived
    free, behind = plan(known(), pose(0)), plan(known(wall=3.3), pose(0))
    for got in (free, behind):
        assert 0.1 < np.linalg.norm(got.path[-1] - GOAL) < arrived
        assert got.surge == pytest.approx(TravelSettings().speed)
    assert abs(free.heading) < 0.1 and not free.blind


def test_what_stands_abeam_and_above_does_not_stop_it() -> None:
    """The corner of a wall over which a current carries it: neither surge nor heave leads away, and standing still least."""
    volume, at = known(), pose(0)
    side = Nearby(np.array([0.1]), np.array([[0.0, 0.7, 0.7]]), np.array([[0.0, 0.45, 0.35]]), np.array([False]))
    moment = Situation(at.stamp_ns, at, [], volume, side, volume.corridor(at, 3.0, np.zeros(2)), [], [])
    assert Avoidance(AvoidanceSettings(), Vehicle()).propose(moment).activation == 0.0


def test_from_what_lies_above_it_sinks_and_goes_on() -> None:
    """Close under an overhang avoidance asks for heave alone; surge and yaw are left to travel."""
    volume, at = known(), pose(0)
    over = Nearby(np.array([0.1]), np.array([[0.0, 0.1, 0.99]]), np.array([[0.0, 0.45, 0.35]]), np.array([False]))
    moment = Situation(at.stamp_ns, at, [], volume, over, volume.corridor(at, 3.0, np.zeros(2)), [], [])
    asked = Avoidance(AvoidanceSettings(), Vehicle()).propose(moment)
    assert asked.activation > 0.9 and asked.axes == ("heave",) and asked.command.heave < -0.05


def test_a_plan_is_kept_to_where_two_are_as_good() -> None:
    """Before a wall that can be gone round on both sides alike, the side does not change with every plan."""
    planner, volume, sides = Planner(Vehicle(), TravelSettings()), known(wall=1.9), []
    for n in range(12):
        at = pose(0.5 * n, position=(0.0, 0.1 * (-1.0) ** n, 0.0), heading=0.02 * (-1.0) ** n)
        got = planner.plan(volume, at, GOAL, np.zeros(2), [])
        assert got is not None
        sides.append(np.sign(got.yaw))
    turned = [side for side in sides if side]
    assert sum(one != other for one, other in itertools.pairwise(turned)) <= 1
