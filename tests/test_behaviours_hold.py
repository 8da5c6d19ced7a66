"""Station keeping by the rules that others learnt the hard way: lost, re-found, out of range, glitch, re-arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from behaviours.fit import fit_cylinder, fit_plane
from behaviours.settings import HoldSettings
from behaviours.situation import Situation
from behaviours.space import Corridor, Nearby
from behaviours.stabilisation import Stabilisation
from behaviours.types import Pose, Profile, Proposal
from tests.behaviour_parts import MOUNT, SECOND, pose, profile, space

NOTHING = Nearby(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, bool))
VOLUME = space()


def situation(at: Pose, profiles: list[Profile], troubles: list[str] | None = None) -> Situation:
    return Situation(at.stamp_ns, at, profiles, VOLUME, NOTHING, Corridor(2.0, 0.1, "obstacle"), [], troubles or [])


def hold(
    behaviour: Stabilisation, begin: float, seconds: float, distance: float | None, **where: object
) -> list[Proposal]:
    """Ten decisions a second before a wall `distance` m from the rig; None: nothing returns."""
    got = []
    for n in range(round(10 * seconds)):
        at = pose(begin + 0.1 * n, **where)  # type: ignore[arg-type]
        shown = []
        if distance is not None:
            shown = [profile(line(distance, n) + np.array([0.0, 0.0, at.position[2]]), at)]
        got.append(behaviour.propose(situation(at, shown)))
    return got


def line(distance: float, n: int) -> np.ndarray:
    """What the sheet lights of a wall at its n-th place."""
    z = np.arange(-0.6, 0.6, 0.008)
    return np.stack([np.full(len(z), distance + 0.45), np.full(len(z), 0.5 * np.sin(0.7 * n)), z], 1)


def armed() -> Stabilisation:
    return Stabilisation(HoldSettings(), MOUNT.translation)


def test_it_goes_to_the_wanted_range() -> None:
    """Too far: ahead; too near: astern; there: still."""
    for distance, sign in ((1.9, 1), (1.1, -1), (1.5, 0)):
        last = hold(armed(), 0, 4, distance)[-1]
        assert last.facts["target"] == 1.0
        assert np.sign(round(last.command.surge, 2)) == sign


def test_yaw_and_pitch_face_the_wall() -> None:
    """With the bow 10 degrees to port of the wall's normal it turns to starboard, by as much as it is off."""
    last = hold(armed(), 0, 4, 1.5, heading=np.radians(10))[-1]
    assert last.facts["yaw_error"] == pytest.approx(-np.radians(10), abs=np.radians(1))
    assert last.command.yaw < 0
    last = hold(armed(), 0, 4, 1.5, tilt=np.radians(5))[-1]
    assert last.facts["pitch_error"] == pytest.approx(-np.radians(5), abs=np.radians(1))


def test_out_of_range_is_not_infinite_altitude() -> None:
    """Beyond the farthest range, or with no return at all, it neither climbs nor dives nor goes ahead, and says so."""
    for distance, words in ((3.4, "out of range"), (None, "no target")):
        for got in hold(armed(), 0, 6, distance):
            assert got.command.surge == 0.0 and abs(got.command.heave) < 1e-9
        assert words in got.reason and "holding depth and heading" in got.reason


def test_a_glitch_neither_moves_it_nor_sets_the_target() -> None:
    """One second of a thing half a metre before the wall changes neither the motion nor what is held afterwards."""
    behaviour = armed()
    hold(behaviour, 0, 6, 1.5)
    glitch = hold(behaviour, 6, 1, 0.9)
    assert all(got.command.surge == 0.0 and abs(got.command.heave) < 1e-9 for got in glitch[1:])
    assert "glitch" in glitch[-1].reason
    assert behaviour.wanted == 1.5
    after = hold(behaviour, 7, 2, 1.5)[-1]
    assert after.facts["target"] == 1.0 and abs(after.command.surge) < 0.03


def test_a_new_range_that_lasts_is_believed() -> None:
    """What began as a glitch and stays is the target."""
    behaviour = armed()
    hold(behaviour, 0, 6, 1.5)
    last = hold(behaviour, 6, 10, 1.0)[-1]
    assert last.facts["target"] == 1.0 and last.command.surge < 0.0


def test_a_lost_target_is_said_and_found_again() -> None:
    """Lost: depth and heading are held. Found: it waits until that lasts, then holds again."""
    behaviour = armed()
    hold(behaviour, 0, 5, 1.5)
    lost = hold(behaviour, 5, 12, None)
    assert "lost" in lost[-1].reason and lost[-1].command.surge == 0.0
    found = hold(behaviour, 17, 5, 1.7)
    assert found[0].facts["target"] == 0.0
    assert found[-1].facts["target"] == 1.0


