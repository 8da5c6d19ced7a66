"""Fewer of what is too many to draw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def thinned(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` of the indices 0 .. count - 1, evenly spread."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)


def runs(groups: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index and length of each run of equal values in an array that is not empty."""
    first = np.flatnonzero(np.r_[True, groups[1:] != groups[:-1]])
    return first, np.diff(np.r_[first, len(groups)])
