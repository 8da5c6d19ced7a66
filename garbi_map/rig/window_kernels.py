"""Compiled geometry of a sheet that leaves its housing through a window, without tables.

A point in the water is lit by the one direction q in which the apex must shine to reach it, and it lies on the sheet
where normal . q = 0: the sheet itself stays a plane inside the housing. Seen from the apex, a flat window is a camera's
port; a cylinder about the axis keeps a ray in its half plane through the axis, and is a flat window there whose
normal is that half plane's radius.

window    (8,)    kind (0 flat, 1 turning, 2 cylinder), normal (3), distance, thickness, index_glass, index_water;
                  (0,) without a window. The other parameters as in kernels.py.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from garbi_map.log.records import Floats
from garbi_map.rig.kernels import _dot, _normal, _ray, _turned

STEPS = 60
FARTHEST = 1e3  # m: a sheet that is met beyond is not met


@njit(cache=True, nogil=True)
def _out(alpha, delta, axis, window):  # type: ignore[no-untyped-def]
    """The window's outward normal at an encoder angle, rig frame; of no meaning for a cylinder."""
    if window[0] == 0.0:
        return window[1], window[2], window[3]
    s, c = math.sin(alpha + delta), math.cos(alpha + delta)
    return _turned(axis, (c * window[1] - s * window[2], s * window[1] + c * window[2], window[3]))


@njit(cache=True, nogil=True)
def _slope(lateral, beyond, window):  # type: ignore[no-untyped-def]
    """Tangent in air of the ray that is `lateral` off when it is `beyond` the outer face, and its two derivatives.

    Newton from zero: the lateral reach rises with the tangent and is concave, so that it comes from below."""
    distance, thickness = window[4], window[5]
    g2, w2 = window[6] * window[6], window[7] * window[7]
    q = 0.0
    sw = window[7]
    slope = 1.0
    for _ in range(STEPS):
        sg = math.sqrt(g2 + (g2 - 1.0) * q * q)
        sw = math.sqrt(w2 + (w2 - 1.0) * q * q)
        slope = distance + thickness * g2 / (sg * sg * sg) + beyond * w2 / (sw * sw * sw)
        step = (lateral - q * (distance + thickness / sg + beyond / sw)) / slope
        q += step
        if step <= 1e-15 * (1.0 + q):
            break
    return q, 1.0 / slope, -q / (sw * slope)


@njit(cache=True, nogil=True)
def _off(p, normal, out, spindle, window):  # type: ignore[no-untyped-def]
    """normal . q of a point p from the apex, its gradient by p, and q (not of length one); NaN inside the window.

    out: the window's normal; spindle: the axis of rotation."""
    nan = math.nan
    if window[0] == 2.0:
        height = _dot(p, spindle)
        rx, ry, rz = p[0] - height * spindle[0], p[1] - height * spindle[1], p[2] - height * spindle[2]
        depth = math.sqrt(rx * rx + ry * ry + rz * rz)
        if not depth > window[4] + window[5]:
            return nan, (nan, nan, nan), (nan, nan, nan)
        rx, ry, rz = rx / depth, ry / depth, rz / depth
        q, by_lateral, by_beyond = _slope(abs(height), depth - window[4] - window[5], window)
        sign = 1.0 if height >= 0.0 else -1.0
        radial, along = normal[0] * rx + normal[1] * ry + normal[2] * rz, _dot(normal, spindle)
        turn = 1.0 / depth
        a, b = along * by_lateral, along * sign * by_beyond - radial * turn
        c = -along * turn
        gradient = (
            normal[0] * turn + a * spindle[0] + b * rx + c * spindle[0],
            normal[1] * turn + a * spindle[1] + b * ry + c * spindle[1],
            normal[2] * turn + a * spindle[2] + b * rz + c * spindle[2],
        )
        t = sign * q
        return radial + t * along, gradient, (rx + t * spindle[0], ry + t * spindle[1], rz + t * spindle[2])
    depth = _dot(p, out)
    beyond = depth - window[4] - window[5]
    if not beyond > 0.0:
        return nan, (nan, nan, nan), (nan, nan, nan)
    lx, ly, lz = p[0] - depth * out[0], p[1] - depth * out[1], p[2] - depth * out[2]
    lateral = math.sqrt(lx * lx + ly * ly + lz * lz)
    straight = _dot(normal, out)
    if lateral < 1e-12:
        _, by_lateral, _ = _slope(0.0, beyond, window)
        gradient = (
            by_lateral * (normal[0] - straight * out[0]),
            by_lateral * (normal[1] - straight * out[1]),
            by_lateral * (normal[2] - straight * out[2]),
        )
        return straight, gradient, out
    q, by_lateral, by_beyond = _slope(lateral, beyond, window)
    g = q / lateral
    lx, ly, lz = lx / lateral, ly / lateral, lz / lateral
    aside = normal[0] * lx + normal[1] * ly + normal[2] * lz
    a, b = aside * (by_lateral - g), aside * by_beyond - g * straight
    gradient = (
        g * normal[0] + a * lx + b * out[0],
        g * normal[1] + a * ly + b * out[1],
        g * normal[2] + a * lz + b * out[2],
    )
    return straight + q * aside, gradient, (out[0] + q * lx, out[1] + q * ly, out[2] + q * lz)


