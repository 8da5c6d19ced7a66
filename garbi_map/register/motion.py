"""The unknown motion: splines of position and of a small rotation over a known attitude, and the sensors' constants."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation, Slerp

from garbi_map.register.normal_equations import RUN, Run, spline_run
from garbi_map.register.spline import UniformSpline

Floats = NDArray[np.float64]

ACCELEROMETER_BIAS = slice(0, 3)
GYRO_BIAS = slice(3, 6)
DVL_SCALE = 6


@dataclass(frozen=True)
class PriorAttitude:
    """map <- base_link before correction: quaternion (n, 4) xyzw at time (n,) s; held at both ends."""

    time: Floats
    quaternion: Floats

    @cached_property
    def _slerp(self) -> Slerp:
        return Slerp(self.time, Rotation.from_quat(self.quaternion))

    def at(self, t: Floats) -> Rotation:
        """The attitudes at t (m,)."""
        if len(self.time) == 1:
            return Rotation.from_quat(np.repeat(self.quaternion, len(t), axis=0))
        return self._slerp(np.clip(t, self.time[0], self.time[-1]))


class Motion:
    """p(t) and R(t) = exp(theta(t)) R_prior(t), map <- base_link, over [begin, end] seconds, and twelve constants.

    Unknowns in order: the position's control points, the attitude's, the constants (accelerometer bias m/s^2, gyro bias
    rad/s, DVL scale; the rest unused).
    """

    def __init__(self, begin: float, end: float, prior: PriorAttitude, position_knots: float, attitude_knots: float):
        self.begin, self.end, self.prior = begin, end, prior
        self.position_spline = UniformSpline(begin, end, position_knots)
        self.attitude_spline = UniformSpline(begin, end, attitude_knots)
        self.position_control = np.zeros((self.position_spline.size, 3))
        self.attitude_control = np.zeros((self.attitude_spline.size, 3))
        self.constants = np.zeros(RUN)

    @property
    def attitude_offset(self) -> int:
        """First unknown of the attitude."""
        return self.position_control.size

    @property
    def constants_offset(self) -> int:
        """First unknown of the constants."""
        return self.position_control.size + self.attitude_control.size

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.constants_offset + RUN

    def instants(self, step: float) -> Floats:
        """Evenly spaced times (n,) s from begin to end, both among them and at most `step` apart."""
        return np.linspace(self.begin, self.end, int(np.ceil((self.end - self.begin) / step)) + 1)

    def position(self, t: Floats, derivative: int = 0) -> Floats:
        """Position (n, 3) m, velocity or acceleration at t (n,)."""
        return self.position_spline.value(self.position_control, t, derivative)

    def correction(self, t: Floats, derivative: int = 0) -> Floats:
        """theta (n, 3) rad, or its rate, at t (n,)."""
        return self.attitude_spline.value(self.attitude_control, t, derivative)

    def rotation(self, t: Floats) -> Rotation:
        """map <- base_link at t (n,)."""
        return Rotation.from_rotvec(self.correction(t)) * self.prior.at(t)

    def position_run(self, t: Floats, axes: Floats, derivative: int = 0) -> Run:
        """How axes . p(t) (or a derivative of p) depends on the unknowns; axes (n, 3)."""
        return spline_run(*self.position_spline.basis(t, derivative), axes, 0)

    def attitude_run(self, t: Floats, axes: Floats, derivative: int = 0) -> Run:
        """How axes . theta(t) (or its rate) depends on the unknowns; axes (n, 3)."""
        return spline_run(*self.attitude_spline.basis(t, derivative), axes, self.attitude_offset)

    def constants_run(self, n: int, **values: Floats) -> Run:
        """How n rows depend on the constants named as in this module, lower case: columns (n,) or (n, 3)."""
        run = np.zeros((n, RUN))
        places: dict[str, slice | int] = {
            "accelerometer_bias": ACCELEROMETER_BIAS,
            "gyro_bias": GYRO_BIAS,
            "dvl_scale": DVL_SCALE,
        }
        for name, value in values.items():
            run[:, places[name]] = value
        return Run(np.full(n, self.constants_offset, np.int64), run)

    def step(self, x: Floats) -> None:
        """Moves the unknowns by x (size,)."""
        self.position_control += x[: self.attitude_offset].reshape(-1, 3)
        self.attitude_control += x[self.attitude_offset : self.constants_offset].reshape(-1, 3)
        self.constants += x[self.constants_offset :]

    def fit(self, t: Floats, position: Floats, rotation: Rotation) -> None:
        """Takes on the motion given by position (n, 3) and rotation at t (n,), as far as the splines can follow.

        Control points that the times hardly touch, as those beyond the last, continue straight.
        """
        theta = (rotation * self.prior.at(t).inv()).as_rotvec()
        for spline, control, value in (
            (self.position_spline, self.position_control, position),
            (self.attitude_spline, self.attitude_control, theta),
        ):
            first, weights = spline.basis(t)
            rows = np.repeat(np.arange(len(t)), 4)
            columns = (first[:, None] + np.arange(4)).ravel()
            basis = csr_array((weights.ravel(), (rows, columns)), shape=(len(t), spline.size))
            bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(spline.size - 2, spline.size))
            normal = (basis.T @ basis + 1e-6 * bend.T @ bend + 1e-12 * eye_array(spline.size)).tocsc()
            control[:] = spsolve(normal, basis.T @ value).reshape(control.shape)
