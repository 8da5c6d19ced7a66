"""What each sensor says about the motion, as rows of the least-squares problem.

Each factor holds its own 1 sigma and can re-estimate it from its residuals (variance components, Foerstner 1979), because
the covariances in messages may lie.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations, Tail

Floats = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, -9.80665])
_AXES = np.eye(3)
ASSUMED_RATE_NOISE = np.deg2rad(0.05)
"""rad/s per root Hz, of an attitude of whose gyro nothing is known."""
_UNKNOWN_TURNING = np.deg2rad(4.0)
"""Rate, rad/s, at which a vehicle turns of which no sensor tells."""
_UNKNOWN_SWING = np.deg2rad(6.0)
"""rad/s^2 by which that rate changes."""
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
    """(1 + s) (p'' - g + (R l)'') = R (f - b): the accelerometer, averaged over short bins, with an unknown scale.

    The scale stands with the motion, as in BottomTrack: on the noisy forces it would draw the whole map together, half a per
    cent in a gentle swell.

    time (n,) s by the clock `imu_clock`, force (n, 3) m/s^2 in base_link axes, arm (n, 3) m/s^2: the acceleration of the
    sensor about base_link's origin, in base_link axes.
    """

    def __init__(self, time: Floats, force: Floats, arm: Floats) -> None:
        self.time, self.force, self.arm = time, force, arm
        self.sigma = 0.03

    def _residual(self, motion: Motion, t: Floats) -> tuple[Floats, Floats, Rotation]:
        """(n, 3), what the motion makes of it before its scale (n, 3), and the attitude."""
        rotation = motion.rotation(t)
        made = motion.position(t, 2) - GRAVITY + rotation.apply(self.arm)
        felt = rotation.apply(self.force - motion.constants.vector("accelerometer_bias"))
        return self._gain(motion) * made - felt, made, rotation

    def _gain(self, motion: Motion) -> float:
        return 1.0 + motion.constants.number("accelerometer_scale")

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = self.time - motion.constants.number("imu_clock")
        residual, made, rotation = self._residual(motion, t)
        gain = self._gain(motion)
        matrix = rotation.as_matrix()
        force = rotation.apply(self.force - gain * self.arm)
        advance = motion.advance(t, 2) if "imu_clock" in motion.constants else np.zeros_like(residual)
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], (len(t), 3))
            rows = motion.rows(t).position(gain * unit, 2)
            # force and prior attitude share their clock: a change of it moves neither against the other
            rows.correction(np.cross(unit, force)).constant("imu_clock", -gain * advance[:, axis])
            rows.constant("accelerometer_bias", matrix[:, axis])
            rows.constant("accelerometer_scale", made[:, axis])
            problem.add(residual[:, axis], self.sigma, rows.runs, 4.0, rows.tail)

    def reestimate(self, motion: Motion) -> None:
        t = self.time - motion.constants.number("imu_clock")
        self.sigma = _spread(self._residual(motion, t)[0], 0.005, 0.5)


class AttitudeCorrection:
    """The correction theta is small and, but for the gyro's bias, changes no faster than the gyro's noise lets it.

    magnitude (3,) rad: 1 sigma of the prior attitude about each map axis; memory (3,) s, for how long an error of it
    lasts, for ever where it is None. gyro (n,) s are the times at which the prior attitude is measured, noise the density
    of its rate's noise, rad/s per root Hz. Away from them, as everywhere where gyro is None, the vehicle turns as no
    sensor tells.
    """

    def __init__(
        self,
        magnitude: Floats,
        spacing: float,
        gyro: Floats | None,
        noise: float = ASSUMED_RATE_NOISE,
        memory: Floats | None = None,
    ) -> None:
        self.magnitude, self.spacing, self.gyro = magnitude, spacing, gyro
        self.memory = np.full(3, np.inf) if memory is None else memory
        # white noise averaged over the time between two rows
        self.sigma = _UNKNOWN_TURNING if gyro is None else noise / np.sqrt(spacing / 2.0)

    def _times(self, motion: Motion) -> Floats:
        # a cubic has four coefficients however short the dive is
        count = max(int(np.ceil(2.0 * (motion.end - motion.begin) / self.spacing)), 4)
        return np.linspace(motion.begin, motion.end, count + 1)

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = self._times(motion)
        n = len(t)
        theta = motion.correction(t)
        matrix = motion.rotation(t).as_matrix()
        rate = motion.correction(t, 1) + matrix @ motion.constants.vector("gyro_bias")
        sigma = np.full(n, _UNKNOWN_TURNING)
        sigma[self._told(t)] = self.sigma
        # an error that lasts is one error, not one for each time: the rows share their information
        length = motion.end - motion.begin
        shared = np.sqrt(np.maximum(np.minimum(self.memory, length) * n / length, 1.0))
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], (n, 3))
            problem.add(theta[:, axis], self.magnitude[axis] * shared[axis], motion.rows(t).correction(unit).runs)
            rows = motion.rows(t).correction(unit, 1).constant("gyro_bias", matrix[:, axis])
            problem.add(rate[:, axis], sigma, rows.runs, 4.0, rows.tail)
        silent = t[~self._told(t)]
        swing = motion.correction(silent, 2)
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], swing.shape)
            problem.add(swing[:, axis], _UNKNOWN_SWING, motion.rows(silent).correction(unit, 2).runs)

    def _told(self, t: Floats) -> NDArray[np.bool_]:
        """Where (n,) the gyro speaks."""
        if self.gyro is None:
            return np.zeros(len(t), bool)
        return ~far_from(t, self.gyro, _SILENCE)

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: what is left of few residuals and as many unknowns says nothing of the noise."""


