"""Map building: what counts as seen, lanes that follow the view's width, wandering where there is most to see."""

from __future__ import annotations

import numpy as np
import pytest

from behaviours.coverage import Coverage
from behaviours.settings import SurveySettings
from behaviours.situation import Situation
from behaviours.space import Corridor, Nearby, Space
from behaviours.survey import Survey
from behaviours.types import Pose, Profile
from behaviours.wander import Wander
from tests.behaviour_parts import obeyed, pose, profile, space, wall

NOTHING = Nearby(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, bool))
AHEAD, HALF_WIDTH, GROUND = 0.25, 0.599, -1.2  # m


def below(at: Pose, ground: float = GROUND, half: float = HALF_WIDTH) -> Profile:
    """What a rig that looks down shows of level ground: a line across the way, AHEAD of base_link."""
    y = np.linspace(-half, half, 60)
    points = np.stack([np.full(60, AHEAD), y, np.zeros(60)], 1) @ at.rotation.T + at.position
    points[:, 2] = ground
    ones = np.ones(60)
    return Profile(
        at.stamp_ns, at.stamp_ns, 0.0, 0, np.arange(60, dtype=np.int32), ones, points, ones, np.ones(60, bool),
        np.zeros(60, np.int64), at,
    )  # fmt: skip


def situation(at: Pose, volume: Space, ground: float = GROUND) -> Situation:
    return Situation(at.stamp_ns, at, [below(at, ground)], volume, NOTHING, Corridor(2.0, 0.1, "nothing"), [], [])


def flown(behaviour: Survey | Wander, volume: Space, seconds: float) -> tuple[Pose, float, list[str]]:
    """A vehicle that obeys at once: where it ends, m flown, what was said."""
    at, path, said = pose(0.0), 0.0, []
    for _ in range(round(seconds * 5)):
        one = behaviour.propose(situation(at, volume))
        said.append(one.reason)
        after = obeyed(at, one.command.surge, one.command.heave, one.command.yaw, 0.2)
        path += float(np.linalg.norm(after.position - at.position))
        at = after
        if "done:" in one.reason or "cannot be reached" in one.reason:
            break
    return at, path, said


def test_cells_count_as_seen_where_points_fell() -> None:
    """A line of a metre and a fifth marks twelve cells, and what lies outside the area none."""
    coverage = Coverage(SurveySettings(), (-2.0, -2.0, 2.0, 2.0))
    coverage.see(below(pose(0.0)))
    assert (coverage.count > 0).sum() == 12
    assert coverage.share == pytest.approx(12 / 1600)
    assert coverage.unseen(np.array([[0.25, 0.05], [0.25, 1.0], [9.0, 0.0]])).tolist() == [False, True, False]


def test_the_view_is_as_wide_as_it_really_was() -> None:
    """Learnt from the profiles, whatever the altitude."""
    coverage = Coverage(SurveySettings(), (-2.0, -2.0, 2.0, 2.0))
    assert coverage.width is None
    for n in range(30):
        coverage.see(below(pose(0.1 * n), half=0.9))
    assert coverage.width == pytest.approx((-0.9, 0.9), abs=0.01)


def test_altitude_follows_the_ground() -> None:
    """Ground that rises is climbed over, ground that falls is followed; without any it stays."""
    for ground, sign in ((-0.8, 1), (-1.6, -1)):
        coverage = Coverage(SurveySettings(), (-2.0, -2.0, 2.0, 2.0))
        assert coverage.climb(pose(0.0), 1.2) == 0.0
        coverage.see(below(pose(0.0), ground))
        assert np.sign(coverage.climb(pose(0.0), 1.2)) == sign


def test_an_area_is_covered_with_little_more_way_than_its_lanes_need() -> None:
    """4 m x 4 m, a view of 1.2 m, a fifth of overlap: done, within 1.3 of four lanes, the steps and the way to the first."""
    survey = Survey(SurveySettings(area=(0.5, -2.0, 4.5, 2.0), speed=0.3, margin=0.0), AHEAD)
    _, path, said = flown(survey, space(), 400.0)
    assert said[-1].startswith("done: 98")
    assert survey.lanes == 4
    assert path < 1.3 * (4 * 4.0 + (4.0 - 1.2)) + 2.5


def test_a_hole_is_revisited() -> None:
    """Cells that nothing has shown when the lanes are done are gone back for."""
    survey = Survey(SurveySettings(area=(0.5, -0.5, 2.5, 0.5), speed=0.3, coverage=0.99), AHEAD)
    survey.coverage.count[:] = 1
    survey.coverage.count[8:14, 2:8] = 0
    survey._y = 9.0  # the lanes are done
    _, _, said = flown(survey, space(), 60.0)
    assert said[-1].startswith("done")


def test_wandering_shows_nearly_as_much_as_the_way_allows() -> None:
    """Per metre flown, at least two thirds of the view's width is new ground; and every decision says how much."""
    wander = Wander(SurveySettings(speed=0.3), AHEAD)
    _, path, said = flown(wander, space(), 40.0)
    seen = float((wander.coverage.count > 0).sum()) * 0.01
    assert path > 6.0
    assert seen > 2 / 3 * 2 * HALF_WIDTH * path
    assert all("new ground per metre" in one for one in said)


def test_wandering_goes_round_what_stands() -> None:
    """With a pillar right ahead the bearing that is chosen leads past it; without it, straight on."""
    volume, wander = space(), Wander(SurveySettings(), AHEAD)
    at = pose(0.0)
    for n in range(3):
        volume.see(profile(wall(1.4, width=0.3), pose(0.04 * n)))
    assert abs(wander.propose(situation(at, volume)).command.yaw) > 0.1
    assert Wander(SurveySettings(), AHEAD).propose(situation(at, space())).command.yaw == pytest.approx(0.0, abs=1e-6)
