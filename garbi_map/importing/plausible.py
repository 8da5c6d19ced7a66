"""Whether numbers can be what a role would read them as, and in which unit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from garbi_map.log.records import Floats

DEGREE = math.pi / 180


class Verdict(NamedTuple):
    """score: negative where it cannot be, positive where it is likely; scale: unit to SI; remark: for a reader."""

    score: int
    remark: str = ""
    scale: float = 1.0


def judge(role: str, values: Floats) -> Verdict:
    """What the rows (n, width) of a role say; nothing is known of none."""
    judges = {
        "encoder": _encoder, "pressure": _pressure, "depth": _depth, "imu": _imu, "dvl": _dvl,
        "odometry": _odometry, "attitude": _attitude,
    }  # fmt: skip
    if not len(values) or role not in judges:
        return Verdict(0)
    finite = values[np.isfinite(values[:, :1]).all(axis=1)]
    return judges[role](finite) if len(finite) else Verdict(-1, "no numbers in its first messages")


def _encoder(values: Floats) -> Verdict:
    angle = values[:, 0]
    low, high = float(angle.min()), float(angle.max())
    if high - low < 1e-6:
        return Verdict(-2, f"stands still at {low:.4g}")
    step = np.abs(np.diff(angle))
    if len(step) and np.median(step) > 0.2 * (high - low):
        return Verdict(-2, "jumps about, an angle would not")
    if max(abs(low), abs(high)) > 2 * math.pi + 0.1:
        if max(abs(low), abs(high)) <= 720:
            return Verdict(1, f"{low:.3g} to {high:.3g}: taken for degrees", DEGREE)
        return Verdict(0, f"{low:.6g} to {high:.6g}: counts? set log.scale.encoder to rad per count")
    return Verdict(2, f"{low:.3g} to {high:.3g}: taken for radians")


_PRESSURE_UNITS = (
    (4e4, 1.2e8, 1.0, "Pa"),
    (900.0, 4e4, 100.0, "hPa"),
    (90.0, 900.0, 1e3, "kPa"),
    (0.9, 90.0, 1e5, "bar"),
)


def _pressure(values: Floats) -> Verdict:
    middle = float(np.median(values[:, 0]))
    for low, high, scale, unit in _PRESSURE_UNITS:
        if low <= middle < high:
            return Verdict(2, f"about {middle:.4g}: taken for {unit}", scale)
    return Verdict(-3, f"about {middle:.4g}: no absolute pressure")


def _depth(values: Floats) -> Verdict:
    middle = float(np.median(values[:, 0]))
    if abs(middle) > 12_000:
        return Verdict(-3, f"about {middle:.4g}: no depth")
    if middle < -0.5:
        return Verdict(1, f"about {middle:.3g}: counts upwards", -1.0)
    return Verdict(1, f"about {middle:.3g} m down")


def _imu(values: Floats) -> Verdict:
    force = float(np.median(np.linalg.norm(values[:, 3:6], axis=1)))
    if 8.5 < force < 11:
        return Verdict(2)
    return Verdict(0, f"specific force about {force:.3g} instead of 9.8 m/s^2: check its unit")


def _dvl(values: Floats) -> Verdict:
    speed = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    if speed > 10:
        return Verdict(-2, f"about {speed:.3g} m/s: too fast")
    return Verdict(1 if speed > 0 else 0, f"about {speed:.2g} m/s")


def _odometry(values: Floats) -> Verdict:
    return _turns(values[:, 3:7])


def _attitude(values: Floats) -> Verdict:
    return _turns(values)


def _turns(quaternion: Floats) -> Verdict:
    good = np.abs(np.linalg.norm(quaternion, axis=1) - 1) < 0.01
    return Verdict(1) if good.mean() > 0.9 else Verdict(-3, "its quaternions have no length of one")
