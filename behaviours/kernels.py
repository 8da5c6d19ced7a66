"""Compiled work on the local volume: a grid of voxels that moves with the vehicle, addressed modulo its size.

Layers, all (nx, ny, nz): free_ms int32, when last seen free; hit_ms int32, when last hit; since_ms int32, since when it has
been free without a hit; hits uint8; passes uint8, in which it was seen free; last_pass int32; moving uint8; first_ms
int32, of the hits that are counted. Times are ms since the start, NEVER where it never was. `low` (3,) is the first
voxel's number on each axis.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from garbi_map.log.records import Floats

NEVER = -(2**30)
UNKNOWN, FREE, OCCUPIED = 0, 1, 2
BRUSHED = 0.2  # of a voxel, that an unseen one's middle has to be beyond the hull's faces for it to be passed by


@njit(cache=True, nogil=True, inline="always")
def _inside(i, j, k, low, shape):  # type: ignore[no-untyped-def]
    return low[0] <= i < low[0] + shape[0] and low[1] <= j < low[1] + shape[1] and low[2] <= k < low[2] + shape[2]


@njit(cache=True, nogil=True, inline="always")
def _kind(a, b, c, k, voxel, least, assumed_free_above, free_ms, hits):  # type: ignore[no-untyped-def]
    """What the voxel at (a, b, c), on level k, is."""
    if hits[a, b, c] >= least:
        return OCCUPIED
    return FREE if free_ms[a, b, c] != NEVER or k * voxel >= assumed_free_above else UNKNOWN


@njit(cache=True, nogil=True)
def _about(position, rotation, half, voxel, low, shape):  # type: ignore[no-untyped-def]
    """(2, 3): first number and the one after the last of the voxels that a box about the vehicle may hold."""
    reach = np.abs(rotation) @ half
    first = np.floor((position - reach) / voxel).astype(np.int64)
    last = np.floor((position + reach) / voxel).astype(np.int64)
    return np.maximum(first, low), np.minimum(last + 1, low + shape)


@njit(cache=True, nogil=True, inline="always")
def _in_base(i, j, k, voxel, position, rotation):  # type: ignore[no-untyped-def]
    """The middle of a voxel, base_link, m."""
    x, y, z = (i + 0.5) * voxel - position[0], (j + 0.5) * voxel - position[1], (k + 0.5) * voxel - position[2]
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@njit(cache=True, nogil=True)
def _long_free(i, j, k, low, shape, least, now, free_passes, free_time, layers):  # type: ignore[no-untyped-def]
    """Whether water had long been free in a voxel and in all its neighbours."""
    _, hit_ms, since_ms, hits, passes, _, moving, _ = layers
    for di in range(-1, 2):
        for dj in range(-1, 2):
            for dk in range(-1, 2):
                if not _inside(i + di, j + dj, k + dk, low, shape):
                    return False
                e, f, g = (i + di) % shape[0], (j + dj) % shape[1], (k + dk) % shape[2]
                fresh = hit_ms[e, f, g] == now or moving[e, f, g] == 1
                if since_ms[e, f, g] == NEVER or (hits[e, f, g] >= least and not fresh):
                    return False
                if passes[e, f, g] < free_passes or now - since_ms[e, f, g] < free_time:
                    return False
    return True


@njit(cache=True, nogil=True)
def _free(a, b, c, now, sweep, hold, hold_moving, free_ms, hit_ms, since_ms, hits, passes, last_pass, moving):  # type: ignore[no-untyped-def]
    if hits[a, b, c] > 0 and now - hit_ms[a, b, c] > (hold_moving if moving[a, b, c] else hold):
        hits[a, b, c] = 0
        moving[a, b, c] = 0
    if since_ms[a, b, c] == NEVER and hits[a, b, c] == 0:
        since_ms[a, b, c] = now
        passes[a, b, c] = 0
        last_pass[a, b, c] = -1
    if last_pass[a, b, c] != sweep:
        last_pass[a, b, c] = sweep
        if passes[a, b, c] < 255:
            passes[a, b, c] += 1
    free_ms[a, b, c] = now


@njit(cache=True, nogil=True)
def _walk(start, end, stop_short, voxel, low, shape, hits, least, now, sweep, hold, hold_moving, layers):  # type: ignore[no-untyped-def]
    """Free the voxels on the way from start to end, less stop_short (m); stop at an occupied one that is not old."""
    free_ms, hit_ms, since_ms, _, passes, last_pass, moving, _ = layers
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    reach = length - stop_short
    if reach <= 0.0:
        return
    steps = int(reach / (0.7 * voxel)) + 1
    li = lj = lk = -(2**30)
    for s in range(steps + 1):
        w = reach * s / (steps * length)
        i = math.floor((start[0] + w * dx) / voxel)
        j = math.floor((start[1] + w * dy) / voxel)
        k = math.floor((start[2] + w * dz) / voxel)
        if i == li and j == lj and k == lk:
            continue
        li, lj, lk = i, j, k
        if not _inside(i, j, k, low, shape):
            continue
        a, b, c = i % shape[0], j % shape[1], k % shape[2]
        if hits[a, b, c] >= least and now - hit_ms[a, b, c] <= (hold_moving if moving[a, b, c] else hold):
            if now != hit_ms[a, b, c]:
                return
            continue
        _free(a, b, c, now, sweep, hold, hold_moving, free_ms, hit_ms, since_ms, hits, passes, last_pass, moving)


@njit(cache=True, nogil=True)
def carve(
    starts: Floats,
    ends: Floats,
    stop_short: float,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    now: int,
    sweep: int,
    hold: int,
    hold_moving: int,
    layers: tuple,
) -> None:
    """Free the lines from starts (n, 3) or (1, 3) to ends (n, 3), odom, less `stop_short` m at their ends; a line stops at
    what is occupied and not old."""
    hits = layers[3]
    for n in range(ends.shape[0]):
        start = starts[n if starts.shape[0] > 1 else 0]
        _walk(start, ends[n], stop_short, voxel, low, shape, hits, least, now, sweep, hold, hold_moving, layers)


@njit(cache=True, nogil=True)
def hit(
    points: Floats,
    weight: NDArray[np.int64],
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    now: int,
    free_passes: int,
    free_time: int,
    layers: tuple,
) -> NDArray[np.bool_]:
    """Mark the voxels of points (n, 3), odom, each counting `weight` (n,) hits.

    True (n,) where water that had long been free, with its neighbours, was hit."""
    _, hit_ms, since_ms, hits, _, _, moving, first_ms = layers
    n = points.shape[0]
    surprising = np.zeros(n, np.bool_)
    for p in range(n):
        i = math.floor(points[p, 0] / voxel)
        j = math.floor(points[p, 1] / voxel)
        k = math.floor(points[p, 2] / voxel)
        if not _inside(i, j, k, low, shape):
            continue
        a, b, c = i % shape[0], j % shape[1], k % shape[2]
        ever = moving[a, b, c] == 1
        ever = ever or _long_free(i, j, k, low, shape, least, now, free_passes, free_time, layers)
        surprising[p] = ever
        if now - hit_ms[a, b, c] > 1000 and hits[a, b, c] < least:
            hits[a, b, c] = 0  # a lone flake of snow long ago does not add up
        if hits[a, b, c] == 0:
            first_ms[a, b, c] = now
        hits[a, b, c] = min(hits[a, b, c] + weight[p], 250)
        hit_ms[a, b, c] = now
        if ever:
            moving[a, b, c] = 1
        elif hits[a, b, c] >= least:  # a flake of snow does not make water a place where things stand
            since_ms[a, b, c] = NEVER
            moving[a, b, c] = 0
    return surprising


@njit(cache=True, nogil=True)
def was_free(
    points: Floats,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    now: int,
    sweep: int,
    layers: tuple,
) -> NDArray[np.bool_]:
    """Whether points (n, 3), odom, that are about to be marked lie where an earlier pass than `sweep` saw free water and
    nothing had been hit until this last second."""
    _, _, _, hits, passes, last_pass, _, first_ms = layers
    found = np.zeros(points.shape[0], np.bool_)
    for p in range(points.shape[0]):
        i = math.floor(points[p, 0] / voxel)
        j = math.floor(points[p, 1] / voxel)
        k = math.floor(points[p, 2] / voxel)
        if _inside(i, j, k, low, shape):
            a, b, c = i % shape[0], j % shape[1], k % shape[2]
            before = passes[a, b, c] - (1 if last_pass[a, b, c] == sweep else 0)
            found[p] = before > 0 and (hits[a, b, c] == 0 or now - first_ms[a, b, c] <= 1000)
    return found


@njit(cache=True, nogil=True)
def free_box(
    position: Floats,
    rotation: Floats,
    half: Floats,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    now: int,
    clear: bool,
    layers: tuple,
) -> None:
    """Free the voxels whose centres lie in a box about the vehicle; with `clear` even those that were hit."""
    free_ms, _, since_ms, hits, _, _, moving, _ = layers
    first, last = _about(position, rotation, half, voxel, low, shape)
    for i in range(first[0], last[0]):
        for j in range(first[1], last[1]):
            for k in range(first[2], last[2]):
                x, y, z = _in_base(i, j, k, voxel, position, rotation)
                if abs(x) > half[0] or abs(y) > half[1] or abs(z) > half[2]:
                    continue
                a, b, c = i % shape[0], j % shape[1], k % shape[2]
                if clear:
                    hits[a, b, c] = 0
                    moving[a, b, c] = 0
                if hits[a, b, c] == 0:
                    free_ms[a, b, c] = now
                    if since_ms[a, b, c] == NEVER:
                        since_ms[a, b, c] = now


@njit(cache=True, nogil=True, inline="always")
def _part(component):  # type: ignore[no-untyped-def]
    """A normal's component in halves, -2..2, nought only where it is none."""
    if abs(component) < 1e-9:
        return 0
    return (1 if component > 0.0 else -1) * max(round(2 * abs(component)), 1)


