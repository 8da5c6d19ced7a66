"""Compiled rigid-body dynamics of a vehicle in moving water (Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed.,
chapters 6 to 8: relative velocity in an irrotational flow, diagonal added mass, linear and quadratic damping).

One state row, float64: position 0:3 m (map), quaternion 3:7 xyzw (map <- body), velocity 7:10 m/s and rate 10:13 rad/s
(body: x forward, y left, z up), thrust 13:17 N of the four propellers, integral 17:21 of the velocity error.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.log.records import Floats

STATE = 21
HISTORY = 20  # time, position, quaternion, velocity (map), rate (body), acceleration (map), angular acceleration (body)


@njit(cache=True, nogil=True)
def to_map(q: Floats, v: Floats) -> Floats:
    """v turned from body to map by the quaternion q (xyzw)."""
    t = 2.0 * np.cross(q[:3], v)
    return v + q[3] * t + np.cross(q[:3], t)


@njit(cache=True, nogil=True)
def to_body(q: Floats, v: Floats) -> Floats:
    """v turned from map to body by the quaternion q (xyzw)."""
    t = 2.0 * np.cross(v, q[:3])
    return v + q[3] * t + np.cross(t, q[:3])


@njit(cache=True, nogil=True)
def waves(time: float, amplitude: Floats, omega: Floats, phase: Floats) -> tuple[Floats, Floats, Floats]:
    """Sums of sines at a time: value, first and second derivative, each (6,), from amplitude and phase (6, k)."""
    value, first, second = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(6):
        for k in range(len(omega)):
            a = omega[k] * time + phase[i, k]
            value[i] += amplitude[i, k] * np.sin(a)
            first[i] += amplitude[i, k] * omega[k] * np.cos(a)
            second[i] -= amplitude[i, k] * omega[k] ** 2 * np.sin(a)
    return value, first, second


@njit(cache=True, nogil=True)
def thrust_wanted(state: Floats, command: Floats, mass: Floats, arms: Floats, gains: Floats, limit: float) -> Floats:
    """Thrust (4,) N for a command (surge m/s, heave m/s, yaw rad/s, pitch rad/s): proportional-integral on each axis.

    gains (2, 4): 1/s and 1/s^2 of each axis. Propellers: left and right push ahead, fore and aft push up; arms: of the
    horizontal and of the vertical pair, m."""
    axis = np.array([0, 2, 5, 4])
    force = np.empty(4)
    for i in range(4):
        error = command[i] - state[7 + axis[i]]
        force[i] = mass[axis[i]] * (gains[0, i] * error + gains[1, i] * state[17 + i])
    wanted = np.empty(4)
    wanted[0] = 0.5 * (force[0] - force[2] / arms[0])
    wanted[1] = 0.5 * (force[0] + force[2] / arms[0])
    wanted[2] = 0.5 * (force[1] - force[3] / arms[1])
    wanted[3] = 0.5 * (force[1] + force[3] / arms[1])
    return np.minimum(np.maximum(wanted, -limit), limit)


@njit(cache=True, nogil=True)
def derivative(
    state: Floats,
    time: float,
    command: Floats,
    current: Floats,
    mass: Floats,
    linear: Floats,
    quadratic: Floats,
    restoring: float,
    arms: Floats,
    gains: Floats,
    limit: float,
    lag: float,
    amplitude: Floats,
    omega: Floats,
    phase: Floats,
) -> Floats:
    """d state / dt; `current` (3,) m/s map: the slow water; the sines: the waves (3 translations m, 3 moments N m).

    The vehicle is neutrally buoyant: long waves carry it with the water. The slow current acts through drag only."""
    out = np.zeros(STATE)
    q = state[3:7]
    v = state[7:10]
    w = state[10:13]
    value, first, second = waves(time, amplitude, omega, phase)
    water = to_body(q, current + first[:3])
    relative = v - water
    moving = np.empty(6)
    moving[:3] = relative
    moving[3:] = w
    thrust = state[13:17]
    force = -(linear + quadratic * np.abs(moving)) * moving
    force[0] += thrust[0] + thrust[1]
    force[2] += thrust[2] + thrust[3]
    force[3:] += value[3:]
    force[4] += arms[1] * (thrust[3] - thrust[2])
    force[5] += arms[0] * (thrust[1] - thrust[0])
    # Buoyancy above weight rights roll and pitch: a moment along body z-up cross map z-up.
    force[3:] += restoring * np.cross(np.array([0.0, 0.0, 1.0]), to_body(q, np.array([0.0, 0.0, 1.0])))
    momentum = mass[:3] * relative
    force[:3] -= np.cross(w, momentum)
    force[3:] -= np.cross(w, mass[3:] * w)
    out[:3] = to_map(q, v)
    out[3:6] = 0.5 * (q[3] * w + np.cross(q[:3], w))
    out[6] = -0.5 * np.dot(q[:3], w)
    out[7:10] = force[:3] / mass[:3] + to_body(q, second[:3]) - np.cross(w, water)
    out[10:13] = force[3:] / mass[3:]
    wanted = thrust_wanted(state, command, mass, arms, gains, limit)
    out[13:17] = (wanted - thrust) / lag
    axis = np.array([0, 2, 5, 4])
    for i in range(4):
        out[17 + i] = command[i] - state[7 + axis[i]]
    return out


@njit(cache=True, nogil=True)
def advance(state: Floats, begin: int, step: float, currents: Floats, command: Floats, *model) -> tuple[Floats, Floats]:  # type: ignore[no-untyped-def]
    """len(currents) Runge-Kutta steps: the state after them, and one history row (HISTORY) at the start of each.

    begin: number of steps taken before; `model` are the arguments of `derivative` from `mass` on."""
    history = np.empty((len(currents), HISTORY))
    x = state.copy()
    for n in range(len(currents)):
        t = (begin + n) * step
        k1 = derivative(x, t, command, currents[n], *model)
        k2 = derivative(x + 0.5 * step * k1, t + 0.5 * step, command, currents[n], *model)
        k3 = derivative(x + 0.5 * step * k2, t + 0.5 * step, command, currents[n], *model)
        k4 = derivative(x + step * k3, t + step, command, currents[n], *model)
        history[n, 0] = t
        history[n, 1:8] = x[:7]
        history[n, 8:11] = k1[:3]
        history[n, 11:14] = x[10:13]
        history[n, 14:17] = to_map(x[3:7], k1[7:10] + np.cross(x[10:13], x[7:10]))
        history[n, 17:20] = k1[10:13]
        x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        x[3:7] /= np.sqrt(np.dot(x[3:7], x[3:7]))
        x[17:21] = np.minimum(np.maximum(x[17:21], -0.3), 0.3)
    return x, history
