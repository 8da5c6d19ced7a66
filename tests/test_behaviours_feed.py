"""The feed: what is late is late, nothing comes from the future, bad input is named and recovered from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from behaviours.angle import LiveAngle
from behaviours.feed import Intake, Sighting
from behaviours.navigation import LiveNavigation
from behaviours.settings import FeedSettings
from garbi_map.log.records import Encoder, Imu, Navigation
from garbi_map.stripe import Stripe
from tests.behaviour_parts import MOUNT, SECOND, START, rig, wall_stripe

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def intake() -> Intake:
    return Intake(rig(), {"rig": MOUNT}, FeedSettings())


def still(begin: float, end: float, late: float = 0.01) -> Navigation:
    """An IMU at rest."""
    stamps = START + np.arange(round(begin * 100), round(end * 100), dtype=np.int64) * (SECOND // 100)
    n = len(stamps)
    force = np.tile([0.0, 0.0, 9.80665], (n, 1))
    return Navigation(
        imu=Imu(
            stamps,
            stamps + round(late * SECOND),
            np.zeros((n, 3)),
            force,
            np.tile(UPRIGHT, (n, 1)),
            np.zeros((n, 3, 3)),
        )
    )


def sighting(seconds: float, stripe: Stripe | None = None, late: float = 0.05, stuck: bool = False) -> Sighting:
    stripe = stripe if stripe is not None else wall_stripe(0.2, 1.5, seconds)
    return Sighting(stripe, stripe.stamp_ns + round(late * SECOND), 0.2, 0, stuck)


def at(seconds: float) -> int:
    return START + round(seconds * SECOND)


def test_a_profile_is_not_known_before_it_has_arrived() -> None:
    """Fifty milliseconds late is fifty milliseconds late."""
    feed = intake()
    feed.read(still(0, 1))
    feed.sight(sighting(0.5))
    assert feed.until(at(0.549)).profiles == []
    assert len(feed.until(at(0.551)).profiles) == 1


def test_a_profile_is_where_the_wall_is() -> None:
    """Triangulated, turned and put into odom: 1.5 m before the rig, to 5 mm."""
    feed = intake()
    feed.read(still(0, 1))
    feed.sight(sighting(0.5))
    points = feed.until(at(0.6)).profiles[0].points
    assert len(points) > 200
    assert np.abs(points[:, 0] - 1.95).max() < 0.005


@settings(max_examples=10, deadline=None)
@given(delays=st.lists(st.floats(0, 1), min_size=5, max_size=20), cut=st.floats(0.2, 1.5))
def test_the_future_changes_nothing(delays: list[float], cut: float) -> None:
    """What is known at a moment is the same whether or not later arrivals are already in the recorder's file."""
    whole, so_far = intake(), intake()
    for feed in (whole, so_far):
        for n, delay in enumerate(delays):
            one = sighting(0.05 * n, late=delay)
            if feed is whole or one.known_ns <= at(cut):
                feed.sight(one)
    a, b = whole.until(at(cut)), so_far.until(at(cut))
    assert [one.stamp_ns for one in a.profiles] == [one.stamp_ns for one in b.profiles]
    assert all(one.known_ns <= at(cut) for one in a.profiles)
    assert a.troubles == b.troubles


def test_a_frozen_image_is_named_and_not_used() -> None:
    """The same frame under new stamps tells nothing; the next new one does."""
    feed = intake()
    feed.read(still(0, 2))
    frame = wall_stripe(0.2, 1.5, 0.5)
    for n in range(5):
        again = Stripe(at(0.5 + 0.04 * n), frame.row, frame.u, frame.sigma, frame.intensity, frame.saturated)
        feed.sight(sighting(0.0, again))
    seen = feed.until(at(1.0))
    assert len(seen.profiles) == 1 and seen.troubles == ["the image is frozen"]
    feed.sight(sighting(1.0))
    assert len(feed.until(at(1.2)).profiles) == 1


def test_stamps_that_go_back_are_named_and_a_set_clock_is_accepted() -> None:
    """Stragglers are left out; after a second in the past the past is the present."""
    feed = intake()
    feed.sight(sighting(10.0, late=0.05))
    assert len(feed.until(at(10.1)).profiles) == 1
    late = [Sighting(wall_stripe(0.2, 1.5, 2.0 + 0.1 * n), at(10.2 + 0.1 * n), 0.2, 0, False) for n in range(20)]
    for one in late:
        feed.sight(one)
    first = feed.until(at(10.5))
    assert first.profiles == [] and first.troubles == ["image stamps go back"]
    assert feed.until(at(13.0)).profiles


def test_a_stuck_encoder_is_named_and_its_profiles_are_not_used() -> None:
    """An angle that no longer changes places points wrongly; once it moves again they count again."""
    angle = LiveAngle(None, 0.05, 0.5)
    for n in range(100):
        angle.add(at(0.01 * n), 0.1 + 0.002 * n if n < 20 else 0.14)
    assert not angle.stuck(at(0.3)) and angle.stuck(at(0.95))
    angle.add(at(1.0), 0.15)
    assert not angle.stuck(at(1.01))
    feed = intake()
    feed.read(still(0, 1))
    feed.sight(sighting(0.5, stuck=True))
    seen = feed.until(at(0.9))
    assert seen.profiles == [] and seen.troubles == ["the encoder is stuck"]


def test_silent_navigation_is_named() -> None:
    """More than a second without a reading is said."""
    feed = intake()
    feed.read(still(0, 1))
    assert feed.until(at(1.5)).troubles == []
    assert feed.until(at(2.5)).troubles == ["navigation is silent"]


def test_the_angle_is_never_taken_from_a_later_reading_and_turns_are_counted() -> None:
    """Between readings linear, a little beyond them carried on, farther out unknown; each turn begins a pass."""
    angle = LiveAngle(None, 0.05, 0.5)
    for n in range(60):
        angle.add(at(0.01 * n), 0.3 - abs(0.3 - 0.01 * n))
    assert angle.at(at(0.105)) == pytest.approx(0.105)
    assert angle.at(at(0.60)) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(angle.at(at(0.8)))
    assert angle.sweep == 1
    angle.add(at(0.6), float("nan"))
    assert np.isfinite(angle.at(at(0.595)))


def test_readings_that_are_no_numbers_do_not_poison_navigation() -> None:
    """NaN in any reading leaves the pose finite."""
    navigation = LiveNavigation({})
    nothing = np.full(3, np.nan)
    for n in range(50):
        navigation.imu(at(0.01 * n), nothing if n % 3 else np.zeros(3), nothing, np.full(4, np.nan))
        navigation.dvl(at(0.01 * n), nothing if n % 2 else np.array([0.1, 0.0, 0.0]))
        navigation.pressure(at(0.01 * n), float("nan"))
    now = navigation.now(at(0.6))
    assert np.isfinite(now.position).all() and np.isfinite(now.rotation).all()
    assert now.velocity[0] == pytest.approx(0.1, abs=0.02)


def test_readings_of_an_encoder_come_in_the_order_of_arrival() -> None:
    """Whatever their order in the file."""
    feed = intake()
    stamps = START + np.arange(20, dtype=np.int64) * (SECOND // 100)
    order = np.random.default_rng(1).permutation(20)
    feed.read(Navigation(encoder=Encoder(stamps[order], stamps[order] + 1000, 0.01 * order.astype(float))))
    feed.until(at(1.0))
    assert feed.angle.at(at(0.105)) == pytest.approx(0.105)
