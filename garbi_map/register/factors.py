"""What each sensor says about the motion, as rows of the least-squares problem.

Each factor holds its own 1 sigma and can re-estimate it from its residuals (variance components, Foerstner 1979), because
the covariances in messages may lie.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.register import motion as unknowns
from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations, Run

Floats = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, -9.80665])
_AXES = np.eye(3)
_UNKNOWN_TURNING = np.deg2rad(1.5)
"""Rate, rad/s, at which a vehicle turns of which no sensor tells."""
_SILENCE = 0.1
"""s; farther than that from its readings the gyro says nothing."""


class Factor(Protocol):
    """Something that adds rows to the problem, linearised about a motion."""

    sigma: float

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        """Adds its rows."""

    def reestimate(self, motion: Motion) -> None:
        """Takes its sigma from its residuals."""


def far_from(t: Floats, others: Floats, distance: float) -> NDArray[np.bool_]:
    """Which of t (n,) have none of the ascending `others` within `distance`."""
    return np.searchsorted(others, t - distance) == np.searchsorted(others, t + distance, side="right")


def _spread(residual: Floats, least: float, most: float) -> float:
    """Robust 1 sigma of residuals of any shape, within bounds."""
    return float(np.clip(1.4826 * np.median(np.abs(residual)), least, most))


class Acceleration:
    """p'' = R (f - b) + g - (R l)'': the accelerometer, averaged over short bins.

    time (n,) s, force (n, 3) m/s^2 in base_link axes, arm (n, 3) m/s^2: the acceleration of the sensor about base_link's
    origin, in base_link axes.
    """

    def __init__(self, time: Floats, force: Floats, arm: Floats) -> None:
        self.time, self.force, self.arm = time, force, arm
        self.sigma = 0.03

    def _residual(self, motion: Motion) -> tuple[Floats, Floats, Rotation]:
        rotation = motion.rotation(self.time)
        force = rotation.apply(self.force - self.arm)
        bias = rotation.apply(motion.constants[unknowns.ACCELEROMETER_BIAS])
        return motion.position(self.time, 2) - (force - bias + GRAVITY), force, rotation

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        residual, force, rotation = self._residual(motion)
        matrix = rotation.as_matrix()
        n = len(self.time)
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], (n, 3))
            runs = [
                motion.position_run(self.time, unit, 2),
                motion.attitude_run(self.time, np.cross(unit, force)),
                motion.constants_run(n, accelerometer_bias=matrix[:, axis]),
            ]
            problem.add(residual[:, axis], self.sigma, runs, cauchy=4.0)

    def reestimate(self, motion: Motion) -> None:
        self.sigma = _spread(self._residual(motion)[0], 0.005, 0.5)


class AttitudeCorrection:
    """The correction theta is small and, but for the gyro's bias, changes slowly.

    magnitude (3,) rad: 1 sigma of the prior attitude about each map axis. The rate's sigma is what is left of the gyro's
    noise when it is averaged between two knots; gyro (n,) s are the times at which there is one. Away from them, as
    everywhere where gyro is None, the vehicle turns as no sensor tells.
    """

    def __init__(self, magnitude: Floats, spacing: float, gyro: Floats | None) -> None:
        self.magnitude, self.spacing, self.gyro = magnitude, spacing, gyro
        self.sigma = _UNKNOWN_TURNING if gyro is None else np.deg2rad(0.05)

    def _times(self, motion: Motion) -> Floats:
        # a cubic has four coefficients however short the dive is
        count = max(int(np.ceil(2.0 * (motion.end - motion.begin) / self.spacing)), 4)
        return np.linspace(motion.begin, motion.end, count + 1)

    def _rate_residual(self, motion: Motion) -> tuple[Floats, Floats]:
        t = self._times(motion)
        matrix = motion.rotation(t).as_matrix()
        return motion.correction(t, 1) + matrix @ motion.constants[unknowns.GYRO_BIAS], matrix

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = self._times(motion)
        n = len(t)
        theta = motion.correction(t)
        rate, matrix = self._rate_residual(motion)
        sigma = np.full(n, _UNKNOWN_TURNING)
        sigma[self._told(t)] = self.sigma
        # one bias-like error for the dive, not one for each time: the rows share their information
        shared = np.sqrt(max(n / 4.0, 1.0))
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], (n, 3))
            problem.add(theta[:, axis], self.magnitude[axis] * shared, [motion.attitude_run(t, unit)])
            runs = [motion.attitude_run(t, unit, 1), motion.constants_run(n, gyro_bias=matrix[:, axis])]
            problem.add(rate[:, axis], sigma, runs, cauchy=4.0)

    def _told(self, t: Floats) -> NDArray[np.bool_]:
        """Where (n,) the gyro speaks."""
        if self.gyro is None:
            return np.zeros(len(t), bool)
        return ~far_from(t, self.gyro, _SILENCE)

    def reestimate(self, motion: Motion) -> None:
        told = self._told(self._times(motion))
        if told.any():
            self.sigma = _spread(self._rate_residual(motion)[0][told], np.deg2rad(0.02), np.deg2rad(0.3))


class Height:
    """Heights of a point of the vehicle: pressure. time (n,) s, height (n,) m in map, lever (3,) m in base_link."""

    def __init__(self, time: Floats, height: Floats, lever: Floats) -> None:
        self.time, self.height, self.lever = time, height, lever
        self.sigma = 0.02

    def _residual(self, motion: Motion) -> tuple[Floats, Floats]:
        arm = motion.rotation(self.time).apply(self.lever)
        return motion.position(self.time)[:, 2] + arm[:, 2] - self.height, arm

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        residual, arm = self._residual(motion)
        unit = np.broadcast_to(_AXES[2], arm.shape)
        runs = [motion.position_run(self.time, unit), motion.attitude_run(self.time, np.cross(arm, unit))]
        problem.add(residual, self.sigma, runs, cauchy=3.0)

    def reestimate(self, motion: Motion) -> None:
        self.sigma = _spread(self._residual(motion)[0], 0.001, 0.2)


class BottomTrack:
    """DVL velocities with an unknown scale: p' + R (w x l) = (1 + s) R v.

    time (n,) s, velocity (n, 3) m/s in base_link axes, rate (n, 3) rad/s in base_link, lever (3,) m.
    """

    def __init__(self, time: Floats, velocity: Floats, rate: Floats, lever: Floats) -> None:
        self.time, self.velocity = time, velocity
        self.swing = np.cross(rate, lever)
        self.sigma = 0.03

    def _residual(self, motion: Motion) -> tuple[Floats, Floats, Floats]:
        rotation = motion.rotation(self.time)
        measured, swing = rotation.apply(self.velocity), rotation.apply(self.swing)
        scale = 1.0 + motion.constants[unknowns.DVL_SCALE]
        return motion.position(self.time, 1) + swing - scale * measured, measured, swing

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        residual, measured, swing = self._residual(motion)
        n = len(self.time)
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], (n, 3))
            runs = [
                motion.position_run(self.time, unit, 1),
                motion.attitude_run(self.time, np.cross(unit, measured - swing)),
                motion.constants_run(n, dvl_scale=-measured[:, axis]),
            ]
            problem.add(residual[:, axis], self.sigma, runs, cauchy=3.0)

    def reestimate(self, motion: Motion) -> None:
        self.sigma = _spread(self._residual(motion)[0], 0.002, 0.3)


class Position:
    """Positions (n, 3) m of base_link at time (n,) s with one sigma: absolute fixes, or somebody else's odometry."""

    def __init__(self, time: Floats, position: Floats, sigma: float) -> None:
        self.time, self.measured, self.sigma = time, position, sigma

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        residual = motion.position(self.time) - self.measured
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], residual.shape)
            problem.add(residual[:, axis], self.sigma, [motion.position_run(self.time, unit)], cauchy=3.0)

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: a bias of all fixes is not seen in their residuals."""


class Calm:
    """A derivative of the position is small, which keeps what no sensor sees from running away. sigma m/s or m/s^2.

    Said once every `spacing` seconds that are farther than that from the times (n,) s at which a sensor measures it.
    """

    def __init__(self, spacing: float, sigma: float, derivative: int, measured: Floats | None = None) -> None:
        self.spacing, self.sigma, self.derivative = spacing, sigma, derivative
        self.measured = np.empty(0) if measured is None else measured

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = motion.instants(self.spacing)
        t = t[far_from(t, self.measured, self.spacing)]
        value = motion.position(t, self.derivative)
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], value.shape)
            problem.add(value[:, axis], self.sigma, [motion.position_run(t, unit, self.derivative)])

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: it is a belief, not a measurement."""


