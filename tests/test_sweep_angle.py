"""The laser's angle from the encoder's counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import make_rig

from garbi_map.errors import GarbiError
from garbi_map.log.records import Encoder
from garbi_map.sweep import FixedAngle, LaserAngle, SweepSettings, laser_angle

START = 1_790_000_000_000_000_000
PERIOD = 8.0
COUNT = float(np.radians(0.01))


def motor(time, sharpness=0.9985):
    """A triangle of 40 degrees whose corners are round for 0.1 s; sharpness 1 makes them sharp."""
    return 0.32 + 0.35 * np.arcsin(sharpness * np.sin(2 * np.pi * time / PERIOD)) / np.arcsin(sharpness)


def read(time, angle):
    stamps = START + np.round(time * 1e9).astype(np.int64)
    return Encoder(stamps, stamps, angle)


def recorded(seconds=40.0, rate=100.0, step=COUNT, noise=0.0, sharpness=0.9985, seed=0):
    time = np.arange(0.0, seconds, 1.0 / rate)
    angle = motor(time, sharpness) + np.random.default_rng(seed).normal(0.0, noise, len(time))
    return read(time, np.round(angle / step) * step if step else angle)


def errors(angle: LaserAngle, sharpness=0.9985, seconds=40.0):
    """Error, sigma and time at random moments."""
    time = np.sort(np.random.default_rng(5).uniform(0.0, seconds - 0.02, 3000))
    alpha, sigma = angle.at(START + np.round(time * 1e9).astype(np.int64))
    return alpha - motor(time, sharpness), sigma, time


@pytest.mark.parametrize("step", [0.01, 0.05, 0.2])
def test_smoothing_takes_away_much_of_the_rounding(step):
    """The error is at most 0.6 of that of interpolated counts, whatever the encoder's resolution."""
    encoder = recorded(step=np.radians(step))
    error, sigma, time = errors(LaserAngle(encoder, SweepSettings()))
    raw = np.interp(time, (encoder.stamp_ns - START) * 1e-9, encoder.angle) - motor(time)
    assert np.sqrt(np.mean(error**2)) < 0.6 * np.sqrt(np.mean(raw**2))
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.3


def test_sigma_is_honest_where_readings_are_noisy():
    """Normalised errors have unit size when the noise is random."""
    error, sigma, _ = errors(LaserAngle(recorded(step=0.0, noise=2e-4), SweepSettings()))
    assert 0.8 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.25
    assert np.sqrt(np.mean(error**2)) < 1e-4


def test_smoothing_does_not_round_off_sharp_turns():
    """At a corner the error stays below what a reading's interval allows, and elsewhere it is small."""
    error, _, time = errors(LaserAngle(recorded(sharpness=1.0, noise=2e-5), SweepSettings()), sharpness=1.0)
    to_turn = np.abs((time - 2.0 + 2.0) % 4.0 - 2.0)
    assert np.abs(error[to_turn < 0.05]).max() < 0.175 * 0.02
    assert np.abs(error[to_turn > 0.05]).max() < 1.5e-4


def test_the_count_step_is_found():
    """From the readings, not from a specification."""
    for step in (COUNT, 2 * np.pi / 4096):
        assert LaserAngle(recorded(step=step), SweepSettings()).step == pytest.approx(step, rel=1e-6)
    assert LaserAngle(recorded(step=0.0, noise=1e-4), SweepSettings()).step == 0.0


def test_turning_points_are_the_motors():
    """Every 4 s from 2 s, to a few milliseconds, with noise of several counts."""
    angle = LaserAngle(recorded(noise=5e-4), SweepSettings())
    np.testing.assert_allclose((angle.turns_ns - START) * 1e-9, np.arange(2.0, 40.0, 4.0), atol=0.05)
    quiet = LaserAngle(recorded(), SweepSettings())
    np.testing.assert_allclose((quiet.turns_ns - START) * 1e-9, np.arange(2.0, 40.0, 4.0), atol=0.011)


def test_a_dwell_at_the_turn_is_one_turn_in_its_middle():
    """The motor waits a second at each end."""
    time = np.arange(0.0, 20.0, 0.01)
    angle = np.interp(time % 10.0, [0.0, 4.0, 5.0, 9.0, 10.0], [0.0, 0.7, 0.7, 0.0, 0.0])
    turns = (LaserAngle(read(time, np.round(angle, 4)), SweepSettings()).turns_ns - START) * 1e-9
    np.testing.assert_allclose(turns, [4.5, 9.5, 14.5], atol=0.02)


