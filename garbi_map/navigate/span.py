"""Which part of the stamps is the dive."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.log.records import Stamps


def main_span(series: Iterable[Stamps], longest_gap: float) -> tuple[int, int]:
    """First and last stamp, ns, of the longest-populated stretch without a pause of `longest_gap` seconds.

    A clock that jumped leaves a few stamps far away; they must not stretch the dive to years.
    Raises GarbiError where there is no stamp at all.
    """
    stamps = np.sort(np.concatenate([np.asarray(one, np.int64) for one in series] or [np.empty(0, np.int64)]))
    if len(stamps) == 0:
        raise GarbiError(
            "navigation: nothing in the log carries a stamp; record an encoder, images or navigation sensors"
        )
    cuts = np.flatnonzero(np.diff(stamps) > longest_gap * 1e9) + 1
    longest = max(np.split(stamps, cuts), key=len)
    return int(longest[0]), int(longest[-1])


def within(stamp_ns: Stamps, begin_ns: int, end_ns: int) -> np.ndarray:
    """Indices of the stamps inside [begin_ns, end_ns], in ascending order, each stamp once (the first that came)."""
    inside = np.flatnonzero((stamp_ns >= begin_ns) & (stamp_ns <= end_ns))
    _, first = np.unique(stamp_ns[inside], return_index=True)
    return inside[first]
