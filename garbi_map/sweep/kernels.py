"""Compiled loops over encoder readings and over the rows of a profile."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from garbi_map.log.records import Floats

AGREEMENT = 2.0  # standard deviations by which estimates from narrower and wider windows may differ
MISFIT = 1.5  # residual rms, in units of the reading's noise, above which a parabola does not describe the motion


@njit(cache=True, nogil=True, error_model="numpy")
def local_angle(
    asked: Floats,
    time: Floats,
    angle: Floats,
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
    half_widths: NDArray[np.int64],
    period: float,
    step: float,
    noise: float,
) -> tuple[Floats, Floats]:
    """Angle and sigma at each asked time: a local parabola over the widest window that the readings agree with.

    asked (m,), time (n,) s; angle (n,) rad; begin, end (n,): the unbroken stretch [begin, end) that a reading is in;
    half_widths in readings, ascending; period s between readings; step of the encoder and noise of a reading, rad.
    NaN where no stretch covers the time.

    The window grows while its estimate stays within the confidence intervals of all narrower ones (the intersection
    of confidence intervals; Goldenshluger and Nemirovski 1997) and its residuals look like the readings' noise: wide
    where the motor runs evenly, narrow across a turn. Rounding to counts averages out only as far as the phase moves
    from reading to reading, which the rate tells.
    """
    estimate = np.full(asked.size, np.nan)
    sigma = np.full(asked.size, np.nan)
    for q in range(asked.size):
        t = asked[q]
        right = np.searchsorted(time, t)
        if right == time.size or (right > 0 and t - time[right - 1] < time[right] - t):
            right -= 1
        start, stop = begin[right], end[right]
        if not time[start] - period <= t <= time[stop - 1] + period:
            continue
        near = angle[right]
        low = high = right  # readings [low, high) are in the sums
        s0 = s1 = s2 = s3 = s4 = y0 = y1 = y2 = yy = 0.0
        floor, ceiling = -math.inf, math.inf
        for half in half_widths:
            reach = (half + 0.5) * period
            while high < stop and time[high] - t <= reach:
                x, y = (time[high] - t) / period, angle[high] - near
                x2 = x * x
                s0, s1, s2, s3, s4 = s0 + 1.0, s1 + x, s2 + x2, s3 + x * x2, s4 + x2 * x2
                y0, y1, y2, yy = y0 + y, y1 + x * y, y2 + x2 * y, yy + y * y
                high += 1
            while low > start and t - time[low - 1] <= reach:
                low -= 1
                x, y = (time[low] - t) / period, angle[low] - near
                x2 = x * x
                s0, s1, s2, s3, s4 = s0 + 1.0, s1 + x, s2 + x2, s3 + x * x2, s4 + x2 * x2
                y0, y1, y2, yy = y0 + y, y1 + x * y, y2 + x2 * y, yy + y * y
            if s0 < 4.0:
                continue
            a, b, c = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
            det = s0 * a + s1 * b + s2 * c
            if det <= 1e-9 * s0 * s2 * s4:
                continue
            value = (a * y0 + b * y1 + c * y2) / det
            rate = (b * y0 + (s0 * s4 - s2 * s2) * y1 + (s1 * s2 - s0 * s3) * y2) / det
            bend = (c * y0 + (s1 * s2 - s0 * s3) * y1 + (s0 * s2 - s1 * s1) * y2) / det
            misfit = math.sqrt(max(yy - value * y0 - rate * y1 - bend * y2, 0.0) / (s0 - 3.0))
            share = a / det  # variance of the value in units of a reading's
            if noise < 0.5 * step:
                phase = abs(rate / step - np.rint(rate / step))
                share = min(share * max(1.0, 0.5 / max(phase, 0.5 / s0)), max(share, 1.0))
            spread = math.sqrt(share) * noise
            first = math.isinf(ceiling)
            if not first and (
                misfit > MISFIT * noise or value - AGREEMENT * spread > ceiling or value + AGREEMENT * spread < floor
            ):
                break
            floor = max(floor, value - AGREEMENT * spread)
            ceiling = min(ceiling, value + AGREEMENT * spread)
            if first or spread < sigma[q]:
                estimate[q] = near + value
                sigma[q] = max(spread, math.sqrt(share) * misfit)
    return estimate, sigma


@njit(cache=True, nogil=True, error_model="numpy")
def turning_points(time: Floats, angle: Floats, least_turn: float, jitter: float) -> Floats:
    """Times at which the angle turns back by more than least_turn; the middle of a dwell near the extreme."""
    turns = np.empty(time.size)
    count = 0
    direction = 0
    top = bottom = angle[0]
    top_from = top_to = bottom_from = bottom_to = time[0]
    for i in range(time.size):
        if angle[i] > top + jitter:
            top, top_from, top_to = angle[i], time[i], time[i]
        elif angle[i] >= top - jitter:
            top_to = time[i]
        if angle[i] < bottom - jitter:
            bottom, bottom_from, bottom_to = angle[i], time[i], time[i]
        elif angle[i] <= bottom + jitter:
            bottom_to = time[i]
        if direction >= 0 and top - angle[i] > least_turn:
            if direction > 0:
                turns[count] = 0.5 * (top_from + top_to)
                count += 1
            direction = -1
            bottom, bottom_from, bottom_to = angle[i], time[i], time[i]
        elif direction <= 0 and angle[i] - bottom > least_turn:
            if direction < 0:
                turns[count] = 0.5 * (bottom_from + bottom_to)
                count += 1
            direction = 1
            top, top_from, top_to = angle[i], time[i], time[i]
    return turns[:count].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def profile_edges(
    profile: NDArray[np.int32],
    row: NDArray[np.int32],
    depth: Floats,
    sigma: Floats,
    pitch: float,
    slope: float,
    row_gap: int,
    least_run: int,
    least_extent: float,
    edge_rows: int,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which points stand alone, and which lie beside a depth edge: alone (n,), mixed (n,).

    Points in order of profile, then row; depth and sigma (n,) m; pitch: distance across the ray between neighbouring
    rows per metre of depth. Neighbours belong together when their depths differ by no more than `slope` times their
    distance across the ray and four sigma. A run of fewer than least_run points, or shorter across the ray than
    least_extent (m), is alone: a flake in the water, not the bottom. Where two runs meet within row_gap rows the light
    of both surfaces mixes in one stripe: their edge_rows nearest points are mixed.
    """
    n = row.size
    alone = np.zeros(n, np.bool_)
    mixed = np.zeros(n, np.bool_)
    start = 0
    for i in range(1, n + 1):
        together = edge = False
        if i < n and profile[i] == profile[i - 1]:
            rows = row[i] - row[i - 1]
            if rows <= row_gap:
                across = pitch * rows * min(depth[i], depth[i - 1])
                room = slope * across + 4.0 * math.sqrt(sigma[i] ** 2 + sigma[i - 1] ** 2)
                together = abs(depth[i] - depth[i - 1]) <= room
                edge = not together
        if together:
            continue
        extent = pitch * (row[i - 1] - row[start] + 1) * depth[(start + i - 1) // 2]
        if i - start < least_run or extent < least_extent:
            alone[start:i] = True
        if edge:
            mixed[max(start, i - edge_rows) : i] = True
            k = i
            while k < n and profile[k] == profile[i] and row[k] < row[i] + edge_rows:
                mixed[k] = True
                k += 1
        start = i
    return alone, mixed
