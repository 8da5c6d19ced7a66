"""The IMU's series in base_link axes, its gaps and clipped samples known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Navigation, Stamps
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.span import main_span, within

Flags = np.ndarray

_RATE_JUMP = 1.0  # rad/s between a sample and the median of its neighbours that no vehicle of this kind does
_FORCE_JUMP = 10.0  # m/s^2, likewise


@dataclass(frozen=True)
class Inertial:
    """n samples of one IMU, axes of base_link, at the place of the IMU.

    stamp_ns         (n,) int64, ascending
    rate             (n, 3) rad/s, interpolated where unknown
    specific_force   (n, 3) m/s^2, interpolated where unknown
    rate_known, force_known   (n,) bool, of the interval that begins at the sample: False in gaps, beside clipped or
                     missing samples
    attitude         (n, 4) xyzw, reference <- base_link as the topic says; NaN where it says nothing
    attitude_sigma   (3,) rad, median of what the messages state, map axes; 0 where they state nothing
    lever_arm        (3,) m, the IMU in base_link
    rate_noise, force_noise   (3,) 1-sigma densities seen in the series, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz)
    clipped, spikes  number of samples at the end of the range, and of lone samples far off their neighbours; not used
    gaps             (k, 2) int64 ns, begin and end of each pause
    rate_derived     the rates come from differences of the attitude topic, since the log has no gyro
    """

    stamp_ns: Stamps
    rate: Floats
    specific_force: Floats
    rate_known: Flags
    force_known: Flags
    attitude: Floats
    attitude_sigma: Floats
    lever_arm: Floats
    rate_noise: Floats
    force_noise: Floats
    clipped: int
    spikes: int
    gaps: Stamps
    rate_derived: bool

    @property
    def seconds(self) -> Floats:
        """(n,) s since the first sample."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9


def prepare_inertial(
    log: Navigation, settings: NavigateSettings, span: tuple[int, int] | None = None
) -> Inertial | None:
    """The IMU's series cleaned and turned into base_link axes; None where the log has none.

    span: first and last stamp to use, ns; by default the longest stretch without a pause of `longest_gap`.
    """
    imu = log.imu
    if imu is None or len(imu.stamp_ns) == 0:
        return None
    keep = within(imu.stamp_ns, *(span or main_span([imu.stamp_ns], settings.longest_gap)))
    if len(keep) < 2:
        return None
    stamps = imu.stamp_ns[keep]
    mount = log.mount("imu_link")
    turned = Rotation.from_quat(mount.quaternion)
    raw_rate, raw_force = imu.rate[keep], imu.specific_force[keep]
    rate_clipped, force_clipped = _clipped(raw_rate), _clipped(raw_force)
    rate_spikes, force_spikes = _spikes(raw_rate, _RATE_JUMP), _spikes(raw_force, _FORCE_JUMP)
    rate_good = np.isfinite(raw_rate).all(axis=1) & ~rate_clipped & ~rate_spikes
    force_good = np.isfinite(raw_force).all(axis=1) & ~force_clipped & ~force_spikes
    attitude = _base_attitude(imu.attitude[keep], turned)
    if not settings.use_attitude:
        attitude[:] = np.nan
    rate = turned.apply(_filled(stamps, raw_rate, rate_good))
    derived = not rate_good.any() and bool(np.isfinite(attitude[:, 0]).sum() > 2)
    if derived:
        rate, rate_good = _rates_of(stamps, attitude)
    step = np.diff(stamps) * 1e-9
    pause = step > max(settings.gap, 3.0 * float(np.median(step)))
    force = turned.apply(_filled(stamps, raw_force, force_good))
    spacing = float(np.median(step))
    return Inertial(
        stamp_ns=stamps,
        rate=rate,
        specific_force=force,
        rate_known=_intervals(rate_good, pause),
        force_known=_intervals(force_good, pause),
        attitude=attitude,
        attitude_sigma=_stated_sigma(imu.attitude_covariance[keep], attitude),
        lever_arm=np.asarray(mount.translation, float),
        rate_noise=np.maximum(_white_noise(rate) * np.sqrt(spacing), settings.gyro_noise),
        force_noise=np.maximum(_white_noise(force) * np.sqrt(spacing), settings.accelerometer_noise),
        clipped=int((rate_clipped | force_clipped).sum()),
        spikes=int((rate_spikes | force_spikes).sum()),
        gaps=np.stack([stamps[:-1][pause], stamps[1:][pause]], axis=1),
        rate_derived=derived,
    )


