"""Splines of the register room, and the motion made of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from garbi_map.register.motion import Motion, PriorAttitude
from garbi_map.register.spline import UniformSpline

SPANS = st.tuples(st.floats(-100, 100), st.floats(0.0, 40.0), st.floats(0.05, 3.0))
LEVEL = PriorAttitude(np.array([0.0]), np.array([[0.0, 0.0, 0.0, 1.0]]))


@settings(deadline=None, max_examples=50)
@given(SPANS)
def test_the_weights_of_a_value_sum_to_one_everywhere(span):
    """Partition of unity, inside, at the ends and beyond them; no weight is negative."""
    begin, length, spacing = span
    spline = UniformSpline(begin, begin + length, spacing)
    first, weights = spline.basis(np.linspace(begin - 1.0, begin + length + 1.0, 97))
    assert weights.sum(axis=1) == pytest.approx(1.0, abs=1e-12)
    assert weights.min() >= -1e-12
    assert first.min() >= 0 and first.max() + 3 < spline.size


@settings(deadline=None, max_examples=30)
@given(SPANS.filter(lambda span: span[1] > span[2]), st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_derivatives_are_those_of_finite_differences(span, order, seed):
    """The first derivative is the slope of the value, the second that of the first."""
    begin, length, spacing = span
    spline = UniformSpline(begin, begin + length, spacing)
    random = np.random.default_rng(seed)
    control = random.normal(0.0, 1.0, (spline.size, 2))
    h = 1e-5 * spacing
    t = random.uniform(begin + 2 * h, begin + length - 2 * h, 50)
    difference = (spline.value(control, t + h, order - 1) - spline.value(control, t - h, order - 1)) / (2 * h)
    assert spline.value(control, t, order) == pytest.approx(difference, abs=2e-3 / spacing**order)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_a_cubic_is_reproduced(order):
    """Control points fitted to a cubic give the cubic and its derivatives exactly."""
    spline = UniformSpline(2.0, 9.0, 0.7)
    t = np.linspace(2.0, 9.0, 400)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.3, 0.05])
    first, weights = spline.basis(t)
    basis = np.zeros((len(t), spline.size))
    np.put_along_axis(basis, first[:, None] + np.arange(4), weights, axis=1)
    control = np.linalg.lstsq(basis, cubic(t), rcond=None)[0][:, None]
    assert spline.value(control, t[:-1], order)[:, 0] == pytest.approx(
        cubic.deriv(order)(t[:-1]), abs=1e-6 if order == 3 else 1e-7
    )


def test_a_fourth_derivative_is_refused():
    """A cubic has three; the third is constant between two knots."""
    with pytest.raises(ValueError, match="derivative 4"):
        UniformSpline(0.0, 1.0, 0.1).basis(np.zeros(1), 4)


@pytest.mark.parametrize("end", [10.0, 10.01, 10.15])
def test_a_motion_takes_on_a_path_up_to_its_last_instant(end):
    """Wherever the last knot falls, position and attitude are those that were given, 12 m below the origin."""
    motion = Motion(0.0, end, LEVEL, 0.2, 1.0)
    t = np.append(np.arange(0.0, end, 0.02), end)
    position = np.stack([0.3 * np.sin(0.5 * t), 0.1 * t, -12.0 + 0.04 * np.sin(1.5 * t)], axis=1)
    rotation = Rotation.from_rotvec(np.stack([0.02 * np.sin(0.4 * t), 0.01 * np.cos(0.3 * t), 0.002 * t], axis=1))
    motion.fit(t, position, rotation)
    assert motion.position(t) == pytest.approx(position, abs=2e-4)
    assert (motion.rotation(t) * rotation.inv()).magnitude().max() < 2e-4
    acceleration = np.gradient(np.gradient(position, t[1], axis=0), t[1], axis=0)
    assert np.abs(motion.position(t[:-3], 2) - acceleration[:-3]).max() < 0.05


def test_the_attitude_is_the_correction_after_the_prior():
    """R = exp(theta) R_prior: theta is a rotation about the map's axes."""
    turning = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    motion = Motion(0.0, 2.0, PriorAttitude(np.array([0.0, 2.0]), turning.as_quat()), 0.2, 1.0)
    motion.attitude_control[:] = [0.1, 0.0, 0.0]
    expected = Rotation.from_euler("x", 0.1) * Rotation.from_euler("z", 0.5)
    assert (motion.rotation(np.array([1.0]))[0] * expected.inv()).magnitude() < 1e-9
