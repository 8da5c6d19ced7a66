"""What a dive recorded when: a lane for the images, the sweeps and each sensor, with their gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.export import Span
from garbi_map.log.gaps import GAP_FACTOR, GAP_LEAST
from garbi_map.sweep.store import SweepStore

if TYPE_CHECKING:
    from garbi_map.dive import Dive

_SENSORS = ("encoder", "imu", "pressure", "dvl", "fixes", "odometry")
_MOST_GAPS = 100


def timeline(dive: Dive, store: SweepStore) -> list[Span]:
    """Every lane of the dive, s since the log's begin; a sensor that the log does not have is "absent" throughout."""
    begin_ns = dive.log.begin_ns
    first = dive.log.begin_ns if dive.span_ns[0] is None else max(dive.span_ns[0], begin_ns)
    last = dive.log.end_ns if dive.span_ns[1] is None else min(dive.span_ns[1], dive.log.end_ns)
    whole = (first - begin_ns) * 1e-9, (last - begin_ns) * 1e-9
    spans = lane("images", (np.sort(store.stamps()) - begin_ns).astype(np.float64) * 1e-9, *whole)
    spans += [
        Span(lane="sweeps", begin_s=(e.begin_ns - begin_ns) * 1e-9, end_s=(e.end_ns - begin_ns) * 1e-9)
        for e in store.entries
    ]
    for name in _SENSORS:
        sensor = getattr(dive.navigation, name)
        stamps = np.empty(0, np.int64) if sensor is None else sensor.stamp_ns
        if name == "dvl" and sensor is not None:
            stamps = stamps[np.isfinite(sensor.velocity).all(axis=1)]
        spans += lane(name, (stamps - begin_ns).astype(np.float64) * 1e-9, *whole)
    return spans


def lane(name: str, seconds: NDArray[np.float64], begin: float, end: float) -> list[Span]:
    """One lane from ascending stamps, s: what is there between `begin` and `end`, and the largest gaps in it as lost."""
    seconds = seconds[(seconds >= begin) & (seconds <= end)]
    if not len(seconds):
        return [Span(lane=name, begin_s=begin, end_s=end, state="absent")]
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else GAP_LEAST
    edges = np.r_[begin, seconds, end]
    step = np.diff(edges)
    gaps = np.flatnonzero(step > max(GAP_FACTOR * usual, GAP_LEAST))
    gaps = np.sort(gaps[np.argsort(-step[gaps], kind="stable")[:_MOST_GAPS]])
    starts, ends = np.r_[begin, edges[gaps + 1]], np.r_[edges[gaps], end]
    good = [
        Span(lane=name, begin_s=float(a), end_s=float(b))
        for a, b in zip(starts, ends, strict=True)
        if b > a or a not in (begin, end)
    ]
    lost = [Span(lane=name, begin_s=float(edges[k]), end_s=float(edges[k + 1]), state="lost") for k in gaps]
    return sorted([*good, *lost], key=lambda span: span.begin_s)
