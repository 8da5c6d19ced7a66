"""Every factor's derivatives against finite differences of its residual, for every unknown of the motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garbi_map.register.constants import Constant
from garbi_map.register.factors import (
    GRAVITY,
    Acceleration,
    Anchor,
    AttitudeCorrection,
    BottomTrack,
    Calm,
    Factor,
    Gauge,
    Height,
    Nominal,
    Position,
)
from garbi_map.register.motion import Motion, PriorAttitude
from garbi_map.register.normal_equations import RUN, NormalEquations
from garbi_map.register.sensors import noise_density

END = 3.0
UP = np.array([0.0, 0.0, 1.0])
RANDOM = np.random.default_rng(5)
TIMES = np.sort(RANDOM.uniform(0.2, END - 0.2, 17))
BIASES = [
    Constant("accelerometer_bias", 0.1, "m/s^2", 3),
    Constant("gyro_bias", 0.01, "rad/s", 3),
    Constant("dvl_scale", 0.02, "1"),
    Constant("accelerometer_scale", 0.02, "1"),
]
CLOCKS = [Constant(f"{name}_clock", 0.025, "s") for name in ("imu", "dvl", "pressure")]


class Rows:
    """Takes rows as the least-squares problem does, and keeps them as a dense matrix."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.residuals: list[np.ndarray] = []
        self.matrices: list[np.ndarray] = []
        self.sigmas: list[np.ndarray] = []

    def add(self, residual, sigma, runs, cauchy=None, tail=None) -> None:
        dense = np.zeros((len(residual), self.size))
        for run in runs:
            np.add.at(dense, (np.arange(len(residual))[:, None], run.start[:, None] + np.arange(RUN)), run.value)
        if tail is not None:
            dense[:, tail.columns] += tail.value
        self.residuals.append(residual)
        self.matrices.append(dense)
        self.sigmas.append(np.broadcast_to(sigma, residual.shape))

    @property
    def residual(self) -> np.ndarray:
        return np.concatenate(self.residuals)

    @property
    def matrix(self) -> np.ndarray:
        return np.concatenate(self.matrices)


def some_motion(theta: float, constants: float = 0.0, declared: list[Constant] = BIASES) -> Motion:
    """A motion with a turning prior, random positions, and a correction and constants of the size given."""
    random = np.random.default_rng(2)
    t = np.linspace(0.0, END, 400)
    prior = Rotation.from_euler("ZYX", np.stack([0.8 + 0.4 * t, 0.1 * np.sin(t), 0.2 * np.cos(t)], axis=1))
    motion = Motion(0.0, END, PriorAttitude(t, prior.as_quat()), 0.4, 1.0, declared)
    motion.position_control[:] = random.normal(0.0, 0.3, motion.position_control.shape)
    motion.attitude_control[:] = random.normal(0.0, 1.0, motion.attitude_control.shape) * theta
    motion.constants.value[:] = random.normal(0.0, 1.0, len(motion.constants)) * constants
    return motion


def smooth_motion(theta: float, constants: float, declared: list[Constant]) -> Motion:
    """The same on a path that its spline can follow: a sway of six seconds."""
    motion = some_motion(theta, constants, declared)
    t = np.linspace(0.0, END, 200)
    path = np.stack([0.3 * np.sin(1.1 * t), 0.2 * np.cos(0.9 * t), 0.1 * np.sin(t + 1)], axis=1)
    motion.fit(t, path, motion.rotation(t))
    return motion


def by_differences(motion: Motion, residual: Callable[[], np.ndarray], h: float = 1e-6) -> np.ndarray:
    """d residual / d unknown, (n, size), by central differences."""
    columns = []
    for k in range(motion.size):
        step = np.zeros(motion.size)
        step[k] = h
        motion.step(step)
        after = residual()
        motion.step(-2 * step)
        columns.append((after - residual()) / (2 * h))
        motion.step(step)
    return np.stack(columns, axis=1)


def rows_of(factor: Factor, motion: Motion) -> Rows:
    rows = Rows(motion.size)
    factor.add(rows, motion)  # type: ignore[arg-type]
    return rows


