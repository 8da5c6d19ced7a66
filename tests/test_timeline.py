"""What was recorded when: gaps are where they were made."""

from __future__ import annotations

import numpy as np

from garbi_map.timeline import lane


def states(name: str, seconds: np.ndarray, begin: float, end: float) -> list[tuple[str, float, float]]:
    """State, begin and end of each span, to the centisecond."""
    return [(s.state, round(s.begin_s, 2), round(s.end_s, 2)) for s in lane(name, seconds, begin, end)]


def test_a_gap_is_lost_and_the_rest_is_good() -> None:
    """In the middle, at the begin and at the end."""
    seconds = np.r_[np.arange(2.0, 5.0, 0.1), np.arange(7.0, 9.01, 0.1)]
    assert states("dvl", seconds, 0.0, 10.0) == [
        ("lost", 0.0, 2.0), ("good", 2.0, 4.9), ("lost", 4.9, 7.0), ("good", 7.0, 9.0), ("lost", 9.0, 10.0)
    ]  # fmt: skip


def test_a_steady_sensor_is_one_bar() -> None:
    """Whatever its rate, with the jitter that every log has."""
    rng = np.random.default_rng(0)
    for period in (0.01, 0.2, 2.0):
        seconds = np.arange(0, 60, period)
        seconds = np.sort(seconds + rng.uniform(-0.3, 0.3, len(seconds)) * period)
        assert {state for state, _, _ in states("s", seconds, 0.0, 60.0)} == {"good"}


def test_a_sensor_that_is_not_there_is_absent() -> None:
    """Throughout what was asked for, even if it spoke elsewhere."""
    assert states("fixes", np.empty(0), 3.0, 8.0) == [("absent", 3.0, 8.0)]
    assert states("fixes", np.array([1.0, 9.0]), 3.0, 8.0) == [("absent", 3.0, 8.0)]


def test_many_gaps_keep_the_largest() -> None:
    """A sensor that stutters for hours does not fill the report."""
    steps = np.tile([0.01] * 20 + [1.0], 500)
    steps[2120] = 50.0
    spans = lane("imu", np.cumsum(steps), 0.0, float(steps.sum()))
    lost = [span for span in spans if span.state == "lost"]
    assert len(lost) <= 100
    assert max(span.end_s - span.begin_s for span in lost) > 49
