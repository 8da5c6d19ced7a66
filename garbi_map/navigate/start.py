"""What is known before the first measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from garbi_map.navigate.gyro_attitude import GyroAttitude
from garbi_map.navigate.inertial import Inertial
from garbi_map.navigate.kernels import cross_matrix, matrix
from garbi_map.navigate.observations import Source
from garbi_map.navigate.process import topic_sigma
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.states import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    SCALE,
    STATES,
    TOPIC,
    VELOCITY,
)

_EXACT = 1e-4  # m and rad: what is so by definition, such as where the first pose is


@dataclass(frozen=True)
class Start:
    """The state at the first sample and what is known of it: covariance (STATES, STATES)."""

    position: Floats
    velocity: Floats
    quaternion: Floats
    gyro_bias: Floats
    covariance: Floats


def first_guess(
    inertial: Inertial | None, attitude: GyroAttitude | None, sources: list[Source], settings: NavigateSettings
) -> Start:
    """First guess and how far it may be off: wide where a sensor will say, exact where the map is defined by it."""
    by_name = {source.name: source for source in sources}
    quaternion, bias = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
    arm = inertial.lever_arm if inertial else np.zeros(3)
    if attitude is not None:
        quaternion, bias = attitude.quaternion[0], attitude.bias_series[0]
    elif "yaw" in by_name:
        quaternion = by_name["tilt"].value[0]
    has_topic = "yaw" in by_name
    tilt = 0.2 if has_topic or attitude is not None else settings.tilt
    position, sigma = Rotation.from_quat(quaternion).apply(arm), np.full(3, _EXACT)
    if "fixes" in by_name:
        rows = by_name["fixes"].value.shape[1]
        position[:rows] += by_name["fixes"].value[0]
        sigma[:rows] = 5.0 * np.sqrt(by_name["fixes"].variance[0].max()) + 1.0
    if "pressure" in by_name:
        position[2] = np.median(by_name["pressure"].value[:5])
        sigma[2] = 1.0
    velocity = np.zeros(3)
    if "dvl" in by_name:
        # a DVL ping linearised about standstill would not see that its velocity turns with the yaw, and the next one
        # would then take the difference for knowledge of the yaw
        velocity = Rotation.from_quat(quaternion).apply(np.median(by_name["dvl"].value[:5], axis=0))
    measured = "dvl" in by_name or "fixes" in by_name
    covariance = _covariance(
        quaternion,
        arm,
        {
            "position": sigma,
            "velocity": np.full(3, settings.speed * (5.0 if measured else 1.0)),
            "attitude": np.array([tilt, tilt, 0.5 if has_topic else _EXACT]),
        },
        topic_sigma(inertial, settings),
        settings,
    )
    return Start(position, velocity, quaternion, bias, covariance)


def _covariance(
    quaternion: Floats, arm: Floats, sigma: dict[str, Floats], topic: Floats, settings: NavigateSettings
) -> Floats:
    """Covariance (STATES, STATES) of a start that knows base_link, not the IMU at `arm`, to sigma["position"].

    sigma: 1 sigma (3,) of "position" m, "velocity" m/s, "attitude" rad.
    """
    diagonal = np.zeros(STATES)
    diagonal[POSITION], diagonal[VELOCITY] = sigma["position"], sigma["velocity"]
    diagonal[ATTITUDE] = sigma["attitude"]
    diagonal[GYRO_BIAS], diagonal[ACCELEROMETER_BIAS] = settings.gyro_bias, settings.accelerometer_bias
    diagonal[TOPIC], diagonal[SCALE] = topic, settings.dvl_scale
    lever = np.eye(STATES)
    lever[POSITION, ATTITUDE] = -cross_matrix(matrix(quaternion) @ arm)
    return lever @ np.diag(diagonal**2) @ lever.T