class Height:
    """Heights of a point of the vehicle: pressure.

    time (n,) s by the clock `pressure_clock`, height (n,) m in map, lever (3,) m in base_link.
    """

    def __init__(self, time: Floats, height: Floats, lever: Floats) -> None:
        self.time, self.height, self.lever = time, height, lever
        self.sigma = 0.02

    def _residual(self, motion: Motion, t: Floats) -> tuple[Floats, Floats]:
        arm = motion.rotation(t).apply(self.lever)
        return motion.position(t)[:, 2] + arm[:, 2] - self.height, arm

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = self.time - motion.constants.number("pressure_clock")
        residual, arm = self._residual(motion, t)
        unit = np.broadcast_to(_AXES[2], arm.shape)
        rows = motion.rows(t).position(unit).rotation(np.cross(arm, unit))
        if "pressure_clock" in motion.constants:
            swing = motion.rotation(t).apply(np.cross(motion.rate(t), self.lever))
            rows.constant("pressure_clock", -(motion.advance(t) + swing)[:, 2])
        problem.add(residual, self.sigma, rows.runs, 3.0, rows.tail)

    def reestimate(self, motion: Motion) -> None:
        t = self.time - motion.constants.number("pressure_clock")
        self.sigma = _spread(self._residual(motion, t)[0], 0.001, 0.2)


class BottomTrack:
    """DVL velocities with an unknown scale: v = (1 + s) (R' p' + w x l), in base_link axes.

    The scale stands with the motion: on the noisy velocities it would be drawn toward what makes them small (regression
    dilution: Fuller, Measurement Error Models, 1987), by a per cent where a vehicle is slow. The rates w are the motion's
    own, so that the lever counts without a gyro too.

    time (n,) s by the clock `dvl_clock`, velocity (n, 3) m/s, lever (3,) m, both in base_link axes.
    """

    def __init__(self, time: Floats, velocity: Floats, lever: Floats) -> None:
        self.time, self.velocity, self.lever = time, velocity, lever
        self.sigma = 0.03

    def _predicted(self, motion: Motion, t: Floats) -> Floats:
        """R' p' + w x l (n, 3)."""
        return motion.rotation(t).inv().apply(motion.position(t, 1)) + np.cross(motion.rate(t), self.lever)

    def _residual(self, motion: Motion, predicted: Floats) -> Floats:
        return self.velocity - (1.0 + motion.constants.number("dvl_scale")) * predicted

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = self.time - motion.constants.number("dvl_clock")
        predicted = self._predicted(motion, t)
        residual = self._residual(motion, predicted)
        rotation, velocity = motion.rotation(t), motion.position(t, 1)
        change = turning = np.zeros_like(predicted)
        if "dvl_clock" in motion.constants:
            to_body = rotation.inv()
            turning = np.cross(motion.rate_change(t), self.lever)
            change = to_body.apply(motion.advance(t, 1)) - np.cross(motion.rate(t), to_body.apply(velocity)) + turning
        matrix = rotation.as_matrix()
        gain = 1.0 + motion.constants.number("dvl_scale")
        for axis in range(3):
            unit = matrix[:, :, axis]
            swing = np.einsum("nij,j->ni", matrix, np.cross(self.lever, _AXES[axis]))
            rows = motion.rows(t).position(-gain * unit, 1)
            rows.rotation(gain * np.cross(velocity, unit)).correction(-gain * swing, 1)
            rows.constant("dvl_scale", -predicted[:, axis]).constant("dvl_clock", gain * change[:, axis])
            rows.constant("imu_clock", -gain * turning[:, axis])
            problem.add(residual[:, axis], self.sigma, rows.runs, 3.0, rows.tail)

    def reestimate(self, motion: Motion) -> None:
        t = self.time - motion.constants.number("dvl_clock")
        self.sigma = _spread(self._residual(motion, self._predicted(motion, t)), 0.002, 0.3)