@njit(cache=True, nogil=True)
def nearest(
    position: Floats,
    rotation: Floats,
    half: Floats,
    horizon: float,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    assumed_free_above: float,
    layers: tuple,
) -> tuple[Floats, NDArray[np.int64]]:
    """What is nearest to the hull in each direction: (m, 7) distance, normal (3) out of the hull, nearest point of the
    hull (3), base_link, m; and (m,) what it is, OCCUPIED or UNKNOWN. Unknown voxels whose floor lies above
    `assumed_free_above` (m, odom; inf: none) count as free. Outside the grid nothing is looked for."""
    free_ms, _, _, hits, _, _, _, _ = layers
    best = np.full((2, 125), np.inf)
    normals = np.zeros((2, 125, 3))
    points = np.zeros((2, 125, 3))
    first, last = _about(position, rotation, half + horizon, voxel, low, shape)
    for i in range(first[0], last[0]):
        a = i % shape[0]
        for j in range(first[1], last[1]):
            b = j % shape[1]
            for k in range(first[2], last[2]):
                c = k % shape[2]
                kind = _kind(a, b, c, k, voxel, least, assumed_free_above, free_ms, hits)
                if kind == FREE:
                    continue
                px, py, pz = _in_base(i, j, k, voxel, position, rotation)
                more = BRUSHED * voxel if kind == UNKNOWN else 0.0
                hx, hy, hz = half[0] + more, half[1] + more, half[2] + more
                qx = min(max(px, -hx), hx)
                qy = min(max(py, -hy), hy)
                qz = min(max(pz, -hz), hz)
                nx, ny, nz = px - qx, py - qy, pz - qz
                d = math.sqrt(nx * nx + ny * ny + nz * nz)
                if d > horizon + voxel:
                    continue
                if d < 1e-6:  # inside the hull: out of the nearest face
                    gx, gy, gz = hx - abs(px), hy - abs(py), hz - abs(pz)
                    nx = ny = nz = 0.0
                    if gx <= gy and gx <= gz:
                        nx = 1.0 if px > 0 else -1.0
                    elif gy <= gz:
                        ny = 1.0 if py > 0 else -1.0
                    else:
                        nz = 1.0 if pz > 0 else -1.0
                else:
                    nx, ny, nz = nx / d, ny / d, nz / d
                gap = d - 0.5 * voxel
                which = 0 if kind == OCCUPIED else 1
                if kind == UNKNOWN:  # what lies wholly before a face, and what the hull passes by, are two things
                    bin_ = (_part(nx) + 2) * 25 + (_part(ny) + 2) * 5 + _part(nz) + 2
                else:
                    bin_ = (round(2 * nx) + 2) * 25 + (round(2 * ny) + 2) * 5 + round(2 * nz) + 2
                if gap < best[which, bin_]:
                    best[which, bin_] = gap
                    normals[which, bin_, 0], normals[which, bin_, 1], normals[which, bin_, 2] = nx, ny, nz
                    points[which, bin_, 0], points[which, bin_, 1], points[which, bin_, 2] = qx, qy, qz
    count = np.isfinite(best).sum()
    found = np.empty((count, 7))
    kinds = np.empty(count, np.int64)
    row = 0
    for which in range(2):
        for bin_ in range(125):
            if best[which, bin_] < np.inf:
                found[row, 0] = best[which, bin_]
                found[row, 1:4] = normals[which, bin_]
                found[row, 4:7] = points[which, bin_]
                kinds[row] = OCCUPIED if which == 0 else UNKNOWN
                row += 1
    return found, kinds


