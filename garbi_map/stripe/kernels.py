"""Compiled loops of the stripe room."""

from __future__ import annotations

import numpy as np
from numba import njit

CANDIDATES = 3
"""Places in a row that may be the stripe."""

_CORE = 2
"""Half of the box, px, that a peak is looked for with."""


@njit(cache=True, nogil=True)
def find_candidates(image, table, shift, channel, first, last, reach, threshold, place, contrast, width):  # type: ignore[no-untyped-def]
    """Up to three peaks per row that stand out from both sides and pass the colour gate, the strongest first.

    image (h, w, c) uint8; first, last (h,) columns of the window; reach: px from a peak to its surroundings; threshold:
    least contrast. place (h, 3) int, -1 where there is none; contrast and width (h, 3): peak above the surroundings and
    full width at half of it, px.
    """
    rows, columns, depth = image.shape
    total = np.empty(columns + 1, np.float32)
    for r in range(rows):
        place[r, :] = -1
        low = max(int(first[r]), reach + 2)
        high = min(int(last[r]), columns - reach - 3)
        if high <= low:
            continue
        begin, end = low - reach - 2, high + reach + 3
        total[begin] = 0.0
        for c in range(begin, end):
            total[c + 1] = total[c] + image[r, c, channel]
        best = 0.0
        at = -1
        for c in range(low, high + 1):
            core = (total[c + _CORE + 1] - total[c - _CORE]) * 0.2
            left = (total[c - reach + 2] - total[c - reach - 1]) / 3.0
            right = (total[c + reach + 2] - total[c + reach - 1]) / 3.0
            rise = core - 0.5 * (left + right)
            if rise > threshold and rise > best and core > left and core > right:
                best = rise
                at = c
            elif at >= 0 and (c - at > reach or rise < 0.5 * best):
                _keep(image, table, shift, channel, r, at, reach, depth, place, contrast, width)
                best = 0.0
                at = -1
        if at >= 0:
            _keep(image, table, shift, channel, r, at, reach, depth, place, contrast, width)


@njit(cache=True, nogil=True)
def _keep(image, table, shift, channel, r, at, reach, depth, place, contrast, width):  # type: ignore[no-untyped-def]
    peak = at
    for c in range(at - _CORE, at + _CORE + 1):
        if image[r, c, channel] > image[r, peak, channel]:
            peak = c
    if depth == 3:
        passed = False
        for c in range(peak - 1, peak + 2):
            b, g, red = image[r, c, 0] >> shift, image[r, c, 1] >> shift, image[r, c, 2] >> shift
            bits = 8 - shift
            if table[(b << (2 * bits)) | (g << bits) | red]:
                passed = True
        if not passed:
            return
    side = 0.5 * (float(image[r, at - reach, channel]) + float(image[r, at + reach, channel]))
    height = float(image[r, peak, channel]) - side
    if height <= 0.0:
        return
    half = side + 0.5 * height
    left = peak
    while left > at - reach and image[r, left, channel] > half:
        left -= 1
    right = peak
    while right < at + reach and image[r, right, channel] > half:
        right += 1
    a0, a1 = float(image[r, left, channel]), float(image[r, left + 1, channel])
    b0, b1 = float(image[r, right, channel]), float(image[r, right - 1, channel])
    from_left = left + (half - a0) / (a1 - a0) if a1 > a0 else float(left)
    from_right = right - (half - b0) / (b1 - b0) if b1 > b0 else float(right)
    for k in range(CANDIDATES):
        if place[r, k] < 0 or height > contrast[r, k]:
            for m in range(CANDIDATES - 1, k, -1):
                place[r, m] = place[r, m - 1]
                contrast[r, m] = contrast[r, m - 1]
                width[r, m] = width[r, m - 1]
            place[r, k] = at
            contrast[r, k] = height
            width[r, k] = from_right - from_left
            return


@njit(cache=True, nogil=True)
def refine(image, channel, place, spread, noise_floor, gain, u, sigma, amplitude, clipped):  # type: ignore[no-untyped-def]
    """Sub-pixel column of each candidate, its sigma, amplitude above the surroundings, and whether it is clipped.

    The zero of the correlation with the derivative of a Gaussian of the stripe's own width (`spread`, 1 sigma px) is
    the maximum-likelihood column in white noise (Canny 1986); a line through both surroundings is taken off first, so that
    a slope of the background does not pull. noise_floor, gain: variance of a pixel = noise_floor^2 + gain * value.
    """
    rows, columns = image.shape[0], image.shape[1]
    reach = int(np.ceil(4.0 * spread))
    flank = max(3, int(np.ceil(1.5 * spread)))
    bound = np.sqrt(2.0 * spread / np.sqrt(np.pi))
    for r in range(rows):
        for k in range(CANDIDATES):
            c = place[r, k]
            u[r, k] = np.nan
            if c < 0:
                continue
            begin, end = max(c - reach - flank, 0), min(c + reach + flank, columns - 1)
            left, right = 0.0, 0.0
            nl, nr = 0, 0
            for j in range(begin, c - reach + 1):
                left += image[r, j, channel]
                nl += 1
            for j in range(c + reach, end + 1):
                right += image[r, j, channel]
                nr += 1
            if nl == 0 or nr == 0:
                continue
            left /= nl
            right /= nr
            xl, xr = 0.5 * (begin + c - reach), 0.5 * (end + c + reach)
            slope = (right - left) / (xr - xl)
            x = float(c)
            curvature = 0.0
            area = 0.0
            good = False
            for _ in range(12):
                moment, area, curvature = 0.0, 0.0, 0.0
                for j in range(max(int(x) - reach, 0), min(int(x) + reach + 2, columns)):
                    d = (j - x) / spread
                    w = np.exp(-0.5 * d * d)
                    value = image[r, j, channel] - (left + slope * (j - xl))
                    moment += w * d * value
                    area += w * value
                    curvature += w * (1.0 - d * d) * value
                if area <= 0.0 or curvature <= 0.0:
                    break
                step = spread * moment / curvature
                step = min(max(step, -1.0), 1.0)
                x += step
                if abs(x - c) > 3.0 * spread + 2.0:
                    break
                if abs(step) < 1e-3:
                    good = True
                    break
            if not good:
                continue
            high = area / (spread * np.sqrt(np.pi))
            top = image[r, min(max(int(x + 0.5), 0), columns - 1), channel]
            variance = noise_floor * noise_floor + gain * 0.5 * (top + 0.5 * (left + right))
            tilt = abs(right - left) / max(high, 1.0)
            u[r, k] = x
            amplitude[r, k] = high
            clipped[r, k] = top >= 254
            sigma[r, k] = np.sqrt(variance * bound * bound / (high * high) + (0.25 * tilt * spread) ** 2)
            if clipped[r, k]:
                sigma[r, k] = max(sigma[r, k], 0.15 * spread)


