"""Compiled loops along the rows of an image: which candidate is the stripe, what pulls it aside, how sure it is."""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.stripe.column_kernels import measure_again, refine
from garbi_map.stripe.kernels import CANDIDATES, HEIGHT

_GAP = 3
"""Rows that may be missing inside a piece."""
_LAG = 3
"""Rows between those whose scatter is measured: nearer ones share texture, and the lens's blur of it."""
WATER_RATE, NOISE_RATE = 0.01, 0.05
"""Share of a row in the running means of the water's pull and of the noise."""
_LINE = 1.0 / np.sqrt(3.0)
"""The lit line's share of the variance of the stripe's profile, the lens has the rest: rms of a share of which nothing is
known but that it lies between 0 and 1."""
_NEAR = 0.05
"""px: from farther away the water's pull is measured again about the corrected columns."""
_JUMP = 4.5
"""Rows of stripe that a jump is worth: a piece between two jumps that is shorter than both is a particle."""


@njit(cache=True, nogil=True)
def measure(  # type: ignore[no-untyped-def]
    image, channel, place, kernels, gains, spread, least, floor, largest_step, least_run, doubt
):
    """The candidates of `search` refined, the stripe chosen among them and freed of the water's pull.

    kernels: slope, curvature, water and rest, gains: those of slope and water, of Templates. Returns u, sigma, gain,
    clipped (h, 3) and chosen (h,), see Candidates.
    """
    shape = place.shape
    u, gain, pull, noise, sigma = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    clipped = np.zeros(shape, np.bool_)
    chosen = np.empty(shape[0], np.int64)
    slope, curvature, water, rest = kernels
    refine(image, channel, place, slope, curvature, water, rest, spread, least, u, gain, pull, noise, clipped)
    choose(u, gain, largest_step, least_run, chosen)
    off = water_pull(gain, pull, noise, chosen, floor, gains[1])
    take_off(u, chosen, off)
    if np.abs(off).max() > _NEAR:
        measure_again(image, channel, chosen, slope, curvature, water, spread, off, u, gain, pull)
        off = water_pull(gain, pull, noise, chosen, floor, gains[1])
        take_off(u, chosen, off)
    state_sigma(u, gain, noise, chosen, floor, gains[0], gains[1], spread, doubt * off, sigma)
    return u, sigma, gain, clipped, chosen


@njit(cache=True, nogil=True)
def choose(u, gain, largest_step, least_run, chosen):  # type: ignore[no-untyped-def]
    """The most likely path down the rows through the candidates (Viterbi), only in pieces of `least_run` rows.

    A row may have none. To be there earns most, to be bright a little, so that a bright particle does not win over a
    dim stripe; a jump costs, but not without bound, since depth has edges. chosen (h,) gets the candidate's number or
    -1.
    """
    rows = u.shape[0]
    typical = 0.0
    n = 0
    for r in range(rows):
        if not np.isnan(u[r, 0]):
            typical += gain[r, 0]
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
                strength = min(gain[r, s] / typical, 1.0)
                earn = 0.8 * min(4.0 * strength, 1.0) + 0.2 * strength if not np.isnan(here) else -1e9
            best = -1e18
            if r == 0:
                best = earn
                column[r, s] = here
            else:
                for p in range(states):
                    before = column[r - 1, p]
                    cost = 0.0
                    if s < CANDIDATES and not np.isnan(before) and not np.isnan(here):
                        cost = min(max(abs(here - before) / largest_step - 1.0, 0.0), 3.0) * _JUMP / 3.0
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
        end = begin
        found = 0
        last = -1
        while end < rows and (last < 0 or end - last <= _GAP):
            k = chosen[end]
            if k >= 0:
                if last >= 0 and abs(u[end, k] - u[last, chosen[last]]) > largest_step:
                    break
                last = end
                found += 1
            elif last < 0:
                break
            end += 1
        if 0 < found < least_run:
            chosen[begin : last + 1] = -1
        begin = max(last, begin) + 1


@njit(cache=True, nogil=True)
def water_pull(gain, pull, noise, chosen, floor, water_gain):  # type: ignore[no-untyped-def]
    """What the water moves the chosen columns by, px (h,), averaged over the neighbouring rows; 0 in the others.

    floor: least noise of a pixel; water_gain: see Templates.
    """
    row = _rows(chosen)
    n = len(row)
    lit, power = np.empty(n), np.empty(n)
    for i in range(n):
        lit[i] = pull[row[i], chosen[row[i]]]
        power[i] = noise[row[i], chosen[row[i]]] ** 2
    usual = max(_usual(power), floor * floor)
    mean = _averaged(lit, row, 3.0 * water_gain * np.sqrt(usual), WATER_RATE)
    off = np.zeros(len(chosen))
    for i in range(n):
        off[row[i]] = mean[i] / gain[row[i], chosen[row[i]]]
    return off


@njit(cache=True, nogil=True)
def take_off(u, chosen, off):  # type: ignore[no-untyped-def]
    """Subtract off (h,) from the chosen columns."""
    for r in range(len(chosen)):
        if chosen[r] >= 0:
            u[r, chosen[r]] -= off[r]


