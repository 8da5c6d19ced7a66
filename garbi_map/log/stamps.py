"""Which of a topic's stamps can be believed, and in which order."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Stamps


def believable(stamp_ns: Stamps, arrival_ns: Stamps, clock_tolerance_ns: int) -> NDArray[np.bool_]:
    """Which stamps (n,) lie near their arrival, once the usual offset between the two clocks is removed."""
    offset = stamp_ns - arrival_ns
    return np.abs(offset - np.int64(np.median(offset))) <= clock_tolerance_ns


def in_order(stamp_ns: Stamps, reorder_ns: int) -> NDArray[np.int64]:
    """Indices that sort the stamps of a topic, given in the order of recording, with repeated stamps left out and those
    that go back by more than `reorder_ns`.

    What stays is the longest ascending run of stamps (patience sorting, Fredman 1975) and its near neighbours: a clock
    that was set back costs the shorter side of the overlap, a single wild stamp costs itself.
    """
    if len(stamp_ns) and np.any(np.diff(stamp_ns) < 0):
        spine = _longest_ascending(stamp_ns)
        before = stamp_ns[spine][np.maximum(np.searchsorted(spine, np.arange(len(stamp_ns)), side="right") - 1, 0)]
        after = stamp_ns[spine][np.minimum(np.searchsorted(spine, np.arange(len(stamp_ns))), len(spine) - 1)]
        kept = np.flatnonzero((stamp_ns >= before - reorder_ns) & (stamp_ns <= after + reorder_ns))
    else:
        kept = np.arange(len(stamp_ns))
    kept = kept[np.argsort(stamp_ns[kept], kind="stable")]
    fresh = np.ones(len(kept), bool)
    fresh[1:] = np.diff(stamp_ns[kept]) > 0
    return kept[fresh]


def _longest_ascending(values: Stamps) -> NDArray[np.int64]:
    """Indices of a longest strictly ascending subsequence."""
    tails: list[int] = []
    ends: list[int] = []
    previous = np.full(len(values), -1)
    for index, value in enumerate(values.tolist()):
        place = bisect_left(tails, value)
        previous[index] = ends[place - 1] if place else -1
        tails[place : place + 1] = [value]
        ends[place : place + 1] = [index]
    chain = np.empty(len(tails), np.int64)
    index = ends[-1]
    for place in range(len(tails) - 1, -1, -1):
        chain[place] = index
        index = int(previous[index])
    return chain