def random_vectors(size: float) -> np.ndarray:
    return np.random.default_rng(3).normal(0.0, size, (len(TIMES), 3))


FACTORS = {
    "acceleration": lambda: Acceleration(TIMES, -GRAVITY + random_vectors(0.5), random_vectors(0.1)),
    "attitude": lambda: AttitudeCorrection(np.array([0.01, 0.01, 0.03]), 1.0, TIMES),
    "attitude without gyro": lambda: AttitudeCorrection(np.array([0.01, 0.01, 0.03]), 1.0, None),
    "height": lambda: Height(TIMES, random_vectors(1.0)[:, 2], np.array([0.3, -0.2, 0.5])),
    "bottom track": lambda: BottomTrack(TIMES, random_vectors(0.2), np.array([-0.4, 0.2, -0.1])),
    "position": lambda: Position(TIMES, random_vectors(1.0), 0.1),
    "anchor": lambda: Anchor(TIMES, random_vectors(1.0), some_motion(0.0).rotation(TIMES), 1e-3, 1e-3),
    "calm velocity": lambda: Calm(0.3, 0.1, derivative=1),
    "calm acceleration": lambda: Calm(0.3, 0.1, derivative=2, measured=TIMES[:5]),
    "gauge": lambda: Gauge((0, 1, 2), np.array([1.0, 2.0, 3.0])),
    "nominal": lambda: Nominal(),
}


@pytest.mark.parametrize("name", FACTORS)
def test_the_derivatives_of_a_factor_are_exact_where_nothing_is_corrected(name):
    """At theta = 0 and nominal constants the rows are the derivative of the residual in every unknown."""
    factor, motion = FACTORS[name](), some_motion(0.0)
    expected = by_differences(motion, lambda: rows_of(factor, motion).residual)
    assert np.abs(expected).max() > 0
    assert rows_of(factor, motion).matrix == pytest.approx(expected, abs=2e-7 * max(np.abs(expected).max(), 1.0))


@pytest.mark.parametrize("name", FACTORS)
def test_the_derivatives_of_a_factor_hold_to_first_order_in_the_correction(name):
    """With one degree of correction, and biases and scale in proportion, what is left out is a few per cent."""
    factor, motion = FACTORS[name](), some_motion(0.01, 0.01)
    expected = by_differences(motion, lambda: rows_of(factor, motion).residual)
    assert rows_of(factor, motion).matrix == pytest.approx(expected, abs=0.03 * np.abs(expected).max())


@pytest.mark.parametrize(("name", "share"), [("acceleration", 0.35), ("height", 0.05), ("bottom track", 0.05)])
def test_the_derivatives_by_the_clocks_are_rates_of_change(name, share):
    """What a sensor says of the motion a moment earlier or later, to a few per cent of its largest change; of an
    acceleration the spline's own change is a step at every knot."""
    factor, motion = FACTORS[name](), smooth_motion(0.003, 0.003, CLOCKS)
    columns = motion.constants_columns
    expected = by_differences(motion, lambda: rows_of(factor, motion).residual, h=1e-5)[:, columns]
    assert np.abs(expected).max() > 0.01
    assert rows_of(factor, motion).matrix[:, columns] == pytest.approx(expected, abs=share * np.abs(expected).max())


def test_a_motion_advances_as_its_path_does():
    """Velocity, acceleration and jerk of the path itself, away from its ends."""
    motion, t = smooth_motion(0.0, 0.0, CLOCKS), np.linspace(0.8, END - 0.8, 50)
    size, rate, phase = np.array([0.3, 0.2, 0.1]), np.array([1.1, 0.9, 1.0]), np.array([0.0, np.pi / 2, 1.0])
    for derivative in range(3):
        order = derivative + 1
        path = size * rate**order * np.sin(rate * t[:, None] + phase + order * np.pi / 2)
        assert motion.advance(t, derivative) == pytest.approx(path, abs=0.03 * np.abs(path).max())


