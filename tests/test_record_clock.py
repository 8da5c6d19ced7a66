"""Stamps: a device's clock and an even rate are found under the jitter; a clock that is set does no harm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from garbi_map.record.clock import DeviceClock, EvenClock, SteadyClock

START = 1_790_000_000_000_000_000
MS = 1_000_000


def test_stamps_go_on_when_the_systems_clock_is_set_back() -> None:
    """An hour back: told once, and the recorder's clock does not notice."""
    wall, steady = [START], [5_000]
    clock = SteadyClock(lambda: wall[0], lambda: steady[0])
    steady[0] += 1000 * MS
    wall[0] += 1000 * MS - 3600 * 1_000_000_000
    assert clock.now() == START + 1000 * MS
    assert clock.jump() == pytest.approx(-3600.0)
    assert clock.jump() is None


def test_slewing_is_no_jump() -> None:
    """NTP that corrects by 500 ppm."""
    wall, steady = [START], [0]
    clock = SteadyClock(lambda: wall[0], lambda: steady[0])
    for _ in range(20):
        steady[0] += 1000 * MS
        wall[0] += 1000 * MS + 500_000
        assert clock.jump() is None


@settings(max_examples=20, deadline=None)
@given(skew=st.floats(-2e-4, 2e-4), jitter=st.floats(1e-4, 8e-3), seed=st.integers(0, 99))
def test_a_devices_clock_is_found_under_jitter(skew: float, jitter: float, seed: int) -> None:
    """Offset and rate from arrivals alone: after a minute within a twentieth of the jitter, and never after the arrival."""
    clock, rng = DeviceClock(), np.random.default_rng(seed)
    truth = np.arange(0, 60, 0.02)
    device = np.round((truth * (1 + skew) + 77.0) * 1e9).astype(np.int64)
    arrival = START + np.round((truth + 0.002 + rng.exponential(jitter, len(truth))) * 1e9).astype(np.int64)
    stamps = np.array([clock.stamp(int(d), int(a)) for d, a in zip(device, arrival, strict=True)])
    off = (stamps - START) * 1e-9 - truth - 0.002
    assert np.all(stamps <= arrival)
    assert np.abs(off[-500:]).max() < 0.05 * jitter + 2e-5
    assert clock.resets == 0
    assert clock.skew == pytest.approx(-skew, abs=2e-5 + 1e-2 * jitter)


@pytest.mark.parametrize("step", [-1000.0, 1000.0, -0.5])
def test_a_device_that_starts_anew_is_found_again(step: float) -> None:
    """Its clock jumps; three seconds later the stamps are right again, and it is known that it happened."""
    clock = DeviceClock()
    truth = np.arange(0, 20, 0.05)
    off = []
    for moment in truth:
        device = moment + 2000.0 + (step if moment > 10 else 0.0)
        stamp = clock.stamp(round(device * 1e9), START + round(moment * 1e9))
        off.append((stamp - START) * 1e-9 - moment)
    assert np.abs(np.array(off)[(truth < 10) | (truth > 15)]).max() < 1e-6
    assert clock.resets == 1


def test_an_even_rate_shows_through_the_buckets_of_a_usb_adapter() -> None:
    """100 Hz handed over every 16 ms: stamps to a millisecond rather than five."""
    clock = EvenClock()
    truth = np.arange(0, 20, 0.01)
    arrival = np.ceil((truth + 0.001) / 0.016) * 0.016
    off = np.array([clock.stamp(START + round(a * 1e9)) - START for a in arrival]) * 1e-9 - truth
    assert clock.even
    assert off[500:].std() < 0.001 < 0.004 < (arrival - truth)[500:].std()


def test_readings_lost_on_the_way_are_noticed() -> None:
    """Three of 2000: the stamps stay right but for the moment after each."""
    clock = EvenClock()
    truth = np.delete(np.arange(0, 20, 0.01), [700, 1100, 1500])
    rng = np.random.default_rng(1)
    arrival = truth + 0.001 + rng.exponential(0.001, len(truth))
    off = np.array([clock.stamp(START + round(a * 1e9)) - START for a in arrival]) * 1e-9 - truth - 0.001
    assert clock.slips == 3
    assert np.mean(np.abs(off[200:]) < 0.002) > 0.9


def test_an_uneven_source_keeps_its_arrivals() -> None:
    """Pings whose rate wanders with the altitude: no model, no harm."""
    clock, rng = EvenClock(), np.random.default_rng(2)
    arrivals = START + np.cumsum(rng.choice([50, 400, 900], 300)) * MS
    assert [clock.stamp(int(arrival)) for arrival in arrivals] == arrivals.tolist()
    assert not clock.even