def rearmed(behaviour: Stabilisation) -> list[Proposal]:
    """Armed at 0 m heading east, then not asked while the vehicle went 0.6 m up and turned: the first second afterwards."""
    hold(behaviour, 0, 3, 1.5)
    return hold(behaviour, 10, 1, None, position=(0.0, 0.0, 0.6), heading=0.3)


def test_rearming_neither_dives_nor_turns_back() -> None:
    """Armed again it stays where it is."""
    assert all(abs(got.command.heave) < 1e-9 and abs(got.command.yaw) < 1e-9 for got in rearmed(armed()))


def test_without_the_rearm_rule_it_would(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same, armed but once: the claim above is a claim about the rule."""
    once, rearm = set(), Stabilisation.rearm
    monkeypatch.setattr(
        Stabilisation, "rearm", lambda self, at: None if id(self) in once else (once.add(id(self)), rearm(self, at))
    )
    last = rearmed(armed())[-1]
    assert last.command.heave < -0.05 and last.command.yaw < -0.02


def test_a_pressure_glitch_does_not_heave() -> None:
    """One pose a metre off among good ones moves nothing."""
    behaviour = armed()
    hold(behaviour, 0, 3, 1.5)
    at = pose(3.0, (0.0, 0.0, 0.6))
    assert abs(behaviour.propose(situation(at, [])).command.heave) < 1e-9


def test_drift_abeam_is_reported_not_fought() -> None:
    """A vehicle without sway that is carried sideways says so."""
    last = hold(armed(), 0, 4, 1.5, velocity=(0.0, 0.08, 0.0))[-1]
    assert "drifting to port" in last.reason


def test_points_that_are_no_numbers_change_nothing() -> None:
    """NaN among the points of a profile is left out."""
    behaviour = armed()
    for n in range(40):
        at = pose(0.1 * n)
        one = profile(line(1.5, n), at)
        points = one.points.copy()
        points[::3] = np.nan
        last = behaviour.propose(situation(at, [replace(one, points=points)]))
    assert last.facts["range"] == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_a_plane_is_found_among_outliers(outliers: float) -> None:
    """Normal to half a degree with a third of the points anywhere."""
    rng = np.random.default_rng(3)
    points = np.c_[rng.normal(1.5, 0.01, 600), rng.uniform(-0.5, 0.5, (600, 2))]
    points[: int(600 * outliers)] += rng.uniform(-0.6, 0.6, (int(600 * outliers), 3))
    turn = Rotation.from_euler("zy", [0.3, 0.2])
    found = fit_plane(turn.apply(points), 0.02)
    assert found is not None
    true = turn.apply([1.0, 0.0, 0.0])
    assert abs(found.normal @ true) > np.cos(np.radians(0.5))
    assert abs((turn.apply([1.5, 0.0, 0.0]) - found.point) @ true) < 0.005


def test_a_pipe_is_found_from_the_side_that_it_shows() -> None:
    """Axis to a degree and a half, radius and distance to a centimetre, from less than half of its skin."""
    rng = np.random.default_rng(4)
    angle, along = rng.uniform(-1.1, 1.1, 900), rng.uniform(-0.7, 0.7, 900)
    radius = 0.15 + rng.normal(0, 0.004, 900)
    points = np.c_[1.9 - radius * np.cos(angle), along, radius * np.sin(angle)]
    found = fit_cylinder(points, np.zeros(3), 0.01)
    assert found is not None
    assert abs(found.axis[1]) > np.cos(np.radians(1.5))
    assert found.radius == pytest.approx(0.15, abs=0.01)
    nearest = found.point - (found.point @ found.axis) * found.axis
    assert np.linalg.norm(nearest) == pytest.approx(1.9, abs=0.01)


def test_half_a_second_without_decisions_is_no_rearm() -> None:
    """Only a real pause begins anew."""
    behaviour = armed()
    hold(behaviour, 0, 3, 1.5)
    kept = behaviour.depth
    behaviour.propose(situation(pose(3.5, (0.0, 0.0, 0.3)), []))
    assert behaviour.depth == kept and SECOND == 10**9


def test_the_object_that_is_chosen_is_held_and_else_the_nearest() -> None:
    """A post stands half a metre before a wall: without a word the post's face is held, with it the wall."""
    for chosen, expected in ((None, 1.2), ((1.95, 0.0, 0.0), 1.5)):
        behaviour = Stabilisation(HoldSettings(at=chosen, jump=0.5, least_spread=0.05), MOUNT.translation)
        for n in range(50):
            at, y = pose(0.1 * n), 0.5 * np.sin(0.7 * n)
            shown = line(1.2 if abs(y) < 0.25 else 1.5, n)
            got = behaviour.propose(situation(at, [profile(shown, at)]))
        assert got.facts["range"] == pytest.approx(expected, abs=0.03)
