"""What the navigation says of itself: plain numbers and strings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from garbi_map.log.records import Navigation
from garbi_map.navigate.gyro_attitude import GyroAttitude
from garbi_map.navigate.inertial import Inertial
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.words import many

if TYPE_CHECKING:
    from garbi_map.navigate.eskf import ErrorStateFilter
    from garbi_map.navigate.smoother import Smoothed

_LATE = 1.0  # s; a sensor that begins so much after the dive, or stops so much before its end, is worth a line


def filter_report(
    log: Navigation,
    settings: NavigateSettings,
    inertial: Inertial | None,
    attitude: GyroAttitude | None,
    forward: ErrorStateFilter,
    smoothed: Smoothed,
    factors: dict[str, float],
) -> dict[str, Any]:
    """Sensors with their fate, the IMU's gaps, biases with sigma, and a line for each thing that costs accuracy.

    innovation_ratio is the typical squared innovation over what the filter expected: 1 is honest, small is cautious.
    factors: by what a sensor's stated variance was multiplied, since its innovations showed that it lies.
    """
    return {
        "source": "filter",
        "sensors": _sensor_report(forward, factors),
        "imu": _imu_report(inertial, attitude),
        "biases": _bias_report(smoothed, inertial, log),
        "notes": _notes(log, inertial, attitude, forward, settings),
    }


def odometry_report(
    used: int, received: int, inertial: Inertial | None, attitude: GyroAttitude | None
) -> dict[str, Any]:
    """The same where the trajectory is somebody else's."""
    return {
        "source": "odometry",
        "sensors": {"odometry": {"accepted": used, "rejected": received - used}},
        "imu": _imu_report(inertial, attitude),
        "notes": ["neither DVL nor absolute positions: the trajectory is that of the odometry topic"],
    }


def _sensor_report(forward: ErrorStateFilter, factors: dict[str, float]) -> dict[str, Any]:
    return {
        name: {
            "accepted": tally.accepted,
            "rejected": tally.rejected,
            "innovation_ratio": round(tally.typical(), 3),
            "variance_scaled_by": round(factors.get(name, 1.0), 3),
        }
        for name, tally in forward.tallies.items()
    }


def _imu_report(inertial: Inertial | None, attitude: GyroAttitude | None) -> dict[str, Any]:
    if inertial is None:
        return {"samples": 0}
    return {
        "samples": len(inertial.stamp_ns),
        "clipped": inertial.clipped,
        "spikes": inertial.spikes,
        "gaps": len(inertial.gaps),
        "gap_seconds": round(float(np.diff(inertial.gaps, axis=1).sum()) * 1e-9, 3),
        "rates_from_attitude": inertial.rate_derived,
        "attitude_reference": attitude.reference if attitude else "none",
        "attitude_disturbed_samples": int(attitude.disturbed.sum()) if attitude else 0,
    }


def _bias_report(smoothed: Smoothed, inertial: Inertial | None, log: Navigation) -> dict[str, Any]:
    """Value and 1 sigma in the middle of the dive."""
    middle = len(smoothed.sigma) // 2
    value, sigma = smoothed.biases[middle], smoothed.sigma[middle, 9:]
    out: dict[str, Any] = {}
    if inertial is not None:
        out["gyro"] = {"value": value[0:3].tolist(), "sigma": sigma[0:3].tolist(), "unit": "rad/s"}
        out["accelerometer"] = {"value": value[3:6].tolist(), "sigma": sigma[3:6].tolist(), "unit": "m/s^2"}
    if log.dvl is not None:
        out["dvl_scale"] = {"value": float(value[9]), "sigma": float(sigma[9]), "unit": "1"}
    return out


def _notes(
    log: Navigation,
    inertial: Inertial | None,
    attitude: GyroAttitude | None,
    forward: ErrorStateFilter,
    settings: NavigateSettings,
) -> list[str]:
    """One line for each thing that costs accuracy."""
    notes = []
    if inertial is None:
        notes.append("no IMU: attitude and velocity between other sensors are assumed steady")
    else:
        if len(inertial.gaps):
            lost = float(np.diff(inertial.gaps, axis=1).sum()) * 1e-9
            notes.append(f"IMU: silent {many(len(inertial.gaps), 'time')}, {lost:.1f} s in all")
        if inertial.clipped:
            notes.append(f"the IMU was at the end of its range in {many(inertial.clipped, 'sample')}, not used")
        if inertial.spikes:
            notes.append(f"the IMU had {many(inertial.spikes, 'lone spike')}, not used")
        if inertial.rate_derived:
            notes.append("no gyro: rates are differences of the attitude topic")
    notes += _silences(log, forward)
    if attitude is not None and attitude.disturbed.any():
        notes.append(
            "the attitude topic's yaw contradicts the gyro in "
            f"{many(int(attitude.disturbed.sum()), 'sample')}, not used"
        )
    if "dvl" not in forward.tallies and "fixes" not in forward.tallies:
        notes.append(f"nothing measures velocity: taken as {settings.speed} m/s or less; positions drift")
    if log.dvl is not None and "dvl" in forward.tallies:
        used = forward.tallies["dvl"].accepted
        if used < len(log.dvl.stamp_ns):
            pings = many(len(log.dvl.stamp_ns), "ping")
            notes.append(f"DVL: {len(log.dvl.stamp_ns) - used:,} of {pings} invalid or outliers")
    if "pressure" not in forward.tallies:
        notes.append("no pressure: heights are relative to the first pose")
    return notes


def _silences(log: Navigation, forward: ErrorStateFilter) -> list[str]:
    """A line for each sensor that begins late, stops early or, the IMU apart, pauses."""
    begin, end = int(forward.base.stamp_ns[0]), int(forward.base.stamp_ns[-1])
    lines = []
    for name, sensor in {"IMU": log.imu, "DVL": log.dvl, "pressure": log.pressure, "fixes": log.fixes}.items():
        if sensor is None or not len(sensor.stamp_ns):
            continue
        first, last = (sensor.stamp_ns[0] - begin) * 1e-9, (sensor.stamp_ns[-1] - begin) * 1e-9
        usual = float(np.median(np.diff(sensor.stamp_ns))) * 1e-9 if len(sensor.stamp_ns) > 1 else 0.0
        if first > max(_LATE, 3.0 * usual):
            lines.append(f"{name}: nothing in the first {first:.1f} s")
        if (end - begin) * 1e-9 - last > max(_LATE, 3.0 * usual):
            lines.append(f"{name}: nothing after {last:.1f} s")
        pauses = np.diff(sensor.stamp_ns) * 1e-9
        long = pauses[pauses > max(_LATE, 3.0 * usual)]
        if len(long) and name != "IMU":
            lines.append(f"{name}: silent {many(len(long), 'time')}, {long.sum():.1f} s in all")
    return lines
