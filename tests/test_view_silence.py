"""Gaps of sensors are found, whatever the windows in which a log is read."""

from __future__ import annotations

import numpy as np
import pytest

from garbi_map.log import Encoder, Navigation
from garbi_map.view.silence import Gap, Silence

SECOND = 1_000_000_000


def gaps_of(stamps: np.ndarray, window: int, end: int) -> list[tuple[int, str]]:
    """What is found when an encoder with these stamps is read window by window."""
    navigation = Navigation(encoder=Encoder(stamps, stamps, np.zeros(len(stamps))))
    silence = Silence()
    found: list[Gap] = []
    for begin in range(0, end, window):
        found += silence.gaps(navigation, begin, begin + window)
    return [(gap.begin_ns, gap.line) for gap in [*found, *silence.ends(end)]]


@pytest.mark.parametrize("window", [SECOND, 3 * SECOND, 20 * SECOND])
def test_a_gap_is_found_once_and_where_it_begins(window: int) -> None:
    """Two seconds without a reading of a 100 Hz encoder, across the borders of windows or not."""
    stamps = np.arange(1000) * 10_000_000
    stamps = stamps[(stamps < 4 * SECOND) | (stamps >= 6 * SECOND)]
    assert gaps_of(stamps, window, 10 * SECOND) == [(3_990_000_000, "encoder: nothing for 2.0 s")]


@pytest.mark.parametrize("window", [SECOND, 20 * SECOND])
def test_a_sensor_that_stops_is_named(window: int) -> None:
    """The encoder ends in the middle of the log."""
    stamps = np.arange(500) * 10_000_000
    (found,) = gaps_of(stamps, window, 10 * SECOND)
    assert found == (4_990_000_000, "encoder: nothing more, 5.0 s before the end")


def test_a_slow_sensor_is_not_silent() -> None:
    """Eight of its own periods are a gap, not a fixed time: a sensor at 2 Hz is steady."""
    assert gaps_of(np.arange(20) * (SECOND // 2), SECOND, 10 * SECOND) == []


def test_images_are_watched_too() -> None:
    """They are not in the navigation, so they are told one by one."""
    silence = Silence()
    for stamp in [*range(0, SECOND, 50_000_000), *range(2_950_000_000, 4 * SECOND, 50_000_000)]:
        silence.image(stamp)
    gap = Gap(950_000_000, 2_950_000_000, "images", "images: nothing for 2.0 s")
    assert list(silence.gaps(Navigation(), 0, 4 * SECOND)) == [gap]
    assert silence.images == 41
