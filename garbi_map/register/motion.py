"""The unknown motion: splines of position and of a small rotation over a known attitude, and constants by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation, Slerp

from garbi_map.register.constants import Constant, Constants
from garbi_map.register.normal_equations import Run, Tail, spline_run
from garbi_map.register.spline import UniformSpline

Floats = NDArray[np.float64]

_RATE_STEP = 0.02
"""s to either side, over which the prior attitude's rate is taken: shorter than any vehicle's sway."""


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

    @cached_property
    def _rates(self) -> tuple[Floats, Floats, Floats]:
        """Times (k,), and there the rates (k, 3) rad/s in base_link and in map axes."""
        time = np.unique(np.concatenate([self.time, [self.time[0] - _RATE_STEP, self.time[-1] + _RATE_STEP]]))
        before, after = self.at(time - _RATE_STEP), self.at(time + _RATE_STEP)
        turn = (after * before.inv()).as_rotvec() / (2.0 * _RATE_STEP)
        return time, self.at(time).inv().apply(turn), turn

    def rate(self, t: Floats) -> Floats:
        """How fast the vehicle turns (m, 3) rad/s, base_link axes, at t (m,)."""
        time, body, _ = self._rates
        return np.stack([np.interp(t, time, column) for column in body.T], axis=1)

    def turning(self, t: Floats) -> Floats:
        """The same in map axes."""
        time, _, turn = self._rates
        return np.stack([np.interp(t, time, column) for column in turn.T], axis=1)


class Motion:
    """p(t) and R(t) = exp(theta(t)) R_prior(t + c), map <- base_link, over [begin, end] seconds, and constants.

    c is the constant `imu_clock`, by which the stamps of the prior attitude are late. Unknowns in order: the position's
    control points, the attitude's, the constants as they are declared.
    """

    def __init__(
        self,
        begin: float,
        end: float,
        prior: PriorAttitude,
        position_knots: float,
        attitude_knots: float,
        constants: Sequence[Constant] = (),
    ) -> None:
        self.begin, self.end, self.prior = begin, end, prior
        self.position_spline = UniformSpline(begin, end, position_knots)
        self.attitude_spline = UniformSpline(begin, end, attitude_knots)
        self.position_control = np.zeros((self.position_spline.size, 3))
        self.attitude_control = np.zeros((self.attitude_spline.size, 3))
        self.constants = Constants(constants)
        self._advance: Floats | None = None

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
        return self.constants_offset + len(self.constants)

    @property
    def order(self) -> NDArray[np.int64]:
        """The unknowns (size,) as they follow each other in time, the constants, which last for ever, at the end."""
        time = np.concatenate(
            [(np.arange(one.size) - 1) * one.spacing for one in (self.position_spline, self.attitude_spline)]
        )
        return np.r_[np.argsort(np.repeat(time, 3), kind="stable"), self.constants_columns]

    @property
    def constants_columns(self) -> NDArray[np.int64]:
        """The unknowns that are constants."""
        return np.arange(self.constants_offset, self.size)

    def instants(self, step: float) -> Floats:
        """Evenly spaced times (n,) s from begin to end, both among them and at most `step` apart."""
        return np.linspace(self.begin, self.end, int(np.ceil((self.end - self.begin) / step)) + 1)

    def position(self, t: Floats, derivative: int = 0) -> Floats:
        """Position (n, 3) m, velocity, acceleration or jerk at t (n,)."""
        return self.position_spline.value(self.position_control, t, derivative)

    def advance(self, t: Floats, derivative: int = 0) -> Floats:
        """How position (n, 3), velocity or acceleration at t (n,) change per second by which all of the motion is earlier.

        Not the next derivative of the position, but the change of its control points that comes nearest to one: a shift of
        all clocks that the spline could not follow would seem to be told by the sensors alone, to half a millisecond.
        """
        if self._advance is None:
            knots = self.instants(self.position_spline.spacing / 4)
            self._advance = _fitted(self.position_spline, knots, self.position(knots, 1))
        return self.position_spline.value(self._advance, t, derivative)

    def correction(self, t: Floats, derivative: int = 0) -> Floats:
        """theta (n, 3) rad, or its rate, at t (n,)."""
        return self.attitude_spline.value(self.attitude_control, t, derivative)

    def prior_attitude(self, t: Floats) -> Rotation:
        """R_prior at t (n,), its clock corrected."""
        return self.prior.at(t + self.constants.number("imu_clock"))

    def rotation(self, t: Floats) -> Rotation:
        """map <- base_link at t (n,)."""
        return Rotation.from_rotvec(self.correction(t)) * self.prior_attitude(t)

    def rate(self, t: Floats) -> Floats:
        """The body's rates (n, 3) rad/s at t (n,), base_link axes, to first order in theta."""
        prior = self.prior.rate(t + self.constants.number("imu_clock"))
        return prior + self.rotation(t).inv().apply(self.correction(t, 1))

    def rate_change(self, t: Floats) -> Floats:
        """How the prior's rates (n, 3) change at t (n,), rad/s^2, base_link axes."""
        t = t + self.constants.number("imu_clock")
        return (self.prior.rate(t + _RATE_STEP) - self.prior.rate(t - _RATE_STEP)) / (2.0 * _RATE_STEP)

    def rows(self, t: Floats) -> Rows:
        """Rows of the problem about the motion at t (n,), which do not depend on anything yet."""
        return Rows(self, t)

    def step(self, x: Floats) -> None:
        """Moves the unknowns by x (size,)."""
        self.position_control += x[: self.attitude_offset].reshape(-1, 3)
        self.attitude_control += x[self.attitude_offset : self.constants_offset].reshape(-1, 3)
        self.constants.value += x[self.constants_offset :]
        self._advance = None

    def fit(self, t: Floats, position: Floats, rotation: Rotation) -> None:
        """Takes on the motion given by position (n, 3) and rotation at t (n,), as far as the splines can follow.

        Control points that the times hardly touch, as those beyond the last, continue straight.
        """
        theta = (rotation * self.prior_attitude(t).inv()).as_rotvec()
        self.position_control[:] = _fitted(self.position_spline, t, position)
        self.attitude_control[:] = _fitted(self.attitude_spline, t, theta)
        self._advance = None


