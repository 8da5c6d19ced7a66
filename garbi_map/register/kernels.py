"""Compiled loops of the register room."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def voxel_keys(points, size, key):  # type: ignore[no-untyped-def]
    """One int64 per point that names its voxel; 21 bits an axis."""
    for k in range(points.shape[0]):
        x = int(np.floor(points[k, 0] / size)) + 1048576
        y = int(np.floor(points[k, 1] / size)) + 1048576
        z = int(np.floor(points[k, 2] / size)) + 1048576
        key[k] = (x << 42) | (y << 21) | z


@njit(cache=True, nogil=True)
def group_by_voxel(points, profile, sweep, size, group, group_sweep):  # type: ignore[no-untyped-def]
    """Numbers the (sweep, voxel) that each point falls into, in order of first appearance; returns how many there are.

    An open-addressing hash table; group (n,) and group_sweep (n,) are filled.
    """
    n = points.shape[0]
    slots = 16
    while slots < 2 * n:
        slots *= 2
    mask = slots - 1
    table = np.full(slots, -1, np.int64)
    voxel = np.empty((n, 3), np.int64)
    groups = 0
    for k in range(n):
        x = int(np.floor(points[k, 0] / size))
        y = int(np.floor(points[k, 1] / size))
        z = int(np.floor(points[k, 2] / size))
        s = sweep[profile[k]]
        spot = (x * 73856093 ^ y * 19349663 ^ z * 83492791 ^ s * 39916801) & mask
        while True:
            g = table[spot]
            if g < 0:
                table[spot] = groups
                voxel[groups, 0], voxel[groups, 1], voxel[groups, 2] = x, y, z
                group_sweep[groups] = s
                group[k] = groups
                groups += 1
                break
            if voxel[g, 0] == x and voxel[g, 1] == y and voxel[g, 2] == z and group_sweep[g] == s:
                group[k] = g
                break
            spot = (spot + 1) & mask
    return groups


@njit(cache=True, nogil=True)
def smallest_eigenvectors(c, values, normal):  # type: ignore[no-untyped-def]
    """Eigenvalues, ascending, and the first eigenvector of symmetric 3x3 matrices.

    c (n, 6) holds xx, xy, xz, yy, yz, zz. Trigonometric solution of the characteristic cubic (Smith, 1961); the vector is
    the largest cross product of two rows of (C - l I).
    """
    for k in range(c.shape[0]):
        a, b, d, e, f, g = c[k, 0], c[k, 1], c[k, 2], c[k, 3], c[k, 4], c[k, 5]
        q = (a + e + g) / 3.0
        p2 = (a - q) ** 2 + (e - q) ** 2 + (g - q) ** 2 + 2.0 * (b * b + d * d + f * f)
        p = np.sqrt(p2 / 6.0)
        if p < 1e-15:
            values[k, :] = q
            normal[k, 0] = 0.0
            normal[k, 1] = 0.0
            normal[k, 2] = 1.0
            continue
        a1, e1, g1 = (a - q) / p, (e - q) / p, (g - q) / p
        b1, d1, f1 = b / p, d / p, f / p
        half_det = 0.5 * (a1 * (e1 * g1 - f1 * f1) - b1 * (b1 * g1 - f1 * d1) + d1 * (b1 * f1 - e1 * d1))
        half_det = min(max(half_det, -1.0), 1.0)
        phi = np.arccos(half_det) / 3.0
        largest = q + 2.0 * p * np.cos(phi)
        least = q + 2.0 * p * np.cos(phi + 2.0943951023931953)
        values[k, 0] = least
        values[k, 1] = 3.0 * q - largest - least
        values[k, 2] = largest
        r0 = (a - least, b, d)
        r1 = (b, e - least, f)
        r2 = (d, f, g - least)
        best = -1.0
        for u, v in ((r0, r1), (r0, r2), (r1, r2)):
            x = u[1] * v[2] - u[2] * v[1]
            y = u[2] * v[0] - u[0] * v[2]
            z = u[0] * v[1] - u[1] * v[0]
            norm = x * x + y * y + z * z
            if norm > best:
                best = norm
                s = 1.0 / np.sqrt(norm) if norm > 0.0 else 0.0
                normal[k, 0], normal[k, 1], normal[k, 2] = x * s, y * s, z * s


@njit(cache=True, nogil=True)
def accumulate_moments(points, sigma, profile, time, viewpoint, group, count, mean, second, mean_time, camera):  # type: ignore[no-untyped-def]
    """Moments per group of points, weighted by 1 / sigma^2; group (n,) in 0..len(count)-1.

    mean_time and camera are the weighted means of the points' times and viewpoints. Two passes, so that no digits are
    lost far from the origin.
    """
    total = np.zeros(count.shape[0])
    for k in range(points.shape[0]):
        g = group[k]
        w = 1.0 / (sigma[k] * sigma[k])
        count[g] += 1
        total[g] += w
        mean_time[g] += w * time[profile[k]]
        for a in range(3):
            mean[g, a] += w * points[k, a]
            camera[g, a] += w * viewpoint[profile[k], a]
    for g in range(count.shape[0]):
        if total[g] > 0.0:
            mean_time[g] /= total[g]
            for a in range(3):
                mean[g, a] /= total[g]
                camera[g, a] /= total[g]
    for k in range(points.shape[0]):
        g = group[k]
        w = 1.0 / (sigma[k] * sigma[k]) / total[g]
        x = points[k, 0] - mean[g, 0]
        y = points[k, 1] - mean[g, 1]
        z = points[k, 2] - mean[g, 2]
        second[g, 0] += w * x * x
        second[g, 1] += w * x * y
        second[g, 2] += w * x * z
        second[g, 3] += w * y * y
        second[g, 4] += w * y * z
        second[g, 5] += w * z * z


@njit(cache=True, nogil=True)
def find_matches(asked, mean, normal, time, sweep, key, order, sorted_key, gate, max_dt, min_cos, first, second):  # type: ignore[no-untyped-def]
    """For each surfel that is asked the nearest one of every *other* sweep with a larger number, within gate (m), max_dt (s)
    and angle.

    key holds voxel names for voxels of the size `gate`; order sorts them. Returns the number of matches written.
    """
    n = mean.shape[0]
    written = 0
    near_sweep = np.empty(256, np.int64)
    near_index = np.empty(256, np.int64)
    near_d2 = np.empty(256, np.float64)
    gate2 = gate * gate
    for i in range(n):
        if not asked[i]:
            continue
        found = 0
        base = key[i]
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                low = base + (dx << 42) + (dy << 21) - 1
                start = np.searchsorted(sorted_key, low)
                s = start
                while s < n and sorted_key[s] <= low + 2:
                    j = order[s]
                    s += 1
                    if sweep[j] <= sweep[i] or abs(time[j] - time[i]) > max_dt:
                        continue
                    d2 = 0.0
                    cosine = 0.0
                    for a in range(3):
                        d = mean[j, a] - mean[i, a]
                        d2 += d * d
                        cosine += normal[i, a] * normal[j, a]
                    if d2 > gate2 or cosine < min_cos:
                        continue
                    slot = -1
                    for m in range(found):
                        if near_sweep[m] == sweep[j]:
                            slot = m
                            break
                    if slot < 0 and found < 256:
                        slot = found
                        near_sweep[slot] = sweep[j]
                        near_d2[slot] = 1e30
                        found += 1
                    if slot >= 0 and d2 < near_d2[slot]:
                        near_d2[slot] = d2
                        near_index[slot] = j
        for m in range(found):
            if written < first.shape[0]:
                first[written] = i
                second[written] = near_index[m]
                written += 1
    return written


@njit(cache=True, nogil=True)
def sum_neighbours(asked, mean, sweep, order, sorted_key, begin, radius, key, offset, count):  # type: ignore[no-untyped-def]
    """For each surfel that is asked the offsets (m) of those of its own sweep within `radius` (m), summed, and their number.

    key holds voxel names for voxels of the size `radius`; order sorts by sweep, then key; begin (sweeps + 1,) is where each
    sweep begins in that order. offset (n, 3) and count (n,) are filled.
    """
    for i in range(mean.shape[0]):
        if not asked[i]:
            continue
        start, end = begin[sweep[i]], begin[sweep[i] + 1]
        own = sorted_key[start:end]
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                low = key[i] + (dx << 42) + (dy << 21) - 1
                s = np.searchsorted(own, low)
                while s < end - start and own[s] <= low + 2:
                    j = order[start + s]
                    s += 1
                    x, y, z = mean[j, 0] - mean[i, 0], mean[j, 1] - mean[i, 1], mean[j, 2] - mean[i, 2]
                    if j == i or x * x + y * y + z * z > radius * radius:
                        continue
                    offset[i, 0] += x
                    offset[i, 1] += y
                    offset[i, 2] += z
                    count[i] += 1


@njit(cache=True, nogil=True)
def accumulate_normal_equations(start, value, residual, weight, h, g):  # type: ignore[no-untyped-def]
    """h += J' W J, g += J' W r. A row of J is a few runs of twelve consecutive unknowns.

    start (n, b) first unknown of each run, value (n, b, 12); residual and weight (n,).
    """
    n, b = start.shape
    for row in range(n):
        w = weight[row]
        if w == 0.0:
            continue
        wr = w * residual[row]
        for i in range(b):
            ci = start[row, i]
            for a in range(12):
                va = value[row, i, a]
                if va == 0.0:
                    continue
                g[ci + a] += va * wr
                va *= w
                target = h[ci + a]
                for j in range(b):
                    cj = start[row, j]
                    for k in range(12):
                        target[cj + k] += va * value[row, j, k]


@njit(cache=True, nogil=True)
def accumulate_tail(start, value, weighted, crossed):  # type: ignore[no-untyped-def]
    """crossed += J' W T of rows whose J is runs of twelve (as above), and whose T, already times W, is (n, k)."""
    n, b = start.shape
    for row in range(n):
        for i in range(b):
            ci = start[row, i]
            for a in range(12):
                va = value[row, i, a]
                if va != 0.0:
                    for k in range(weighted.shape[1]):
                        crossed[ci + a, k] += va * weighted[row, k]
