"""The laser's angle at any moment, from the encoder's counts."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.log.records import Encoder, Floats, Stamps
from garbi_map.rig import Rig
from garbi_map.sweep import kernels
from garbi_map.sweep.settings import SweepSettings

HALF_WIDTHS = np.array([3, 4, 5, 7, 9, 12, 16, 22, 30, 42, 58])  # readings on either side, tried in this order


class Angle(Protocol):
    """What tells the laser's angle: an encoder, or a rig file where there is no motor."""

    @property
    def turns_ns(self) -> Stamps:
        """(k,) stamps of the turning points, ascending."""
        ...

    def at(self, stamp_ns: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """alpha (m,) and its sigma (m,), rad; NaN where it is not known."""
        ...

    def alpha(self, stamp_ns: int) -> float:
        """alpha of one image, rad; NaN where it is not known."""
        ...

    def covers(self, stamp_ns: int) -> bool:
        """Whether the angle is known at this moment."""
        ...


class FixedAngle:
    """A laser without a motor."""

    def __init__(self, angle: float) -> None:
        self.angle = angle
        self.turns_ns = np.empty(0, np.int64)

    def at(self, stamp_ns: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """The one angle (m,), rad, with sigma 0 (m,)."""
        count = np.size(stamp_ns)
        return np.full(count, self.angle), np.zeros(count)

    def alpha(self, stamp_ns: int) -> float:
        """The one angle, rad."""
        return self.angle

    def covers(self, stamp_ns: int) -> bool:
        """Always."""
        return True


class LaserAngle:
    """A laser on a motor with an encoder, smoothed by local parabolas that do not reach across a sharp turn.

    step    rad per count, as the readings show it; 0 where they lie on no lattice
    noise   1 sigma of a reading, rad: rounding, or what neighbouring readings disagree by
    Readings are put in order of their stamps; repeated stamps, readings that are no numbers and single spikes are left
    out. Raises GarbiError where fewer than four readings remain.
    """

    def __init__(self, encoder: Encoder, settings: SweepSettings) -> None:
        stamps, angle = _clean(encoder)
        if len(stamps) < 4:
            raise GarbiError(
                f"the encoder has {len(stamps)} usable readings, at least 4 are needed for the laser's angle"
            )
        self._start_ns = int(stamps[0])
        self._time = (stamps - self._start_ns).astype(np.float64) * 1e-9
        self._angle = angle
        between = np.diff(self._time)
        self._period = float(np.median(between))
        breaks = np.flatnonzero(between > max(settings.encoder_gap, 2.5 * self._period)) + 1
        edges = np.concatenate([[0], breaks, [len(stamps)]])
        self._begin = np.repeat(edges[:-1], np.diff(edges))
        self._end = np.repeat(edges[1:], np.diff(edges))
        self.step = _count_step(angle)
        self.noise = max(_disagreement(self._time, angle), self.step / np.sqrt(12.0), 1e-9)
        jitter = max(3.0 * self.noise, 0.5 * self.step)
        turns = kernels.turning_points(self._time, angle, max(settings.least_turn, 4.0 * jitter), jitter)
        self.turns_ns: Stamps = self._start_ns + np.round(turns * 1e9).astype(np.int64)

    def at(self, stamp_ns: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """alpha (m,) and its sigma (m,), rad, at stamps (m,); NaN in gaps and beyond the record."""
        asked = (np.atleast_1d(np.asarray(stamp_ns, np.int64)) - self._start_ns).astype(np.float64) * 1e-9
        return kernels.local_angle(
            asked,
            self._time,
            self._angle,
            self._begin,
            self._end,
            HALF_WIDTHS,
            self._period,
            self.step,
            self.noise,
        )

    def alpha(self, stamp_ns: int) -> float:
        """alpha of one image, rad; NaN in gaps and beyond the record."""
        return float(self.at(np.array([stamp_ns]))[0][0])

    def covers(self, stamp_ns: int) -> bool:
        """Whether there are readings around this moment."""
        return not np.isnan(self.alpha(stamp_ns))


def laser_angle(encoder: Encoder | None, rig: Rig, settings: SweepSettings) -> Angle:
    """The encoder's angle where there is an encoder, else the rig's fixed one.

    Raises GarbiError where there is neither.
    """
    if encoder is not None and len(encoder.angle) > 0:
        return LaserAngle(encoder, settings)
    if rig.laser.fixed_angle is None:
        raise GarbiError(
            "the log has no encoder: name its topic in log.topics.encoder, "
            "or give laser.fixed_angle in the rig file if the laser has no motor"
        )
    return FixedAngle(rig.laser.fixed_angle)


def _clean(encoder: Encoder) -> tuple[Stamps, Floats]:
    """Stamps ascending and unique, angles continuous through full turns, without spikes."""
    finite = np.isfinite(encoder.angle)
    stamps, first = np.unique(encoder.stamp_ns[finite], return_index=True)
    angle = np.unwrap(encoder.angle[finite][first])
    if len(angle) < 5:
        return stamps, angle
    before, after = angle[:-2], angle[2:]
    usual = np.median(np.abs(np.diff(angle)))
    off = np.minimum(np.abs(angle[1:-1] - before), np.abs(angle[1:-1] - after))
    spike = np.zeros(len(angle), bool)
    spike[1:-1] = (off > 10.0 * usual + 0.01) & (np.abs(after - before) < 0.5 * off)
    return stamps[~spike], angle[~spike]


def _count_step(angle: Floats) -> float:
    """The lattice that the readings lie on: the greatest common divisor of their differences, to a twentieth."""
    moved = np.abs(np.diff(angle))
    moved = moved[moved > 1e-9]
    if len(moved) < 10:
        return 0.0
    least = float(moved.min())
    small = moved[moved < 200.0 * least]
    if len(small) < 0.5 * len(moved):
        return 0.0
    for part in (1, 2, 3):
        counts = small * part / least
        whole = np.round(counts)
        if np.abs(counts - whole).max() < 0.05:
            return float(small.sum() / whole.sum())
    return 0.0


def _disagreement(time: Floats, angle: Floats) -> float:
    """1 sigma of a reading against the line through its neighbours, the tenth of them near turns and gaps left out."""
    if len(time) < 10:
        return 0.0
    weight = (time[2:] - time[1:-1]) / (time[2:] - time[:-2])
    off = angle[1:-1] - weight * angle[:-2] - (1.0 - weight) * angle[2:]
    scaled = np.sort(off**2 / (1.0 + weight**2 + (1.0 - weight) ** 2))
    return float(np.sqrt(scaled[: int(0.9 * len(scaled))].mean()))
