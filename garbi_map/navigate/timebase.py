"""The instants at which the filter knows the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats, Stamps
from garbi_map.navigate.inertial import Flags, Inertial
from garbi_map.navigate.settings import NavigateSettings

_FILL_NS = 20_000_000  # spacing of the samples that stand in for a silent IMU


@dataclass(frozen=True)
class Timebase:
    """m samples: those of the IMU, and stand-ins where it is silent (all of them without an IMU).

    stamp_ns        (m,) int64, ascending
    seconds         (m,) s since the first
    rate, force     (m, 3) base_link axes, rad/s and m/s^2
    rate_known, force_known   (m,) bool, of the interval that begins at the sample
    nodes           (k,) samples at which the covariance is propagated; the first and the last are among them
    """

    stamp_ns: Stamps
    seconds: Floats
    rate: Floats
    force: Floats
    rate_known: Flags
    force_known: Flags
    nodes: np.ndarray


def make_timebase(inertial: Inertial | None, begin_ns: int, end_ns: int, settings: NavigateSettings) -> Timebase:
    """Lay the samples over [begin_ns, end_ns], which contains the inertial series."""
    own = inertial.stamp_ns if inertial else np.empty(0, np.int64)
    edges = np.concatenate([[begin_ns], own, [max(end_ns, begin_ns + _FILL_NS)]])
    wide = np.flatnonzero(np.diff(edges) > max(settings.gap * 1e9, 2 * _FILL_NS))
    fillers = [np.arange(edges[i], edges[i + 1], _FILL_NS) for i in wide]
    stamps = np.unique(np.concatenate([edges, *fillers]))
    seconds = (stamps - stamps[0]) * 1e-9
    rate, force = np.zeros((len(stamps), 3)), np.zeros((len(stamps), 3))
    rate_known, force_known = np.zeros(len(stamps), bool), np.zeros(len(stamps), bool)
    if inertial:
        at = np.searchsorted(stamps, own)
        rate[at], force[at] = inertial.rate, inertial.specific_force
        rate_known[at], force_known[at] = inertial.rate_known, inertial.force_known
    return Timebase(stamps, seconds, rate, force, rate_known, force_known, pick(seconds, settings.node_rate))


def pick(seconds: Floats, per_second: float) -> np.ndarray:
    """Indices of at most so many samples per second: the first one, the last one of each bin, the last one."""
    bins = np.floor(seconds * per_second + 1e-9)
    ends = np.flatnonzero(np.diff(bins, append=np.inf))
    return np.unique(np.concatenate([[0], ends]))
