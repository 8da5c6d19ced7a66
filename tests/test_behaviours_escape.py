"""What would surely hit is escaped even through water that nobody has seen; and nothing less is."""

from __future__ import annotations

import numpy as np
import pytest

from behaviours.feed import Seen
from behaviours.moving import Mover
from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings
from garbi_map.log.records import Floats
from tests.behaviour_parts import MOUNT, START, obeyed, pose, rig

HALF = np.array([0.65, 0.45, 0.35])
BALL, SPEED = 0.2, 0.15  # m, its radius; m/s


class Told:
    """In place of the tracks that the feed would show."""

    def __init__(self, mover: Mover) -> None:
        self.mover = mover

    def now(self) -> list[Mover]:
        """What moves."""
        return [self.mover]

    def undecided(self, now_ns: int) -> list[Mover]:
        """Nothing."""
        return []


def pocket(reach: float, wall_astern: bool = False) -> Pilot:
    """A pilot in water that is known only as far as that, m, about the hull; with or without a wall 0.25 m astern."""
    pilot = Pilot(
        BehaviourSettings.model_validate({"travel": None, "space": {"launch_clearance": reach}}), rig(), MOUNT
    )
    pilot.space.be_at(pose(0.0))
    if wall_astern:
        low, high = np.floor(np.array([[-1.1, -2.0, -1.5], [-0.9, 2.0, 1.5]]) / pilot.space.voxel).astype(int)
        place = np.ix_(*(np.mod(np.arange(a, b), n) for a, b, n in zip(low, high, pilot.space.shape, strict=True)))
        pilot.space.layers[3][place] = 9
        pilot.space.layers[1][place] = pilot.space.milliseconds(START)
    return pilot


def met(pilot: Pilot, seconds: float = 12.0) -> tuple[float, Floats, set[bool]]:
    """Least gap, m, between the hull and a ball that comes head on; the places (n, 3) of the vehicle; and whether it dared
    the unseen."""
    at, centre, velocity = pose(0.0), np.array([1.9, 0.0, 0.0]), np.array([-SPEED, 0.0, 0.0])
    least, places, dared = np.inf, [], set()
    for _ in range(round(seconds / 0.1)):
        pilot.movers = Told(Mover(1, at.stamp_ns, START, centre, velocity, BALL, 5, 0.01))  # type: ignore[assignment]
        decision = pilot.decide(Seen(at.stamp_ns, at, [], []))
        dared.add(any(one.dares for one in decision.proposals))
        command = decision.command
        at = obeyed(at, command.surge, command.heave, command.yaw, 0.1)
        centre = centre + 0.1 * velocity
        outside = np.maximum(np.abs(at.to_base(centre[None])[0]) - HALF, 0.0)
        least = min(least, float(np.linalg.norm(outside)) - BALL)
        places.append(at.position)
    return least, np.array(places), dared


def test_what_would_surely_hit_is_escaped_through_unseen_water() -> None:
    """Known water ends a few centimetres about the hull: it leaves it rather than be hit."""
    least, places, dared = met(pocket(0.1))
    assert True in dared
    assert least > 0.1
    assert np.linalg.norm(places[-1] - places[0]) > 0.3


def test_without_the_rule_it_would_be_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same, if the unseen is shunned at any price."""
    monkeypatch.setattr("behaviours.escape.HOPELESS", -9.0)
    least, _, dared = met(pocket(0.1))
    assert dared == {False} and least < 0.0


def test_where_known_water_leads_out_of_the_way_the_unseen_is_left_alone() -> None:
    """Metres of known water about the hull: no escape dares."""
    least, _, dared = met(pocket(2.0))
    assert dared == {False} and least > 0.2


def test_what_dares_the_unseen_does_not_dare_what_was_seen() -> None:
    """With a wall close astern it does not back off but rises, and goes on rising until what comes has passed below."""
    least, places, dared = met(pocket(0.1, wall_astern=True))
    assert True in dared and least > 0.1
    assert places[:, 0].min() - HALF[0] > -0.9 and places[-1, 2] > 0.6


def test_a_daring_escape_is_bounded_by_all_but_the_unseen() -> None:
    """Only the constraints of unseen water are gone; those of a thing that was hit, of what moves and of speed stay."""
    pilot = pocket(0.1, wall_astern=True)
    nearby = pilot.space.nearby(pose(0.0), 1.3)
    assert nearby.unknown.any() and not nearby.unknown.all()
    hit = nearby.hit()
    assert not hit.unknown.any() and len(hit.distance) == (~nearby.unknown).sum()
    assert hit.distance.min() == nearby.distance[~nearby.unknown].min()