class Gauge:
    """The dive begins at the origin of the map, and the constants are near their nominal values."""

    sigma = 1e-3

    def __init__(self, axes: tuple[int, ...], start: Floats, constants_sigma: Floats) -> None:
        self.axes, self.start, self.constants_sigma = axes, start, constants_sigma

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = np.array([motion.begin])
        position = motion.position(t) - self.start
        for axis in self.axes:
            problem.add(position[:, axis], self.sigma, [motion.position_run(t, _AXES[[axis]])])
        for k, sigma in enumerate(self.constants_sigma):
            value = np.zeros((1, len(self.constants_sigma)))
            value[0, k] = 1.0
            problem.add(motion.constants[[k]], sigma, [Run(np.array([motion.constants_offset]), value)])

    def reestimate(self, motion: Motion) -> None:
        """Nothing to learn."""


class Anchor:
    """Where an earlier window has already put the vehicle: time (n,), position (n, 3) m, correction theta (n, 3) rad."""

    def __init__(self, time: Floats, position: Floats, correction: Floats, sigma: float, angle_sigma: float) -> None:
        self.time, self.measured, self.correction = time, position, correction
        self.sigma, self.angle_sigma = sigma, angle_sigma

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        off = motion.position(self.time) - self.measured
        turned = motion.correction(self.time) - self.correction
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], off.shape)
            problem.add(off[:, axis], self.sigma, [motion.position_run(self.time, unit)])
            problem.add(turned[:, axis], self.angle_sigma, [motion.attitude_run(self.time, unit)])

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: the earlier window is settled."""
