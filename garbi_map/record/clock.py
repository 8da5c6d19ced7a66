"""The recorder's clock, and where the moments of measurement lie on it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

JUMP_NS = 50_000_000  # the system's clock is set, rather than slewed
WINDOW_NS = 300_000_000_000  # of arrivals that the model of a device's clock remembers
SPAN_NS = 10_000_000_000  # shorter than this, the two clocks are taken to run alike
EVERY_NS = 200_000_000  # between two looks at the rate
STEP_NS = 250_000_000  # a device's clock is off by more: it was set, or the device has started anew
PATIENCE_NS = 2_000_000_000  # for so long at least, before that is believed
SILENT_NS = 500_000_000  # longer, and a source is taken to have stopped
FIRST = 64  # arrivals from which the period of a source without a clock is found
RUN = 32  # readings, all of them late by a period, that say one was lost


class SteadyClock:
    """Nanoseconds since 1970 as the system's clock had it when recording began, and from then on by the steady one: stamps
    do not jump when the system's clock is set."""

    def __init__(self, wall: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns) -> None:
        self._wall, self._steady = wall, steady
        self._begin_ns = wall() - steady()
        self._known = 0

    def now(self) -> int:
        """ns."""
        return self._begin_ns + self._steady()

    def of_steady(self, steady_ns: int) -> int:
        """A moment of the system's monotonic clock, on this one."""
        return self._begin_ns + steady_ns

    def jump(self) -> float | None:
        """By how many seconds the system's clock was set since the last call; None where it was not."""
        off = self._wall() - self.now()
        by, moved = off - self._known, abs(off - self._known) > JUMP_NS
        if moved:
            self._known = off
        return by * 1e-9 if moved else None


class DeviceClock:
    """A device's clock on the recorder's, from the arrivals of what it stamped: an arrival is late, never early.

    The delays' lower convex hull over the last minutes is kept; its edge at their middle is the rate, and the line of
    that rate that touches the hull from below the offset (Moon, Skelly, Towsley: Estimation and removal of clock skew from
    network delay measurements, INFOCOM 1999). What remains unknown is the least delay: the caller subtracts what it knows.

    most_skew, span_ns: the rate is never off by more, and is not looked for in a shorter time
    resets     how often the device's clock was found to have been set
    """

    def __init__(self, most_skew: float = 5e-4, span_ns: int = SPAN_NS) -> None:
        self._most_skew, self._span_ns = most_skew, span_ns
        self.resets = 0
        self._begin()

    def _begin(self) -> None:
        self._hull: list[tuple[int, int]] = []  # device ns, arrival - device ns
        self._last = self._looked = -(1 << 62)
        self._floor, self._floor_since = 1 << 62, 0
        self.skew, self._at, self._offset = 0.0, 0, 0.0

    @property
    def offset_ns(self) -> int:
        """What to add to the newest of the device's stamps."""
        return round(self._line(self._last)) if self._hull else 0

    def stamp(self, device_ns: int, arrival_ns: int) -> int:
        """The moment on the recorder's clock, the least delay included; never after the arrival."""
        delay = arrival_ns - device_ns
        if self._hull and self._was_set(device_ns, delay):
            self.resets += 1
            self._begin()
        if not self._hull:
            self._at, self._offset, self._floor_since = device_ns, float(delay), device_ns
        if device_ns > self._last:
            self._add(device_ns, delay)
            self._last = device_ns
            if device_ns - self._looked > EVERY_NS:
                self._look()
        early = self._line(device_ns) - delay
        if early > 0:
            self._offset -= early
        return min(device_ns + round(self._line(device_ns)), arrival_ns)

    def _line(self, device_ns: int) -> float:
        return self._offset + self.skew * (device_ns - self._at)

    def _was_set(self, device_ns: int, delay: int) -> bool:
        """Back at once, or on: what arrives is suddenly too early, or all of it for long too late."""
        late = delay - self._line(device_ns)
        if self._last - device_ns > STEP_NS or late < -STEP_NS:
            return True
        self._floor = min(self._floor, round(late))
        if device_ns - self._floor_since < PATIENCE_NS:
            return False
        was_late, self._floor, self._floor_since = self._floor, 1 << 62, device_ns
        return was_late > STEP_NS

    def _add(self, x: int, y: int) -> None:
        hull = self._hull
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
        while hull[0][0] < x - WINDOW_NS and len(hull) > 2:
            del hull[0]

    def _look(self) -> None:
        """The rate and the offset anew."""
        hull, self._looked = self._hull, self._last
        span = hull[-1][0] - hull[0][0]
        if span > self._span_ns:
            middle = hull[0][0] + span // 2
            after = next(i for i, (x, _) in enumerate(hull) if x >= middle)
            (x0, y0), (x1, y1) = hull[after - 1], hull[after]
            self.skew = float(np.clip((y1 - y0) / (x1 - x0), -self._most_skew, self._most_skew))
        self._at = self._last
        self._offset = min(y - self.skew * (x - self._at) for x, y in hull)


class EvenClock:
    """Stamps for a source without a clock that measures at an even rate: the count of its readings is its clock.

    Until the rate is known, and while there is none, the arrival is the stamp. A reading lost on the way shows as one
    period by which everything is late; then the count goes on by one.

    slips   how many readings were found to have been lost
    """

    def __init__(self) -> None:
        self.slips = 0
        self._begin()

    def _begin(self) -> None:
        self._first: list[int] = []
        self._clock: DeviceClock | None = None
        self._count = 0
        self._least, self._seen = 1 << 62, 0
        self._last_arrival = 0
        self.period_ns = 0.0

    @property
    def even(self) -> bool:
        """Whether the rate is known and even."""
        return self._clock is not None

    def stamp(self, arrival_ns: int) -> int:
        """The moment of the measurement, or of its arrival."""
        gap, self._last_arrival = arrival_ns - self._last_arrival, arrival_ns
        if self._clock is None:
            self._learn(arrival_ns)
            return arrival_ns
        self._count += 1
        stamp = self._clock.stamp(round(self._count * self.period_ns), arrival_ns)
        if gap > max(8 * self.period_ns, SILENT_NS) or self._clock.resets:  # nobody knows how many are missing
            self._begin()
            return self.stamp(arrival_ns)
        self._least, self._seen = min(self._least, arrival_ns - stamp), self._seen + 1
        if self._seen >= RUN:
            lost = round(self._least / self.period_ns)
            self._count, self.slips = self._count + lost, self.slips + lost
            self._least, self._seen = 1 << 62, 0
        return stamp

    def _learn(self, arrival_ns: int) -> None:
        self._first.append(arrival_ns)
        if len(self._first) < FIRST:
            return
        arrivals, count = np.array(self._first, np.int64) - self._first[0], np.arange(FIRST)
        self._first = []
        period, begin = np.polyfit(count, arrivals, 1)
        if period > 0 and np.abs(arrivals - begin - period * count).max() < 2.5 * period:
            self.period_ns, self._clock = float(period), DeviceClock(most_skew=0.02, span_ns=1_000_000_000)
            for number, arrival in enumerate(arrivals.tolist()):
                self._clock.stamp(round(number * self.period_ns), arrival_ns - int(arrivals[-1]) + arrival)
            self._count = FIRST - 1
