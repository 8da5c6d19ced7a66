"""When a sensor that speaks at a steady rate says nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from garbi_map.log import Navigation
from garbi_map.log.records import Stamps

_GAP = 8.0
"""A sensor is silent when this many of its usual periods pass without a message."""
_LEAST_GAP = 0.5
"""Seconds; shorter silences are not worth a word."""


class Gap(NamedTuple):
    """When a sensor was silent, which it was, and that in one line."""

    begin_ns: int
    end_ns: int
    sensor: str
    line: str


class Silence:
    """Finds the gaps of images, encoder, IMU, pressure and DVL in a log that is read window by window.

    images   how many there were so far;  found   gaps so far
    """

    def __init__(self) -> None:
        self.images = 0
        self.found = 0
        self._new: list[int] = []
        self._last: dict[str, int] = {}
        self._period: dict[str, float] = {}

    def image(self, stamp_ns: int) -> None:
        """Take note of an image of the window."""
        self._new.append(stamp_ns)
        self.images += 1

    def gaps(self, navigation: Navigation, begin_ns: int, end_ns: int) -> Iterator[Gap]:
        """Each gap that ended in the window."""
        heard = {"images": np.array(self._new, np.int64)}
        self._new.clear()
        for name in ("encoder", "imu", "pressure", "dvl"):
            record = getattr(navigation, name)
            if record is not None:
                heard[name] = record.stamp_ns[within(record.stamp_ns, begin_ns, end_ns)]
        for name, own in heard.items():
            if len(own) == 0:
                continue
            whole = np.concatenate([[self._last.get(name, own[0])], own])
            steps = np.diff(whole) * 1e-9
            if len(own) > 1:
                self._period[name] = min(self._period.get(name, np.inf), float(np.median(steps[1:])))
            self._last[name] = int(own[-1])
            for k in np.flatnonzero(steps > self._longest(name)):
                self.found += 1
                yield Gap(int(whole[k]), int(whole[k + 1]), name, f"{name}: nothing for {steps[k]:.1f} s")

    def ends(self, end_ns: int) -> Iterator[Gap]:
        """Each sensor that stopped before the log did."""
        for name, last in self._last.items():
            if (end_ns - last) * 1e-9 > self._longest(name):
                self.found += 1
                line = f"{name}: nothing more, {(end_ns - last) * 1e-9:.1f} s before the end"
                yield Gap(last, end_ns, name, line)

    def _longest(self, name: str) -> float:
        return max(_LEAST_GAP, _GAP * self._period.get(name, np.inf))


def within(stamps: Stamps, begin_ns: int, end_ns: int) -> slice:
    """The rows of ascending stamps from begin_ns to before end_ns."""
    first, last = np.searchsorted(stamps, [begin_ns, end_ns])
    return slice(int(first), int(last))