def told_exactly(motion: Motion) -> list[Factor]:
    """An accelerometer, a pressure sensor and a DVL that say what the motion is, to a thousandth."""
    to_body, lever = motion.rotation(TIMES).inv(), np.array([-0.4, 0.2, -0.1])
    force = to_body.apply(motion.position(TIMES, 2) - GRAVITY)
    track = to_body.apply(motion.position(TIMES, 1)) + np.cross(motion.rate(TIMES), lever)
    height = (motion.position(TIMES) + motion.rotation(TIMES).apply(lever))[:, 2]
    factors: list[Factor] = [
        Acceleration(TIMES, force, np.zeros_like(force)), Height(TIMES, height, lever), BottomTrack(TIMES, track, lever)
    ]  # fmt: skip
    for factor in factors:
        factor.sigma = 1e-3
    return factors


@pytest.mark.parametrize(("path", "least"), [(some_motion, 0.1), (smooth_motion, 0.7)])
def test_the_sensors_alone_do_not_tell_a_shift_of_all_clocks(path, least):
    """Only the camera's own sweeps can, however the path trembles; by how much two sensors differ, they tell."""
    motion = path(0.0, 0.0, [*BIASES, *CLOCKS])
    problem = NormalEquations(motion.size)
    start = Gauge((0, 1), motion.position(np.zeros(1))[0])
    barely = Calm(0.1, 1e4, derivative=2)
    for factor in (*told_exactly(motion), AttitudeCorrection(np.full(3, 0.01), 1.0, TIMES), Nominal(), start, barely):
        factor.add(problem, motion)
    covariance = problem.covariance(motion.constants_columns)[-3:, -3:]
    together, differing = np.ones(3) / 3, np.array([1.0, -1.0, 0.0])
    assert np.sqrt(together @ covariance @ together) > 0.95 * CLOCKS[0].sigma / np.sqrt(3)
    assert np.sqrt(differing @ covariance @ differing) < least * CLOCKS[0].sigma


def measured_by_a_true_motion() -> tuple[Motion, Acceleration, BottomTrack, Height, AttitudeCorrection]:
    """What perfect sensors with a bias and a scale say of a motion; arms and levers included."""
    motion = some_motion(0.003)
    motion.constants.value[:] = [0.05, -0.02, 0.03, 0.0, 0.0, 0.0, 0.005, -0.01]
    motion.attitude_control[:] = motion.attitude_control[0]
    inverse = motion.rotation(TIMES).inv()
    arm, rate = random_vectors(0.1), motion.rate(TIMES)
    force = 0.99 * (inverse.apply(motion.position(TIMES, 2) - GRAVITY) + arm)
    force = force + motion.constants.vector("accelerometer_bias")
    lever = np.array([-0.4, 0.2, -0.1])
    velocity = (inverse.apply(motion.position(TIMES, 1)) + np.cross(rate, lever)) * 1.005
    height = (motion.position(TIMES) + motion.rotation(TIMES).apply(lever))[:, 2]
    return (
        motion,
        Acceleration(TIMES, force, arm),
        BottomTrack(TIMES, velocity, lever),
        Height(TIMES, height, lever),
        AttitudeCorrection(np.full(3, 0.1), 1.0, TIMES),
    )


def test_the_residual_of_a_perfect_sensor_is_zero():
    """Gravity, levers, bias and scale are where the sensors' definitions have them."""
    motion, acceleration, bottom_track, height, _ = measured_by_a_true_motion()
    for factor in (acceleration, bottom_track, height):
        assert np.abs(rows_of(factor, motion).residual).max() < 1e-9, type(factor).__name__


def test_a_constant_gyro_bias_is_a_correction_that_grows():
    """theta' = -R b: the rate's residual vanishes for a level vehicle whose correction undoes its bias."""
    motion = Motion(0.0, END, PriorAttitude(np.array([0.0]), np.array([[0.0, 0.0, 0.0, 1.0]])), 0.4, 1.0, BIASES)
    motion.constants.value[motion.constants.place("gyro_bias")] = [0.0, 0.0, 1e-3]
    knots = np.arange(len(motion.attitude_control)) * motion.attitude_spline.spacing
    motion.attitude_control[:, 2] = -1e-3 * knots
    rows = rows_of(AttitudeCorrection(np.full(3, 0.1), 1.0, TIMES), motion)
    rates = np.concatenate(rows.residuals[1::2])
    assert np.abs(rates).max() < 1e-12