@njit(cache=True, nogil=True)
def ahead(
    position: Floats,
    rotation: Floats,
    half: Floats,
    slide: float,
    carried: float,
    fade: float,
    reach: float,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    assumed_free_above: float,
    now: int,
    layers: tuple,
) -> tuple[float, float, int]:
    """The corridor in front of the bow: free length m, age ms of its view (80th percentile over the cross-section of the
    newest look along each line), and what ends it (FREE where nothing does within reach). It leads aside as the vehicle
    does: at first by `slide`, farther on by `carried` m for each metre ahead, the difference fading within `fade` m."""
    free_ms, _, _, hits, _, _, _, _ = layers
    ny, nz = max(int(2 * half[1] / voxel), 1), max(int(2 * half[2] / voxel), 1)
    ages = np.empty(ny * nz)
    shortest, end = reach, FREE
    for m in range(ny):
        for n in range(nz):
            y, z = (m + 0.5) / ny * 2 * half[1] - half[1], (n + 0.5) / nz * 2 * half[2] - half[2]
            newest = NEVER
            x = half[0] + 0.5 * voxel
            while x < half[0] + reach:
                gone = x - half[0]
                w = y + carried * gone + (slide - carried) * fade * (1.0 - math.exp(-gone / fade))
                px = position[0] + rotation[0, 0] * x + rotation[0, 1] * w + rotation[0, 2] * z
                py = position[1] + rotation[1, 0] * x + rotation[1, 1] * w + rotation[1, 2] * z
                pz = position[2] + rotation[2, 0] * x + rotation[2, 1] * w + rotation[2, 2] * z
                i, j, k = math.floor(px / voxel), math.floor(py / voxel), math.floor(pz / voxel)
                kind = UNKNOWN
                if _inside(i, j, k, low, shape):
                    a, b, c = i % shape[0], j % shape[1], k % shape[2]
                    kind = _kind(a, b, c, k, voxel, least, assumed_free_above, free_ms, hits)
                    if kind == FREE and free_ms[a, b, c] > newest:
                        newest = free_ms[a, b, c]
                if kind != FREE:
                    if x - half[0] - 0.5 * voxel < shortest:
                        shortest, end = x - half[0] - 0.5 * voxel, kind
                    break
                x += voxel
            ages[m * nz + n] = now - newest
    return shortest, np.sort(ages)[int(0.8 * (ny * nz - 1))], end
