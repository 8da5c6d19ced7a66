"""Compiled loops over the points of two clouds."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def binned(points, low, side, columns, rows):
    """Order (n,) of points (n, 3) by square bins of the plane, row by row, and where each bin begins (bins + 1,).

    Points outside are left out; they come last.
    """
    bins = columns * rows
    start = np.zeros(bins + 2, np.int64)
    home = np.empty(len(points), np.int64)
    for i in range(len(points)):
        a = int(np.floor((points[i, 0] - low[0]) / side))
        b = int(np.floor((points[i, 1] - low[1]) / side))
        home[i] = b * columns + a if 0 <= a < columns and 0 <= b < rows else bins
        start[home[i] + 1] += 1
    for k in range(bins + 1):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    order = np.empty(len(points), np.int64)
    for i in range(len(points)):
        order[place[home[i]]] = i
        place[home[i]] += 1
    return order, start[: bins + 1]


@njit(cache=True, nogil=True)
def _span(low, high, origin, side, cells):
    first = max(int(np.floor((low - origin) / side)), 0)
    last = min(int(np.floor((high - origin) / side)), cells - 1)
    return first, last


@njit(cache=True, nogil=True)
def surface_normals(cores, points, start, low, side, columns, rows, radius, least):
    """Unit normals (k, 3), upward, of the points within a ball about each core (k, 3); NaN where there are too few."""
    out = np.full(cores.shape, np.nan)
    for k in range(len(cores)):
        a0, a1 = _span(cores[k, 0] - radius, cores[k, 0] + radius, low[0], side, columns)
        b0, b1 = _span(cores[k, 1] - radius, cores[k, 1] + radius, low[1], side, rows)
        n = 0
        m = np.zeros(3)
        c = np.zeros((3, 3))
        for b in range(b0, b1 + 1):
            for i in range(start[b * columns + a0], start[b * columns + a1 + 1]):
                d = points[i] - cores[k]
                if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > radius * radius:
                    continue
                n += 1
                for p in range(3):
                    m[p] += d[p]
                    for q in range(p, 3):
                        c[p, q] += d[p] * d[q]
        if n < least:
            continue
        m /= n
        for p in range(3):
            for q in range(p, 3):
                c[p, q] = c[q, p] = c[p, q] / n - m[p] * m[q]
        vector = np.linalg.eigh(c)[1][:, 0]
        out[k] = vector if vector[2] >= 0 else -vector
    return out


@njit(cache=True, nogil=True)
def cylinder_means(cores, normals, points, start, low, side, columns, rows, radius, reach, sheet, least):
    """Of the points in a cylinder about each core (k, 3) along its unit normal, near the one in the middle:

    their mean distance (k,) along the normal, m, NaN where there are fewer than `least`; its variance by their scatter
    (k,), m^2; their number (k,).
    """
    mean = np.full(len(cores), np.nan)
    variance = np.full(len(cores), np.nan)
    count = np.zeros(len(cores), np.int32)
    along = np.empty(4096)
    for k in range(len(cores)):
        n = normals[k]
        if not np.isfinite(n[0]):
            continue
        ox, oy = reach * abs(n[0]) + radius, reach * abs(n[1]) + radius
        a0, a1 = _span(cores[k, 0] - ox, cores[k, 0] + ox, low[0], side, columns)
        b0, b1 = _span(cores[k, 1] - oy, cores[k, 1] + oy, low[1], side, rows)
        found = 0
        for b in range(b0, b1 + 1):
            for i in range(start[b * columns + a0], start[b * columns + a1 + 1]):
                x, y, z = points[i, 0] - cores[k, 0], points[i, 1] - cores[k, 1], points[i, 2] - cores[k, 2]
                t = x * n[0] + y * n[1] + z * n[2]
                if abs(t) <= reach and x * x + y * y + z * z - t * t <= radius * radius and found < len(along):
                    along[found] = t
                    found += 1
        if found < least:
            continue
        middle = np.median(along[:found])
        used = 0
        total = 0.0
        squares = 0.0
        for j in range(found):
            if abs(along[j] - middle) <= sheet:
                used += 1
                total += along[j] - middle
                squares += (along[j] - middle) ** 2
        if used < least:
            continue
        total /= used
        mean[k] = middle + total
        variance[k] = max(squares / used - total * total, 0.0) / (used - 1)
        count[k] = used
    return mean, variance, count


@njit(cache=True, nogil=True)
def nearest(places, reach, points, start, low, side, columns, rows):
    """Distance (k,) m of each place (k, 3) from the nearest point, inf where none is within its reach (k,) m."""
    out = np.full(len(places), np.inf)
    for k in range(len(places)):
        if not np.isfinite(places[k, 2] + reach[k]):
            continue
        a0, a1 = _span(places[k, 0] - reach[k], places[k, 0] + reach[k], low[0], side, columns)
        b0, b1 = _span(places[k, 1] - reach[k], places[k, 1] + reach[k], low[1], side, rows)
        best = reach[k] * reach[k]
        for b in range(b0, b1 + 1):
            for i in range(start[b * columns + a0], start[b * columns + a1 + 1]):
                d = points[i] - places[k]
                best = min(best, d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        if best < reach[k] * reach[k]:
            out[k] = np.sqrt(best)
    return out
