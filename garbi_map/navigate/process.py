"""How the error-state moves on and what uncertainty that adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.navigate.inertial import Inertial
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


@dataclass(frozen=True, slots=True)
class Step:
    """From one node to the next: seconds, Jacobian (9, 15) of `kernels.propagate`, seconds without gyro and without
    accelerometer; `doubt` (STATES,) is variance added because a sensor contradicted the filter for too long."""

    seconds: float
    jacobian: Floats
    no_rate: float
    no_force: float
    doubt: Floats


class ProcessModel:
    """Transition and process noise (STATES, STATES) of a step."""

    def __init__(self, inertial: Inertial | None, settings: NavigateSettings) -> None:
        self.settings = settings
        self._gyro = float(np.mean(inertial.rate_noise**2)) if inertial else 0.0
        self._accelerometer = float(np.mean(inertial.force_noise**2)) if inertial else 0.0
        self._topic = topic_sigma(inertial, settings) ** 2

    def decay(self, step: Step) -> float:
        """What is left after the step of the attitude topic's slow error."""
        return float(np.exp(-step.seconds / self.settings.attitude_time))

    def transition(self, step: Step) -> Floats:
        """F of error(after) = F error(before)."""
        out = np.eye(STATES)
        out[:9, :15] = step.jacobian
        out[TOPIC, TOPIC] *= self.decay(step)
        return out

    def noise(self, step: Step) -> Floats:
        """Q: white noise of the sensors, or of the vehicle where they are missing; random walks of the biases."""
        settings, seconds = self.settings, step.seconds
        out = np.zeros((STATES, STATES))
        diagonal = np.einsum("ii->i", out)
        push = self._accelerometer * (seconds - step.no_force) + settings.acceleration**2 * step.no_force
        diagonal[POSITION], diagonal[VELOCITY] = push * seconds**2 / 3.0, push
        for axis in range(3):
            out[axis, 3 + axis] = out[3 + axis, axis] = push * seconds / 2.0
        diagonal[ATTITUDE] = self._gyro * (seconds - step.no_rate) + settings.turn_rate**2 * step.no_rate
        diagonal[GYRO_BIAS] = settings.gyro_bias_walk**2 * seconds
        diagonal[ACCELEROMETER_BIAS] = settings.accelerometer_bias_walk**2 * seconds
        diagonal[TOPIC] = self._topic * (1.0 - self.decay(step) ** 2)
        diagonal[SCALE] = settings.dvl_scale_walk**2 * seconds
        diagonal += step.doubt
        return out


def topic_sigma(inertial: Inertial | None, settings: NavigateSettings) -> Floats:
    """1 sigma (3,) rad of the attitude topic's slow error: what it states, not below the floor."""
    floor = np.array([settings.attitude_tilt, settings.attitude_tilt, settings.attitude_yaw])
    return np.maximum(inertial.attitude_sigma, floor) if inertial else floor