@njit(cache=True, nogil=True)
def choose(u, amplitude, largest_step, least_run, chosen):  # type: ignore[no-untyped-def]
    """The most likely path down the rows through the candidates (Viterbi), only in pieces of `least_run` rows.

    A row may have none. A candidate earns its amplitude relative to the image's own; a jump costs, but not without
    bound, since depth has edges. chosen (h,) gets the candidate's number or -1.
    """
    rows = u.shape[0]
    typical = 0.0
    n = 0
    for r in range(rows):
        if not np.isnan(u[r, 0]):
            typical += amplitude[r, 0]
            n += 1
    if n == 0:
        chosen[:] = -1
        return
    typical /= n
    states = CANDIDATES + 1
    score = np.zeros((rows, states))
    back = np.zeros((rows, states), np.int64)
    column = np.zeros((rows, states))
    for r in range(rows):
        for s in range(states):
            earn = 0.0
            here = np.nan
            if s < CANDIDATES:
                here = u[r, s]
                earn = min(amplitude[r, s] / typical, 1.5) - 0.2 if not np.isnan(here) else -1e9
            best = -1e18
            if r == 0:
                best = earn
                column[r, s] = here
            else:
                for p in range(states):
                    before = column[r - 1, p]
                    cost = 0.0
                    if s < CANDIDATES and not np.isnan(before) and not np.isnan(here):
                        cost = min(abs(here - before) / largest_step, 3.0) * 0.5
                    value = score[r - 1, p] + earn - cost
                    if value > best:
                        best = value
                        back[r, s] = p
                column[r, s] = here if s < CANDIDATES and not np.isnan(here) else column[r - 1, back[r, s]]
            score[r, s] = best
    s = int(np.argmax(score[rows - 1]))
    for r in range(rows - 1, -1, -1):
        chosen[r] = s if s < CANDIDATES and not np.isnan(u[r, s]) else -1
        s = back[r, s]
    begin = 0
    while begin < rows:
        if chosen[begin] < 0:
            begin += 1
            continue
        end = begin
        while end + 1 < rows and chosen[end + 1] >= 0:
            if abs(u[end + 1, chosen[end + 1]] - u[end, chosen[end]]) > largest_step:
                break
            end += 1
        if end - begin + 1 < least_run:
            for r in range(begin, end + 1):
                chosen[r] = -1
        begin = end + 1


@njit(cache=True, nogil=True)
def noise_of(image, channel, step):  # type: ignore[no-untyped-def]
    """1 sigma of a dark pixel's noise: the mean absolute second difference along every `step`-th row."""
    rows, columns = image.shape[0], image.shape[1]
    histogram = np.zeros(1024, np.int64)
    n = 0
    for r in range(step // 2, rows, step):
        for c in range(2, columns - 2, 3):
            d = int(image[r, c - 1, channel]) - 2 * int(image[r, c, channel]) + int(image[r, c + 1, channel])
            histogram[min(abs(d), 1023)] += 1
            n += 1
    if n == 0:
        return 1.0
    below = 0
    for k in range(1024):
        if below + histogram[k] >= 0.6827 * n:
            part = (0.6827 * n - below) / max(histogram[k], 1)
            return max((k - 0.5 + part) / np.sqrt(6.0), 0.3)
        below += histogram[k]
    return 1.0


@njit(cache=True, nogil=True)
def paper_rows(image, table, shift, u, amplitude):  # type: ignore[no-untyped-def]
    """The paper's own method: per row, the centre of gravity of all pixels that pass the colour table.

    u (h,) NaN where none does; amplitude (h,) the largest green among them.
    """
    rows, columns = image.shape[0], image.shape[1]
    bits = 8 - shift
    for r in range(rows):
        total, moment, top = 0.0, 0.0, 0.0
        for c in range(columns):
            b, g, red = image[r, c, 0] >> shift, image[r, c, 1] >> shift, image[r, c, 2] >> shift
            if table[(b << (2 * bits)) | (g << bits) | red]:
                value = float(image[r, c, 1])
                total += value
                moment += value * c
                top = max(top, value)
        u[r] = moment / total if total > 0.0 else np.nan
        amplitude[r] = top