@njit(cache=True, nogil=True, error_model="numpy")
def triangulate(
    u: Floats,
    v: Floats,
    alpha: Floats,
    lens: Floats,
    port: Floats,
    rotation: Floats,
    centre: Floats,
    delta: float,
    beta: float,
    axis: Floats,
    apex: Floats,
    window: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Points (n, 3) where the rays of pixels meet the refracted sheet at alpha (n,), and their derivatives by u and by
    alpha, all in the rig frame. NaN rows where they do not meet in front of the camera and beyond the window."""
    n = u.size
    points = np.full((n, 3), np.nan)
    by_u = np.full((n, 3), np.nan)
    by_alpha = np.full((n, 3), np.nan)
    spindle = (axis[0, 2], axis[1, 2], axis[2, 2])
    for i in range(n):
        normal, turning = _normal(alpha[i], delta, beta, axis)
        out = _out(alpha[i], delta, axis, window)
        origin_c, direction_c, origin_uc, direction_uc = _ray(u[i], v[i], lens, port)
        direction, direction_u = _turned(rotation, direction_c), _turned(rotation, direction_uc)
        origin, origin_u = _turned(rotation, origin_c), _turned(rotation, origin_uc)
        start = (
            centre[0] + origin[0] - apex[0],
            centre[1] + origin[1] - apex[1],
            centre[2] + origin[2] - apex[2],
        )
        s = -_dot(normal, start) / _dot(normal, direction)
        if not 0.1 < s < FARTHEST:
            s = 1.0
        p, gradient, q, across = start, start, start, 0.0
        settled = False
        for _ in range(STEPS):
            p = (start[0] + s * direction[0], start[1] + s * direction[1], start[2] + s * direction[2])
            off, gradient, q = _off(p, normal, out, spindle, window)
            across = _dot(gradient, direction)
            step = off / across
            s = min(max(s - step, 0.3 * s), 4.0 * s)
            if not 0.0 < s < FARTHEST:  # NaN, too
                break
            if abs(step) <= 1e-12 * s:
                settled = True
                break
        if not settled:
            continue
        if window[0] == 0.0:
            off_alpha = _dot(turning, q)
        else:  # the window turns with the sheet, or looks the same from everywhere: turning the point back is the same
            round_x = spindle[1] * p[2] - spindle[2] * p[1]
            round_y = spindle[2] * p[0] - spindle[0] * p[2]
            round_z = spindle[0] * p[1] - spindle[1] * p[0]
            off_alpha = -_dot(gradient, (round_x, round_y, round_z))
        s_u = -(_dot(gradient, origin_u) + s * _dot(gradient, direction_u)) / across
        s_alpha = -off_alpha / across
        for k in range(3):
            points[i, k] = centre[k] + origin[k] + s * direction[k]
            by_u[i, k] = origin_u[k] + s_u * direction[k] + s * direction_u[k]
            by_alpha[i, k] = s_alpha * direction[k]
    return points, by_u, by_alpha


@njit(cache=True, nogil=True, error_model="numpy")
def off_sheet(
    points: Floats, alpha: Floats, delta: float, beta: float, axis: Floats, apex: Floats, window: Floats
) -> Floats:
    """Sine (n,) of the angle, in air at the apex, between the sheets at alpha (n,) and the ray that reaches points
    (n, 3), rig frame. NaN inside a window."""
    n = len(points)
    found = np.empty(n)
    spindle = (axis[0, 2], axis[1, 2], axis[2, 2])
    for i in range(n):
        normal, _ = _normal(alpha[i], delta, beta, axis)
        p = (points[i, 0] - apex[0], points[i, 1] - apex[1], points[i, 2] - apex[2])
        if window.size == 0:
            found[i] = _dot(normal, p) / math.sqrt(_dot(p, p))
        else:
            off, _, q = _off(p, normal, _out(alpha[i], delta, axis, window), spindle, window)
            found[i] = off / math.sqrt(_dot(q, q))
    return found
