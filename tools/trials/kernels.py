"""Compiled rays that meet plain shapes: a heightfield, boxes, rods, spheres. A trial casts millions of them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from garbi_map.log.records import Floats

STEPS = 8  # towards the ground: its slopes are small
FLATTEST = 0.04  # sine of the angle under which a ray still finds the ground


@njit(cache=True, nogil=True, inline="always")
def _height(x, y, heights, corner, cell):  # type: ignore[no-untyped-def]
    """Bilinear, held outside."""
    a = min(max((x - corner[0]) / cell, 0.0), heights.shape[1] - 1.001)
    b = min(max((y - corner[1]) / cell, 0.0), heights.shape[0] - 1.001)
    i, j = int(a), int(b)
    u, v = a - i, b - j
    low = heights[j, i] * (1 - u) + heights[j, i + 1] * u
    return low * (1 - v) + (heights[j + 1, i] * (1 - u) + heights[j + 1, i + 1] * u) * v


@njit(cache=True, nogil=True)
def _ground(o, d, heights, corner, cell):  # type: ignore[no-untyped-def]
    if d[2] > -FLATTEST:
        return np.inf
    t = -o[2] / d[2]
    for _ in range(STEPS):
        t = (_height(o[0] + t * d[0], o[1] + t * d[1], heights, corner, cell) - o[2]) / d[2]
    return t if t > 1e-6 else np.inf


@njit(cache=True, nogil=True)
def _box(o, d, box, normal):  # type: ignore[no-untyped-def]
    """box: centre (3), half size (3), heading."""
    c, s = math.cos(box[6]), math.sin(box[6])
    x, y, z = o[0] - box[0], o[1] - box[1], o[2] - box[2]
    start = (c * x + s * y, -s * x + c * y, z)
    way = (c * d[0] + s * d[1], -s * d[0] + c * d[1], d[2])
    near, far, axis = -np.inf, np.inf, 0
    for m in range(3):
        if abs(way[m]) < 1e-12:
            if abs(start[m]) > box[3 + m]:
                return np.inf
            continue
        a, b = (-box[3 + m] - start[m]) / way[m], (box[3 + m] - start[m]) / way[m]
        if a > b:
            a, b = b, a
        if a > near:
            near, axis = a, m
        far = min(far, b)
    if near > far or near < 1e-6:
        return np.inf
    sign = -1.0 if way[axis] > 0 else 1.0
    normal[0] = sign * (c if axis == 0 else -s if axis == 1 else 0.0)
    normal[1] = sign * (s if axis == 0 else c if axis == 1 else 0.0)
    normal[2] = sign if axis == 2 else 0.0
    return near


@njit(cache=True, nogil=True)
def _rod(o, d, rod, normal):  # type: ignore[no-untyped-def]
    """rod: foot (3), head (3), radius; without lids."""
    ax, ay, az = rod[3] - rod[0], rod[4] - rod[1], rod[5] - rod[2]
    length = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    x, y, z = o[0] - rod[0], o[1] - rod[1], o[2] - rod[2]
    along, rise = x * ax + y * ay + z * az, d[0] * ax + d[1] * ay + d[2] * az
    px, py, pz = x - along * ax, y - along * ay, z - along * az
    qx, qy, qz = d[0] - rise * ax, d[1] - rise * ay, d[2] - rise * az
    a = qx * qx + qy * qy + qz * qz
    b = px * qx + py * qy + pz * qz
    inside = b * b - a * (px * px + py * py + pz * pz - rod[6] * rod[6])
    if inside < 0.0 or a < 1e-12:
        return np.inf
    t = (-b - math.sqrt(inside)) / a
    if t < 1e-6 or not 0.0 <= along + t * rise <= length:
        return np.inf
    normal[0], normal[1], normal[2] = (px + t * qx) / rod[6], (py + t * qy) / rod[6], (pz + t * qz) / rod[6]
    return t


@njit(cache=True, nogil=True)
def _ball(o, d, ball, normal):  # type: ignore[no-untyped-def]
    """ball: centre (3), radius."""
    x, y, z = o[0] - ball[0], o[1] - ball[1], o[2] - ball[2]
    b = x * d[0] + y * d[1] + z * d[2]
    inside = b * b - (x * x + y * y + z * z - ball[3] * ball[3])
    if inside < 0.0:
        return np.inf
    t = -b - math.sqrt(inside)
    if t < 1e-6:
        return np.inf
    normal[0], normal[1], normal[2] = (x + t * d[0]) / ball[3], (y + t * d[1]) / ball[3], (z + t * d[2]) / ball[3]
    return t


@njit(cache=True, nogil=True)
def cast(
    origin: Floats,
    direction: Floats,
    heights: Floats,
    corner: Floats,
    cell: float,
    boxes: Floats,
    rods: Floats,
    balls: Floats,
) -> tuple[Floats, Floats]:
    """Distance (n,), inf where nothing is met, and normal (n, 3) of what rays from (n, 3) along unit (n, 3) meet first.

    heights (rows, columns) m, from `corner` (2,) m in steps of `cell` m; boxes (b, 7), rods (r, 7), balls (s, 4)."""
    count = origin.shape[0]
    distance, normals = np.empty(count), np.zeros((count, 3))
    found = np.zeros(3)
    for n in range(count):
        o, d = origin[n], direction[n]
        best = _ground(o, d, heights, corner, cell)
        if best < np.inf:
            x, y = o[0] + best * d[0], o[1] + best * d[1]
            here = _height(x, y, heights, corner, cell)
            east = (_height(x + 0.01, y, heights, corner, cell) - here) / 0.01
            north = (_height(x, y + 0.01, heights, corner, cell) - here) / 0.01
            size = math.sqrt(1.0 + east * east + north * north)
            normals[n, 0], normals[n, 1], normals[n, 2] = -east / size, -north / size, 1.0 / size
        for b in range(boxes.shape[0]):
            t = _box(o, d, boxes[b], found)
            if t < best:
                best = t
                normals[n] = found
        for r in range(rods.shape[0]):
            t = _rod(o, d, rods[r], found)
            if t < best:
                best = t
                normals[n] = found
        for s in range(balls.shape[0]):
            t = _ball(o, d, balls[s], found)
            if t < best:
                best = t
                normals[n] = found
        distance[n] = best
    return distance, normals
