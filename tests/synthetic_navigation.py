"""A vehicle on an analytic path, and what its sensors would say: the truth of the navigation tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Dvl, Encoder, Floats, Imu, Mount, Navigation, Pressure, Stamps

BEGIN_NS = 1_790_000_000_000_000_000
GRAVITY = np.array([0.0, 0.0, 9.80665])
MOUNTS = {
    "imu_link": Mount(
        np.array([-0.10, 0.02, 0.05]), Rotation.from_euler("xyz", [3.0, -2.0, 90.0], degrees=True).as_quat()
    ),
    "dvl_link": Mount(np.array([-0.20, 0.05, -0.10]), Rotation.from_euler("z", 45.0, degrees=True).as_quat()),
    "pressure_link": Mount(np.array([0.10, 0.0, 0.10])),
    "rig": Mount(np.array([0.25, 0.0, -0.10]), Rotation.from_euler("y", 90.0, degrees=True).as_quat()),
}


def position(t: Floats) -> Floats:
    """A slow figure of eight with sway on top, 12 m deep; (n, 3) m, origin where it is at t = 0."""
    x = 1.5 * np.sin(0.10 * t) + 0.05 * np.sin(1.3 * t)
    y = 0.8 * np.sin(0.20 * t) + 0.04 * (np.sin(1.1 * t + 0.3) - np.sin(0.3))
    z = -12.0 + 0.2 * np.sin(0.15 * t) + 0.03 * np.sin(0.9 * t)
    return np.stack([x, y, z], axis=-1)


def rotation(t: Floats) -> Rotation:
    """map <- base_link: some degrees of roll and pitch, half a radian of yaw."""
    yaw = 0.4 + 0.5 * np.sin(0.12 * t)
    pitch = 0.05 * np.sin(0.8 * t + 0.5)
    roll = 0.04 * np.sin(1.0 * t)
    return Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=-1))


def derivative(function: Callable[[Floats], Floats], t: Floats, order: int) -> Floats:
    """First or second derivative by five points 2 ms apart, exact to 1e-9 here."""
    h = 2e-3
    values = [function(t + k * h) for k in (-2, -1, 0, 1, 2)]
    weights = {1: np.array([1, -8, 0, 8, -1]) / (12 * h), 2: np.array([-1, 16, -30, 16, -1]) / (12 * h * h)}[order]
    return sum(w * v for w, v in zip(weights, values, strict=True))


def body_rate(t: Floats) -> Floats:
    """(n, 3) rad/s, base_link axes, from R' dR/dt."""
    slope = derivative(lambda s: rotation(s).as_matrix(), t, 1)
    skew = rotation(t).as_matrix().transpose(0, 2, 1) @ slope
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


def point_on(arm: Floats) -> Callable[[Floats], Floats]:
    """The path in map of a point fixed at `arm` in base_link."""
    return lambda t: position(t) + rotation(t).apply(arm)


@dataclass
class Errors:
    """1 sigma of what is wrong with the sensors; all zero is a perfect suite. Slow attitude errors are Gauss-Markov."""

    gyro: float = 0.0  # rad/s per sample
    gyro_bias: Floats = field(default_factory=lambda: np.zeros(3))  # rad/s
    accelerometer: float = 0.0  # m/s^2 per sample
    accelerometer_bias: Floats = field(default_factory=lambda: np.zeros(3))  # m/s^2
    topic: Floats = field(default_factory=lambda: np.zeros(3))  # rad, roll pitch yaw, slow
    topic_time: float = 20.0  # s
    topic_white: float = 0.0  # rad
    dvl: float = 0.0  # m/s
    dvl_scale: float = 0.0
    depth: float = 0.0  # m


def typical_errors(seed: int) -> Errors:
    """One draw of a suite like that of a good small vehicle."""
    draw = np.random.default_rng(seed + 10_000)
    return Errors(
        gyro=1e-3,
        gyro_bias=draw.normal(0.0, 2e-3, 3),
        accelerometer=0.02,
        accelerometer_bias=draw.normal(0.0, 0.03, 3),
        topic=np.array([0.0045, 0.0045, 0.02]),
        topic_white=3e-4,
        dvl=4e-3,
        dvl_scale=float(draw.normal(0.0, 0.008)),
        depth=3e-3,
    )