class Position:
    """Positions (n, 3) m of base_link at time (n,) s with one sigma: absolute fixes, or somebody else's odometry."""

    def __init__(self, time: Floats, position: Floats, sigma: float) -> None:
        self.time, self.measured, self.sigma = time, position, sigma

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        residual = motion.position(self.time) - self.measured
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], residual.shape)
            problem.add(residual[:, axis], self.sigma, motion.rows(self.time).position(unit).runs, cauchy=3.0)

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
            problem.add(value[:, axis], self.sigma, motion.rows(t).position(unit, self.derivative).runs)

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: it is a belief, not a measurement."""


class Gauge:
    """The dive begins at `start` (3,) in some axes of the map."""

    sigma = 1e-3

    def __init__(self, axes: tuple[int, ...], start: Floats) -> None:
        self.axes, self.start = axes, start

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        t = np.array([motion.begin])
        position = motion.position(t) - self.start
        for axis in self.axes:
            problem.add(position[:, axis], self.sigma, motion.rows(t).position(_AXES[[axis]]).runs)

    def reestimate(self, motion: Motion) -> None:
        """Nothing to learn."""


class Nominal:
    """The constants are as near to zero as they were declared."""

    sigma = 1.0

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        constants = motion.constants
        problem.add(constants.value, constants.sigma, [], tail=Tail(motion.constants_columns, np.eye(len(constants))))

    def reestimate(self, motion: Motion) -> None:
        """Nothing to learn."""


class Patience:
    """Constants that are to wait stay as they are."""

    sigma = 1e-3

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        waiting = motion.constants.patient
        columns, sigma = motion.constants_columns[waiting], self.sigma * motion.constants.sigma[waiting]
        problem.add(np.zeros(len(waiting)), sigma, [], tail=Tail(columns, np.eye(len(waiting))))

    def reestimate(self, motion: Motion) -> None:
        """Nothing to learn."""


class Anchor:
    """Where an earlier window has already put the vehicle: time (n,), position (n, 3) m, rotation map <- base_link."""

    def __init__(self, time: Floats, position: Floats, rotation: Rotation, sigma: float, angle_sigma: float) -> None:
        self.time, self.measured, self.rotation = time, position, rotation
        self.sigma, self.angle_sigma = sigma, angle_sigma

    def add(self, problem: NormalEquations, motion: Motion) -> None:
        off = motion.position(self.time) - self.measured
        turned = (motion.rotation(self.time) * self.rotation.inv()).as_rotvec()
        for axis in range(3):
            unit = np.broadcast_to(_AXES[axis], off.shape)
            problem.add(off[:, axis], self.sigma, motion.rows(self.time).position(unit).runs)
            rows = motion.rows(self.time).rotation(unit)
            problem.add(turned[:, axis], self.angle_sigma, rows.runs, tail=rows.tail)

    def reestimate(self, motion: Motion) -> None:
        """Keeps its sigma: the earlier window is settled."""