def _fitted(spline: UniformSpline, t: Floats, value: Floats) -> Floats:
    """Control points of the spline that is nearest to value (n, 3) at t (n,)."""
    first, weights = spline.basis(t)
    rows = np.repeat(np.arange(len(t)), 4)
    columns = (first[:, None] + np.arange(4)).ravel()
    basis = csr_array((weights.ravel(), (rows, columns)), shape=(len(t), spline.size))
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(spline.size - 2, spline.size))
    normal = (basis.T @ basis + 1e-6 * bend.T @ bend + 1e-12 * eye_array(spline.size)).tocsc()
    return np.asarray(spsolve(normal, basis.T @ value)).reshape(spline.size, 3)


class Rows:
    """How n rows depend on the unknowns of a motion at n times: `runs` and `tail` of NormalEquations.add."""

    def __init__(self, motion: Motion, t: Floats) -> None:
        self._motion, self._t = motion, t
        self._tail = np.zeros((len(t), len(motion.constants)))
        self.runs: list[Run] = []

    def __add__(self, other: Rows) -> Rows:
        """Rows that depend on what either does, as those of a difference between two moments."""
        both = Rows(self._motion, self._t)
        both.runs, both._tail = self.runs + other.runs, self._tail + other._tail
        return both

    def part(self, which: NDArray) -> Rows:
        """Those of an index or a mask."""
        few = Rows(self._motion, self._t[which])
        few.runs = [Run(run.start[which], run.value[which]) for run in self.runs]
        few._tail = self._tail[which]
        return few

    @property
    def tail(self) -> Tail:
        """What they have to do with the constants."""
        touched = self._tail.any(axis=0)
        return Tail(self._motion.constants_columns[touched], self._tail[:, touched])

    def position(self, axes: Floats, derivative: int = 0) -> Rows:
        """Adds axes . p(t), axes (n, 3), or a derivative of p."""
        self.runs.append(spline_run(*self._motion.position_spline.basis(self._t, derivative), axes, 0))
        return self

    def correction(self, axes: Floats, derivative: int = 0) -> Rows:
        """Adds axes . theta(t), or its rate."""
        basis = self._motion.attitude_spline.basis(self._t, derivative)
        self.runs.append(spline_run(*basis, axes, self._motion.attitude_offset))
        return self

    def rotation(self, axes: Floats) -> Rows:
        """Adds what changes by axes . r where R(t) turns by a small r in map axes: through theta and its clock."""
        self.correction(axes)
        if "imu_clock" in self._motion.constants:
            turning = self._motion.prior.turning(self._t + self._motion.constants.number("imu_clock"))
            self.constant("imu_clock", np.einsum("nk,nk->n", axes, turning))
        return self

    def constant(self, name: str, value: Floats) -> Rows:
        """Adds value (n,) or (n, width) times a constant; nothing where it is not among the unknowns."""
        if name in self._motion.constants:
            place = self._motion.constants.place(name)
            self._tail[:, place] += value.reshape(len(self._t), -1)
        return self