def stamps(duration: float, rate: float, first: float = 0.0) -> Stamps:
    """Header stamps, ns, of a sensor of this rate."""
    return BEGIN_NS + np.round(np.arange(first, duration, 1.0 / rate) * 1e9).astype(np.int64)


def seconds(stamp_ns: Stamps) -> Floats:
    return (stamp_ns - BEGIN_NS) * 1e-9


def build(duration: float = 30.0, errors: Errors | None = None, seed: int = 0, imu_rate: float = 100.0) -> Navigation:
    """What the vehicle records: IMU, pressure 10 Hz, DVL 8 Hz, encoder."""
    errors = errors or Errors()
    random = np.random.default_rng(seed)
    at = stamps(duration, imu_rate)
    t = seconds(at)
    mount = MOUNTS["imu_link"]
    mounted = Rotation.from_quat(mount.quaternion)
    acceleration = derivative(point_on(mount.translation), t, 2)
    rate = body_rate(t) + errors.gyro_bias
    force = rotation(t).inv().apply(acceleration + GRAVITY) + errors.accelerometer_bias
    slow = (
        _gauss_markov(random, t, errors.topic, errors.topic_time)
        + random.normal(0, 1, (len(t), 3)) * errors.topic_white
    )
    attitude = Rotation.from_rotvec(slow) * rotation(t) * mounted
    imu = Imu(
        at,
        at,
        mounted.inv().apply(rate) + random.normal(0, 1, (len(t), 3)) * errors.gyro,
        mounted.inv().apply(force) + random.normal(0, 1, (len(t), 3)) * errors.accelerometer,
        attitude.as_quat(),
        np.broadcast_to(np.diag(errors.topic**2), (len(t), 3, 3)),
    )
    return Navigation(
        encoder=Encoder(at, at, 0.4 * np.sin(t)),
        imu=imu,
        pressure=_pressure(random, duration, errors),
        dvl=_dvl(random, duration, errors),
        mounts=MOUNTS,
    )


def _pressure(random: np.random.Generator, duration: float, errors: Errors) -> Pressure:
    at = stamps(duration, 10.0, 0.003)
    height = (
        point_on(MOUNTS["pressure_link"].translation)(seconds(at))[:, 2] + random.normal(0, 1, len(at)) * errors.depth
    )
    return Pressure(at, at, 101325.0 - height * 1025.0 * 9.80665)


def _dvl(random: np.random.Generator, duration: float, errors: Errors) -> Dvl:
    at = stamps(duration, 8.0, 0.007)
    t = seconds(at)
    mount = MOUNTS["dvl_link"]
    velocity = (
        (rotation(t) * Rotation.from_quat(mount.quaternion)).inv().apply(derivative(point_on(mount.translation), t, 1))
    )
    measured = velocity * (1.0 + errors.dvl_scale) + random.normal(0, 1, (len(at), 3)) * errors.dvl
    return Dvl(at, at, measured, np.broadcast_to(np.eye(3) * errors.dvl**2, (len(at), 3, 3)))


def _gauss_markov(random: np.random.Generator, t: Floats, sigma: Floats, memory: float) -> Floats:
    keep = np.exp(-(t[1] - t[0]) / memory)
    kicks = random.normal(0, 1, (len(t), 3)) * sigma
    out = np.empty_like(kicks)
    out[0] = kicks[0]
    for i in range(1, len(t)):
        out[i] = keep * out[i - 1] + np.sqrt(1.0 - keep**2) * kicks[i]
    return out


def pose_errors(trajectory, stamp_ns: Stamps) -> tuple[Floats, Floats]:
    """Position error (n, 3) m, rotation error (n, 3) rad, map axes: truth less estimate."""
    found = trajectory.at(stamp_ns)
    t = seconds(stamp_ns)
    true = position(t) - [*position(np.zeros(1))[0, :2], 0.0]
    return true - found.position, (rotation(t) * found.rotation.inv()).as_rotvec()