@njit(cache=True, nogil=True)
def state_sigma(u, gain, noise, chosen, floor, slope_gain, water_gain, spread, doubt, sigma):  # type: ignore[no-untyped-def]
    """Sigma (h, 3), px, of the chosen columns: noise, the ground's texture, the doubt (h,) px in what was taken off.

    Noise in place is averaged over the neighbouring rows, and is at least `floor`, that of a dark pixel; the scatter of
    neighbouring rows is the least of noise and texture together. A ground that grows lighter across the stripe moves it
    by the square of the lit line's width times that slope. The slope across is hidden, but texture has no preferred
    direction, and the slope of the brightness along the stripe shows itself. The lit line has _LINE of `spread`
    squared, the lens the rest.
    """
    row = _rows(chosen)
    n = len(row)
    power = np.empty(n)
    rough, slope = np.full(n, np.nan), np.full(n, np.nan)
    for i in range(n):
        r = row[i]
        k = chosen[r]
        power[i] = noise[r, k] ** 2
        if _LAG <= i < n - 2 * _LAG and row[i + 2 * _LAG] - row[i - _LAG] == 3 * _LAG:
            a, b, c = r - _LAG, r + _LAG, r + 2 * _LAG
            third = u[a, chosen[a]] - 3.0 * u[r, k] + 3.0 * u[b, chosen[b]] - u[c, chosen[c]]
            rough[i] = third**2 / 20.0
            # Two differences that share no row: their noise has no part in the mean of the product
            here, there = gain[r, k], gain[r + 1, chosen[r + 1]]
            one = 2.0 * (gain[b, chosen[b]] - here) / (gain[b, chosen[b]] + here)
            other = 2.0 * (gain[b + 1, chosen[b + 1]] - there) / (gain[b + 1, chosen[b + 1]] + there)
            slope[i] = one * other / _LAG**2
    usual = max(_usual(power), floor * floor)
    power_mean = _averaged(np.minimum(power, 12.0 * usual), row, 6.0 * usual, NOISE_RATE)
    uneven = _usual(rough)
    scatter = _averaged(np.minimum(rough, 12.0 * uneven), row, 6.0 * uneven, NOISE_RATE)
    steep = _usual(np.abs(slope))
    texture = _averaged(np.minimum(slope, 12.0 * steep), row, 6.0 * steep, NOISE_RATE)
    for i in range(n):
        r = row[i]
        k = chosen[r]
        variance = max(power_mean[i], floor * floor, power[i] / 9.0)
        variance *= (slope_gain**2 + 0.5 * WATER_RATE * water_gain**2) / gain[r, k] ** 2
        variance += (_LINE * spread**2) ** 2 * max(texture[i], 0.0)
        sigma[r, k] = np.sqrt(max(variance, scatter[i]) + doubt[r] ** 2)


@njit(cache=True, nogil=True)
def _rows(chosen):  # type: ignore[no-untyped-def]
    """The rows (n,) that have a choice."""
    row = np.empty(len(chosen), np.int64)
    n = 0
    for r in range(len(chosen)):
        if chosen[r] >= 0:
            row[n] = r
            n += 1
    return row[:n]


@njit(cache=True, nogil=True)
def _averaged(values, row, step, rate):  # type: ignore[no-untyped-def]
    """Exponential means from above and from below, together, in which a value moves the mean as if it were no more than
    `step` away; a gap between rows begins anew."""
    n = len(values)
    out = np.zeros(n)
    for way in range(2):
        state = 0.0
        last = -1000000
        for m in range(n):
            i = m if way == 0 else n - 1 - m
            if abs(row[i] - last) > 30:
                state = 0.0
                count = 0
                for ahead in range(40):
                    j = i + ahead if way == 0 else i - ahead
                    if 0 <= j < n and abs(row[j] - row[i]) < 60 and not np.isnan(values[j]):
                        state += values[j]
                        count += 1
                state /= max(count, 1)
            last = row[i]
            if not np.isnan(values[i]):
                state += rate * min(max(values[i] - state, -step), step)
            out[i] += 0.5 * state
    return out


@njit(cache=True, nogil=True)
def _usual(squares):  # type: ignore[no-untyped-def]
    """Variance whose squares of Gaussian deviates have this median; 0 for none. It only bounds outliers: 200 will do."""
    some = squares[:: max(len(squares) // 200, 1)]
    known = some[~np.isnan(some)]
    return np.median(known) / 0.455 if len(known) > 0 else 0.0


@njit(cache=True, nogil=True)
def gather(u, sigma, gain, clipped, chosen):  # type: ignore[no-untyped-def]
    """The chosen ones: row, u, sigma, height, clipped (n,), as Stripe holds them."""
    n = np.sum(chosen >= 0)
    row, column = np.empty(n, np.int32), np.empty(n, np.float32)
    error, height, full = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.bool_)
    i = 0
    for r in range(len(chosen)):
        k = chosen[r]
        if k >= 0:
            row[i], column[i], error[i], height[i] = r, u[r, k], sigma[r, k], gain[r, k] * HEIGHT
            full[i] = clipped[r, k]
            i += 1
    return row, column, error, height, full