def _base_attitude(quaternion: Floats, mounted: Rotation) -> Floats:
    """Reference <- base_link from reference <- imu_link; NaN stays NaN, a quaternion of no length becomes NaN."""
    out = np.full(quaternion.shape, np.nan)
    good = np.isfinite(quaternion).all(axis=1) & (np.linalg.norm(np.nan_to_num(quaternion), axis=1) > 0.5)
    if good.any():
        out[good] = (Rotation.from_quat(quaternion[good]) * mounted.inv()).as_quat()
    return out


def _stated_sigma(covariance: Floats, attitude: Floats) -> Floats:
    variance = np.diagonal(covariance[np.isfinite(attitude[:, 0])], axis1=1, axis2=2)
    if len(variance) == 0:
        return np.zeros(3)
    return np.sqrt(np.maximum(np.nan_to_num(np.median(variance, axis=0)), 0.0))


def _intervals(good: Flags, pause: Flags) -> Flags:
    """Which intervals (n,) have good samples at both ends and no pause in between; the last begins nothing."""
    return np.append(good[:-1] & good[1:] & ~pause, False)


def _filled(stamps: Stamps, values: Floats, good: Flags) -> Floats:
    """Values with the bad rows interpolated from the good ones; zero where none is good."""
    if good.all():
        return values
    if not good.any():
        return np.zeros_like(values)
    at, known = stamps - stamps[0], stamps[good] - stamps[0]
    return np.stack([np.interp(at, known, column) for column in values[good].T], axis=1)


def _rates_of(stamps: Stamps, attitude: Floats) -> tuple[Floats, Flags]:
    """Body rates (n, 3) from the attitude topic, and where they are known."""
    good = np.isfinite(attitude[:, 0])
    rotation = Rotation.from_quat(attitude[good])
    seconds = (stamps[good] - stamps[0]) * 1e-9
    step = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / np.diff(seconds)[:, None]
    middle = 0.5 * (seconds[1:] + seconds[:-1])
    at = (stamps - stamps[0]) * 1e-9
    return np.stack([np.interp(at, middle, column) for column in step.T], axis=1), good


def _clipped(values: Floats) -> Flags:
    """Rows (n,) in which an axis stays exactly at its own largest magnitude, three or more samples on end.

    A noisy series does not repeat its extreme; one in which equal neighbours are common anyway (coarse counts, a
    noiseless simulation) says nothing, and is left alone.
    """
    out = np.zeros(len(values), bool)
    for column in values.T:
        size = np.abs(column)
        if len(size) < 3 or not np.isfinite(size).any():
            continue
        peak = np.nanmax(size)
        top = size == peak
        equal = column[1:] == column[:-1]
        elsewhere = ~(top[1:] & top[:-1])
        if peak == 0.0 or top.mean() > 0.9 or (equal & elsewhere).sum() > 0.01 * max(elsewhere.sum(), 1):
            continue
        three = top[:-2] & top[1:-1] & top[2:]
        if three.any():
            out |= top
    return out


def _spikes(values: Floats, jump: float) -> Flags:
    """Rows (n,) that differ from the median of five neighbours by more than `jump` on an axis."""
    known = np.nan_to_num(values)
    return (np.abs(known - median_filter(known, size=(5, 1), mode="nearest")) > jump).any(axis=1)


def _white_noise(values: Floats) -> Floats:
    """1 sigma (3,) of a series' white part from its second differences (median of magnitudes: bursts do not count)."""
    if len(values) < 8:
        return np.zeros(values.shape[1])
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return np.median(np.abs(second), axis=0) / (0.6745 * np.sqrt(6.0))