@given(jitter=st.floats(0.0, 2e-3), seed=st.integers(0, 100))
@settings(max_examples=30, deadline=None)
def test_a_motor_that_stands_has_no_turns(jitter, seed):
    """Constant, or jittering by a tenth of a degree."""
    time = np.arange(0.0, 10.0, 0.01)
    shaking = np.random.default_rng(seed).uniform(-jitter, jitter, len(time))
    assert len(LaserAngle(read(time, 0.3 + shaking), SweepSettings()).turns_ns) == 0


def test_gaps_are_not_bridged():
    """No angle inside a gap and beyond the record's ends; covers() agrees."""
    whole = recorded()
    time = (whole.stamp_ns - START) * 1e-9
    keep = (time < 10.0) | (time > 10.4)
    encoder = Encoder(whole.stamp_ns[keep], whole.arrival_ns[keep], whole.angle[keep])
    angle = LaserAngle(encoder, SweepSettings())
    asked = START + (np.array([-0.1, 9.9, 10.05, 10.2, 10.35, 10.5, 39.9, 40.2]) * 1e9).astype(np.int64)
    known = np.isfinite(angle.at(asked)[0])
    assert known.tolist() == [False, True, False, False, False, True, True, False]
    assert [angle.covers(int(stamp)) for stamp in asked] == known.tolist()


def test_readings_out_of_order_repeated_or_wild_do_no_harm():
    """Shuffled and doubled readings, a spike and a NaN leave the angle as it was."""
    encoder = recorded()
    order = np.random.default_rng(1).permutation(len(encoder.angle))
    angle = encoder.angle.copy()
    angle[[500, 1500]] = [3.0, -0.4]
    angle[777] = np.nan
    stamps = np.concatenate([encoder.stamp_ns[order], encoder.stamp_ns[:50]])
    messy = LaserAngle(Encoder(stamps, stamps, np.concatenate([angle[order], angle[:50]])), SweepSettings())
    error, _, _ = errors(messy)
    assert np.abs(error).max() < 2e-4
    assert len(messy.turns_ns) == 10


def test_an_angle_that_wraps_is_continuous():
    """Readings that jump by a full turn are one motion."""
    encoder = recorded()
    wrapped = Encoder(encoder.stamp_ns, encoder.arrival_ns, (encoder.angle - 0.3) % (2 * np.pi))
    assert len(LaserAngle(wrapped, SweepSettings()).turns_ns) == 10


@given(
    st.lists(st.tuples(st.integers(0, 10**10), st.floats(-100, 100) | st.just(float("nan"))), min_size=1, max_size=40),
    st.lists(st.integers(-(10**9), 11 * 10**9), min_size=1, max_size=20),
)
@settings(max_examples=150, deadline=None)
def test_any_readings_give_an_angle_with_sigma_or_none(readings, asked):
    """Whatever was recorded: refused in one line, or finite with a positive sigma, or NaN."""
    stamps = START + np.array([reading[0] for reading in readings])
    try:
        angle = LaserAngle(Encoder(stamps, stamps, np.array([reading[1] for reading in readings])), SweepSettings())
    except GarbiError:
        return
    alpha, sigma = angle.at(START + np.array(asked))
    known = np.isfinite(alpha)
    assert np.array_equal(known, np.isfinite(sigma))
    assert (sigma[known] > 0).all()
    assert np.all(np.diff(angle.turns_ns) >= 0)


def test_without_an_encoder_the_rig_must_say():
    """The fixed angle of the rig, or one clear line."""
    rig = make_rig()
    fixed = replace(rig, laser=replace(rig.laser, fixed_angle=0.4))
    angle = laser_angle(None, fixed, SweepSettings())
    assert isinstance(angle, FixedAngle)
    alpha, sigma = angle.at(np.array([START, START + 1]))
    assert alpha.tolist() == [0.4, 0.4]
    assert sigma.tolist() == [0.0, 0.0]
    assert angle.covers(START)
    with pytest.raises(GarbiError, match="fixed_angle"):
        laser_angle(None, rig, SweepSettings())
    with pytest.raises(GarbiError, match="3 usable readings"):
        laser_angle(read(np.arange(3) * 0.01, np.zeros(3)), rig, SweepSettings())
