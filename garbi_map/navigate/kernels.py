"""Compiled loops of the navigate room."""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.log.records import Floats


@njit(cache=True, nogil=True)
def _exp(w: Floats) -> Floats:
    """Rotation vector (3,) to quaternion xyzw (4,)."""
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    out = np.empty(4)
    if angle2 < 1e-8:  # Taylor, where the sine's quotient loses digits
        scale = 0.5 - angle2 / 48.0
        out[3] = 1.0 - angle2 / 8.0
    else:
        angle = np.sqrt(angle2)
        scale = np.sin(0.5 * angle) / angle
        out[3] = np.cos(0.5 * angle)
    out[:3] = scale * w
    return out


@njit(cache=True, nogil=True)
def _product(a: Floats, b: Floats) -> Floats:
    """Hamilton product of two quaternions xyzw, normalised."""
    out = np.empty(4)
    out[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    out[1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0]
    out[2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3]
    out[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
    return out / np.sqrt((out * out).sum())


@njit(cache=True, nogil=True)
def matrix(q: Floats) -> Floats:
    """Quaternion xyzw (4,) to rotation matrix (3, 3)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@njit(cache=True, nogil=True)
def cross_matrix(w: Floats) -> Floats:
    """The matrix (3, 3) whose product with a vector is the cross product w x vector."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@njit(cache=True, nogil=True)
def turn(rotation_vector: Floats, quaternion: Floats) -> Floats:
    """exp(rotation_vector) * quaternion, xyzw: an attitude turned by a small rotation given in the outer frame."""
    return _product(_exp(rotation_vector), quaternion)


@njit(cache=True, nogil=True)
def difference(measured: Floats, nominal: Floats) -> Floats:
    """Rotation vector (3,) of measured * nominal^-1, in the outer frame of both."""
    back = nominal.copy()
    back[:3] = -back[:3]
    error = _product(measured, back)
    if error[3] < 0.0:
        error = -error
    sine = np.sqrt((error[:3] * error[:3]).sum())
    if sine < 1e-8:
        return 2.0 * error[:3]
    return error[:3] * (2.0 * np.arctan2(sine, error[3]) / sine)


@njit(cache=True, nogil=True)
def integrate_rates(seconds: Floats, rate: Floats, bias: Floats) -> Floats:
    """Attitudes (n, 4) xyzw, first one the identity, of body rates (n, 3) rad/s less bias (n, 3), trapezoidal."""
    out = np.empty((len(seconds), 4))
    out[0] = np.array([0.0, 0.0, 0.0, 1.0])
    for i in range(1, len(seconds)):
        mean = 0.5 * (rate[i - 1] - bias[i - 1] + rate[i] - bias[i])
        out[i] = _product(out[i - 1], _exp(mean * (seconds[i] - seconds[i - 1])))
    return out


@njit(cache=True, nogil=True)
def propagate(
    first: int,
    last: int,
    seconds: Floats,
    rate: Floats,
    force: Floats,
    rate_known: np.ndarray,
    force_known: np.ndarray,
    gyro_bias: Floats,
    accelerometer_bias: Floats,
    gravity: float,
    position: Floats,
    velocity: Floats,
    quaternion: Floats,
) -> tuple[Floats, float, float]:
    """Strapdown integration from sample `first` to `last`, trapezoidal, written into rows first+1..last of the last
    three arguments; an interval without gyro keeps its attitude, one without accelerometer its velocity.

    Gives the Jacobian (9, 15) of (position, velocity, attitude) error at `last` with respect to (position, velocity,
    attitude, gyro bias, accelerometer bias) error at `first`, all rotations in the map frame (Solà, Quaternion
    kinematics for the error-state Kalman filter, 2017, global angular error), and the seconds of the interval in which
    the gyro and the accelerometer were missing.
    """
    jacobian = np.zeros((9, 15))
    for axis in range(9):
        jacobian[axis, axis] = 1.0
    no_rate = 0.0
    no_force = 0.0
    for i in range(first, last):
        dt = seconds[i + 1] - seconds[i]
        before = matrix(quaternion[i])
        if rate_known[i]:
            step = (0.5 * (rate[i] + rate[i + 1]) - gyro_bias) * dt
            quaternion[i + 1] = _product(quaternion[i], _exp(step))
        else:
            quaternion[i + 1] = quaternion[i]
            no_rate += dt
        after = matrix(quaternion[i + 1])
        if force_known[i]:
            start = before @ (force[i] - accelerometer_bias)
            end = after @ (force[i + 1] - accelerometer_bias)
            tilt = -cross_matrix(0.5 * (start + end))
            mean = 0.5 * (before + after)
            start[2] -= gravity
            end[2] -= gravity
            velocity[i + 1] = velocity[i] + 0.5 * (start + end) * dt
            position[i + 1] = position[i] + velocity[i] * dt + (2.0 * start + end) * (dt * dt / 6.0)
            push = tilt @ jacobian[6:9]
            push[:, 12:15] -= mean
        else:
            velocity[i + 1] = velocity[i]
            position[i + 1] = position[i] + velocity[i] * dt
            push = np.zeros((3, 15))
            no_force += dt
        jacobian[0:3] += jacobian[3:6] * dt + push * (0.5 * dt * dt)
        jacobian[3:6] += push * dt
        if rate_known[i]:
            jacobian[6:9, 9:12] -= 0.5 * (before + after) * dt
    return jacobian, no_rate, no_force


@njit(cache=True, nogil=True)
def place_points(points: Floats, profile: np.ndarray, rotation: Floats, translation: Floats) -> Floats:
    """Points (n, 3) moved by the pose of their profile: rotation (m, 3, 3), translation (m, 3)."""
    out = np.empty_like(points)
    for i in range(len(points)):
        k = profile[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for axis in range(3):
            row = rotation[k, axis]
            out[i, axis] = row[0] * x + row[1] * y + row[2] * z + translation[k, axis]
    return out