def test_the_rate_is_that_of_the_rotation():
    """Prior and correction turn together: the rate is the difference of two attitudes, by what theta leaves out."""
    motion, h = some_motion(0.003, 0.01, CLOCKS), 1e-3
    turned = (motion.rotation(TIMES - h).inv() * motion.rotation(TIMES + h)).as_rotvec() / (2 * h)
    assert motion.rate(TIMES) == pytest.approx(turned, abs=5e-3)


def test_a_velocity_full_of_noise_does_not_draw_the_scale():
    """Noise as large as a slow vehicle's velocity would make the scale a half if it stood with what is measured."""
    random, motion = np.random.default_rng(4), some_motion(0.0)
    t = np.linspace(0.2, END - 0.2, 4000)
    true = motion.rotation(t).inv().apply(motion.position(t, 1))
    noise = random.normal(0.0, np.sqrt((true**2).mean()), true.shape)
    rows = rows_of(BottomTrack(t, true + noise, np.zeros(3)), motion)
    column = rows.matrix[:, motion.constants_columns[motion.constants.place("dvl_scale")]][:, 0]
    assert -(column @ rows.residual) / (column @ column) == pytest.approx(0.0, abs=0.04)


def test_a_force_full_of_noise_does_not_draw_the_scale():
    """Nor does the accelerometer's, whose bias takes up what gravity says of it."""
    random = np.random.default_rng(4)
    declared = [Constant("accelerometer_bias", 0.1, "m/s^2", 3), Constant("accelerometer_scale", 0.02, "1")]
    motion = Motion(0.0, END, PriorAttitude(np.zeros(1), np.array([[0.0, 0.0, 0.0, 1.0]])), 0.4, 1.0, declared)
    motion.position_control[:] = random.normal(0.0, 0.3, motion.position_control.shape)
    t = np.linspace(0.2, END - 0.2, 4000)
    true = motion.position(t, 2)
    noise = random.normal(0.0, true.std(), true.shape)
    rows = rows_of(Acceleration(t, true - GRAVITY + noise, np.zeros((len(t), 3))), motion)
    constants = rows.matrix[:, motion.constants_columns]
    assert np.linalg.lstsq(constants, -rows.residual)[0][3] == pytest.approx(0.0, abs=0.04)


def test_sigmas_are_taken_from_residuals_within_bounds():
    """A sensor twice as noisy says so; one that is perfect is not believed beyond its floor."""
    motion, acceleration, bottom_track, height, _ = measured_by_a_true_motion()
    for factor, floor in ((acceleration, 0.005), (bottom_track, 0.002), (height, 0.001)):
        factor.reestimate(motion)
        assert factor.sigma == floor
    noisy = Height(np.repeat(TIMES, 400), np.repeat(height.height, 400), height.lever)
    noisy.height = noisy.height + np.random.default_rng(0).normal(0.0, 0.03, len(noisy.height))
    noisy.reestimate(motion)
    assert noisy.sigma == pytest.approx(0.03, rel=0.05)


def test_the_noise_of_a_gyro_is_seen_beneath_the_motion():
    """Swaying by degrees per second at 0.3 Hz does not hide a noise of 0.06 degrees per second."""
    random, t = np.random.default_rng(2), np.arange(0.0, 60.0, 0.01)
    sway = 4.0 * np.sin(2.0 * np.pi * 0.3 * t)[:, None] * [1.0, -0.5, 0.3]
    noisy = sway + random.normal(0.0, 0.06, (len(t), 3))
    assert noise_density(t, noisy) == pytest.approx(0.006, rel=0.05)
    assert noise_density(t, sway) < 1e-5


def test_where_a_sensor_measures_nothing_is_presumed():
    """Calm speaks only in the silences: here in the last second of three."""
    motion = some_motion(0.0)
    calm = Calm(0.2, 0.1, derivative=2, measured=np.arange(0.0, 2.0, 0.05))
    assert len(rows_of(calm, motion).residual) // 3 == pytest.approx(5, abs=1)
    assert len(rows_of(Calm(0.2, 0.1, derivative=2), motion).residual) // 3 == pytest.approx(16, abs=1)
