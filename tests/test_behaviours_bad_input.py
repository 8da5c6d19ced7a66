"""Bad input on a feed: the vehicle slows, stops or holds, says why, and recovers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from behaviours.decisions import Decision
from behaviours.feed import Intake, Sighting
from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, FeedSettings, HoldSettings
from garbi_map.log.records import Imu, Navigation
from garbi_map.stripe import Stripe
from tests.behaviour_parts import MOUNT, SECOND, START, rig, wall_stripe

FROM, TO, END = 8.0, 22.0, 30.0  # s: good, spoilt, good again
RATE = 5  # decisions and images per second
Spoil = Callable[[Sighting, list[Sighting]], Sighting]


def empty(one: Sighting, before: list[Sighting]) -> Sighting:
    """Water so murky that nothing returns, or a laser that is off."""
    stripe, none = one.stripe, slice(0)
    return replace(
        one,
        stripe=Stripe(
            stripe.stamp_ns, stripe.row[none], stripe.u[none], stripe.sigma[none], stripe.intensity[none],
            stripe.saturated[none],
        ),
    )  # fmt: skip


def not_a_number(one: Sighting, before: list[Sighting]) -> Sighting:
    """Columns that are no numbers, and so points that are none."""
    return replace(one, stripe=replace(one.stripe, u=np.full_like(one.stripe.u, np.nan)))


def frozen(one: Sighting, before: list[Sighting]) -> Sighting:
    """The same frame again under a new stamp."""
    return replace(one, stripe=replace(before[-1].stripe, stamp_ns=one.stripe.stamp_ns))


def stuck(one: Sighting, before: list[Sighting]) -> Sighting:
    """The encoder repeats its last reading."""
    return replace(one, alpha=before[-1].alpha, stuck=True)


def back(one: Sighting, before: list[Sighting]) -> Sighting:
    """The camera's clock is half a minute slow."""
    return replace(one, stripe=replace(one.stripe, stamp_ns=one.stripe.stamp_ns - 30 * SECOND))


FAULTS: dict[str, tuple[Spoil, str]] = {
    "empty": (empty, "nothing has returned lately"),
    "not a number": (not_a_number, "no point of the profile is usable"),
    "frozen": (frozen, "the image is frozen"),
    "stuck": (stuck, "the encoder is stuck"),
    "back": (back, "image stamps go back"),
}


@cache
def flown(fault: str, hold: bool) -> list[Decision]:
    """Decisions before a wall 2.6 m ahead, 1.5 m for the holding behaviour, with that fault between FROM and TO."""
    held = HoldSettings(range=1.4) if hold else None
    given = BehaviourSettings(hold=held) if hold else BehaviourSettings()
    intake = Intake(rig(), {"rig": MOUNT}, FeedSettings())
    pilot = Pilot(given, intake.rig, intake.mount)
    stamps = START + np.arange(round(END * 50) + 50, dtype=np.int64) * (SECOND // 50)
    n = len(stamps)
    intake.read(Navigation(imu=Imu(
        stamps, stamps + SECOND // 100, np.zeros((n, 3)), np.tile([0.0, 0.0, 9.80665], (n, 1)),
        np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 3, 3)),
    )))  # fmt: skip
    before: list[Sighting] = []
    decisions = []
    for step in range(round(END * RATE)):
        second = step / RATE
        alpha = 0.13 + 0.52 * float(np.sin(1.5 * second))
        stripe = wall_stripe(alpha, 1.5 if hold else 2.6, second)
        one = Sighting(stripe, stripe.stamp_ns + SECOND // 20, alpha, int(1.5 * second // np.pi), False)
        if FROM <= second < TO:
            one = FAULTS[fault][0](one, before)
        else:
            before = [one]
        intake.sight(one)
        decisions.append(pilot.decide(intake.until(START + round((second + 0.06) * SECOND))))
    return decisions


def between(decisions: list[Decision], begin: float, end: float) -> list[Decision]:
    return decisions[round(begin * RATE) : round(end * RATE)]


@pytest.mark.parametrize("fault", FAULTS)
def test_the_vehicle_stops_says_why_and_goes_on(fault: str) -> None:
    """Going before the fault; at a stand at its end, with the reason; going again within 6 s of its end."""
    decisions = flown(fault, False)
    assert max(one.command.surge for one in between(decisions, FROM - 2, FROM)) > 0.05
    assert max(abs(one.command.surge) for one in between(decisions, TO - 0.8, TO)) == 0.0
    assert any(FAULTS[fault][1] in one.text() for one in between(decisions, FROM, TO))
    assert all("the view ahead" in one.text() for one in between(decisions, TO - 0.8, TO))
    assert max(one.command.surge for one in between(decisions, TO + 1, TO + 6)) > 0.05


@pytest.mark.parametrize("fault", FAULTS)
def test_station_is_kept_by_depth_and_heading_and_the_target_is_found_again(fault: str) -> None:
    """Held before; lost during, without a motion of the vehicle and with a word; held again."""
    decisions = flown(fault, True)
    hold = [one.proposal("hold") for one in decisions]
    assert hold[round(FROM * RATE) - 1].facts["target"] == 1.0  # type: ignore[union-attr]
    lost = between(decisions, TO - 3, TO)
    assert all("target lost" in one.text() and "holding depth and heading" in one.text() for one in lost)
    assert all(one.command.surge == 0.0 and abs(one.command.heave) < 1e-9 for one in lost)
    assert hold[-1].facts["target"] == 1.0  # type: ignore[union-attr]
