"""Compiled loops of the stripe room."""

from __future__ import annotations

import numpy as np
from numba import njit

CANDIDATES = 3
"""Places in a row that may be the stripe."""
BLOCK = 4
"""Pixels that are summed before peaks are looked for."""
AWAY = 16
"""px from the middle of a peak to the middle of what counts as its surroundings; both are two blocks wide."""

HEIGHT = 2.0 / np.sqrt(np.pi)
"""Height of a stripe per gain of its correlation with its own slope."""
CLIPPED = 254.0
"""Grey level from which a pixel may be clipped."""

_PAD = 6


@njit(cache=True, nogil=True)
def find_candidates(image, blocks, channel, table, bits, first, last, threshold, place, width):  # type: ignore[no-untyped-def]
    """Up to three peaks per row that stand out from both sides and pass the colour gate, the brightest first.

    image (h, w, c) uint8; blocks: the same as (h, w // BLOCK, BLOCK c); first, last (h,) columns of the window;
    threshold: least mean of a peak above the mean of its surroundings; place (h, 3) column, NaN where there is none;
    width (h, 3) full width at half maximum, px.
    """
    rows, columns, depth = image.shape
    count = blocks.shape[1]
    total = np.zeros(count + 2 * _PAD, np.int32)
    rise = np.zeros(count + 2 * _PAD, np.int32)
    bright = np.empty(CANDIDATES)
    least = np.int32(4 * BLOCK * threshold)
    for r in range(rows):
        for k in range(CANDIDATES):
            place[r, k] = np.nan
            bright[k] = 0.0
        low, high = max(first[r], 0.0), min(last[r], columns - 1.0)
        if not last[r] >= first[r] or count < 2:
            continue
        begin, end = max(int(low) // BLOCK - 1, 0), min(int(high) // BLOCK + 2, count)
        near, far = max(begin - _PAD, 0), min(end + _PAD, count)
        _sum_blocks(blocks[r, near:far], channel, depth, total[_PAD + near : _PAD + far])
        total[begin : _PAD + near] = total[_PAD + near]
        total[_PAD + far : 2 * _PAD + end] = total[_PAD + far - 1]
        _stand_out(total[begin : 2 * _PAD + end], rise[_PAD + begin : _PAD + end])
        before = np.int32(0)
        rise[_PAD + end - 1] = 0
        for b in range(_PAD + begin, _PAD + end - 1):
            here = rise[b]
            if here > least and here > before and here >= rise[b + 1]:
                core = total[b] + total[b + 1]
                left, right = total[b - 4] + total[b - 3], total[b + 4] + total[b + 5]
                if core > left and core > right:
                    side = 0.25 * (left + right) / BLOCK
                    _keep(image, channel, table, bits, r, BLOCK * (b - _PAD), low, high, side, bright, place, width)
            before = here


@njit(cache=True, nogil=True)
def _sum_blocks(line, channel, depth, total):  # type: ignore[no-untyped-def]
    for b in range(len(total)):
        total[b] = (
            np.int32(line[b, channel])
            + np.int32(line[b, channel + depth])
            + np.int32(line[b, channel + 2 * depth])
            + np.int32(line[b, channel + 3 * depth])
        )


@njit(cache=True, nogil=True)
def _stand_out(total, rise):  # type: ignore[no-untyped-def]
    """Twice what two blocks hold, less what those AWAY to either side hold; total has _PAD more each side."""
    for b in range(len(rise)):
        rise[b] = 2 * (total[b + 6] + total[b + 7]) - (total[b + 2] + total[b + 3]) - (total[b + 10] + total[b + 11])


@njit(cache=True, nogil=True)
def _keep(image, channel, table, bits, r, begin, first, last, side, bright, place, width):  # type: ignore[no-untyped-def]
    """Keep the peak within the two blocks at `begin`, if its colour is the laser's, in order of its height."""
    columns, depth = image.shape[1], image.shape[2]
    low, high = max(begin - 1, 1), min(begin + 2 * BLOCK, columns - 2)
    peak, top = low, np.int32(-1)
    before, here = np.int32(image[r, low - 1, channel]), np.int32(image[r, low, channel])
    for c in range(low, high + 1):
        after = np.int32(image[r, c + 1, channel])
        value = before + 2 * here + after
        if value > top:
            top = value
            peak = c
        before, here = here, after
    if depth == 3:
        shift = 8 - bits
        passed = False
        for c in range(max(peak - 1, 0), min(peak + 2, columns)):
            b, g, red = image[r, c, 0] >> shift, image[r, c, 1] >> shift, image[r, c, 2] >> shift
            passed |= table[(b << (2 * bits)) | (g << bits) | red] > 0
        if not passed:
            return
    height = 0.25 * top - side
    if height <= 0.0:
        return
    half = side + 0.5 * height
    left = peak
    while left > 0 and peak - left < 2 * AWAY and image[r, left, channel] > half:
        left -= 1
    right = peak
    while right < columns - 1 and right - peak < 2 * AWAY and image[r, right, channel] > half:
        right += 1
    a0, a1 = float(image[r, left, channel]), float(image[r, min(left + 1, columns - 1), channel])
    b0, b1 = float(image[r, right, channel]), float(image[r, max(right - 1, 0), channel])
    x0 = left + (half - a0) / (a1 - a0) if a1 > half >= a0 else float(left)
    x1 = right - (half - b0) / (b1 - b0) if b1 > half >= b0 else float(right)
    middle = 0.5 * (x0 + x1)
    if not first <= middle <= last:
        return
    for k in range(CANDIDATES):
        if abs(place[r, k] - middle) < AWAY // 2:
            return
        if height > bright[k]:
            for m in range(CANDIDATES - 1, k, -1):
                place[r, m] = place[r, m - 1]
                bright[m] = bright[m - 1]
                width[r, m] = width[r, m - 1]
            place[r, k] = middle
            bright[k] = height
            width[r, k] = x1 - x0
            return


@njit(cache=True, nogil=True)
def spread_of(image, channel, place, width, step, least, most):  # type: ignore[no-untyped-def]
    """1 sigma of the stripe's profile, px, from least to most: the median over every `step`-th row.

    Correlating exp(-t^2 / 2 sigma^2) with (1 - d^2) exp(-d^2 / 2), d = t / s, gives s^3 sigma / (s^2 + sigma^2)^1.5:
    the ratio for two s tells sigma, whatever the height, the dark level and, nearly, the halo.
    """
    rows = image.shape[0]
    found = np.empty(rows // step + 1)
    n = 0
    for r in range(step // 2, rows, step):
        if place[r, 0] >= 0.0:
            found[n] = width[r, 0] / 2.3548
            n += 1
    if n < 4:
        return min(max(2.0, least), most)
    spread = np.median(found[:n])
    for _ in range(2):
        spread = _compare_scales(image, channel, place, min(max(spread, least), most), step, found)
    return min(max(spread, least), most)


@njit(cache=True, nogil=True)
def _compare_scales(image, channel, place, start, step, found):  # type: ignore[no-untyped-def]
    rows, columns = image.shape[0], image.shape[1]
    n = 0
    for r in range(step // 2, rows, step):
        x = place[r, 0]
        reach = int(5.5 * start)
        if not reach < x < columns - reach - 2:
            continue
        fine, coarse = 0.0, 0.0
        clipped = 0
        for turn in range(3):
            tilt, fine, coarse = 0.0, 0.0, 0.0
            for c in range(int(x) - reach, int(x) + reach + 2):
                value = float(image[r, c, channel])
                clipped += value >= CLIPPED
                d2 = ((c - x) / start) ** 2
                bell = np.exp(-0.5 * d2)
                tilt += (c - x) * bell * value
                fine += (1.0 - d2) * bell * value
                if turn == 2:
                    coarse += (1.0 - d2 / 2.25) * np.exp(-d2 / 4.5) * value
            if fine <= 0.0:
                break
            if turn < 2:
                x += min(max(tilt / fine, -start), start)
        if fine > 0.0 and coarse > 0.0 and clipped < 12 * start:
            ratio = (coarse / (3.375 * fine)) ** (2.0 / 3.0)
            if 1.0 / 2.25 < ratio < 1.0:
                found[n] = start * np.sqrt((2.25 * ratio - 1.0) / (1.0 - ratio))
                n += 1
    return np.median(found[:n]) if n >= 4 else start


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def refine(image, channel, place, slope, curvature, water, rest, spread, least, u, gain, pull, noise, clipped):  # type: ignore[no-untyped-def]
    """Each candidate's column u (h, 3), where its correlation with `slope` is zero, NaN where it is not `least` high.

    The tables are those of Templates. gain (h, 3): grey levels by which the correlation changes per px; pull (h, 3):
    what the water adds to the correlation; noise (h, 3): response of `rest`; clipped (h, 3) bool.
    """
    rows, columns = image.shape[0], image.shape[1]
    phases, taps = slope.shape
    reach = taps // 2 - 1
    wide = water.shape[1]
    wing = (wide - taps) // 2
    row = np.empty(wide + 16, np.float32)
    for r in range(rows):
        for k in range(CANDIDATES):
            u[r, k] = np.nan
            if not place[r, k] >= 0.0:
                continue
            x = place[r, k]
            base = int(x)
            origin = base - reach - wing - 8
            for j in range(wide + 16):
                row[j] = image[r, min(max(origin + j, 0), columns - 1), channel]
            found = False
            phase = 0
            bend = np.float32(1.0)
            at = 0
            for _ in range(8):
                base = int(x)
                phase = int((x - base) * phases + 0.5)
                if phase == phases:
                    base += 1
                    phase = 0
                at = base - reach - origin
                if at - wing < 0 or at + taps + wing > wide + 16:
                    break
                if base - reach // 2 < 0 or base + reach // 2 >= columns:
                    break
                tilt = np.float32(0.0)
                bend = np.float32(0.0)
                for j in range(taps):
                    tilt += slope[phase, j] * row[at + j]
                    bend += curvature[phase, j] * row[at + j]
                if bend <= 0.0:
                    break
                step = spread * tilt / bend
                start = base + phase / phases
                if abs(step) < 0.75 / phases:
                    x = start + step
                    found = True
                    break
                x = start + min(max(step, -1.0), 1.0)
            if not found or not 0.0 <= x <= columns - 1.0:
                continue
            gain[r, k] = bend / spread
            if gain[r, k] * HEIGHT < least:
                continue
            lit = np.float32(0.0)
            for j in range(wide):
                lit += water[phase, j] * row[at - wing + j]
            other = np.float32(0.0)
            for j in range(taps):
                other += rest[phase, j] * row[at + j]
            top = max(row[at + reach], row[at + reach + 1])
            u[r, k] = x
            whole = base - reach - wing >= 0 and base + reach + wing + 1 < columns
            pull[r, k] = lit if whole else np.nan
            noise[r, k] = other
            clipped[r, k] = top >= CLIPPED


@njit(cache=True, nogil=True)
def correct(u, gain, pull, noise, chosen, floor, slope_gain, water_gain, doubt, sigma):  # type: ignore[no-untyped-def]
    """Take the water's pull off the chosen columns, averaged over the neighbouring rows, and state sigma (h, 3), px.

    Noise in place is averaged likewise, and is at least `floor`, that of a dark pixel; so is the scatter of
    neighbouring rows, which holds what is no noise of pixels: texture, speckle, compression. doubt: share of a
    correction that counts as error. slope_gain, water_gain: see Templates.
    """
    rows = u.shape[0]
    row = np.empty(rows, np.int64)
    n = 0
    for r in range(rows):
        k = chosen[r]
        if k >= 0:
            row[n] = r
            n += 1
    if n == 0:
        return
    lit = np.empty(n)
    power = np.empty(n)
    bend = np.full(n, np.nan)
    for i in range(n):
        r = row[i]
        k = chosen[r]
        lit[i] = pull[r, k]
        power[i] = noise[r, k] ** 2
        if 0 < i < n - 1 and row[i + 1] - row[i - 1] == 2:
            second = u[r - 1, chosen[r - 1]] - 2.0 * u[r, k] + u[r + 1, chosen[r + 1]]
            bend[i] = second**2 / 6.0
    usual = max(_usual(power), floor * floor)
    lit_mean = _averaged(lit, row, 3.0 * water_gain * np.sqrt(usual), 0.02)
    power_mean = _averaged(np.minimum(power, 12.0 * usual), row, 6.0 * usual, 0.05)
    uneven = _usual(bend)
    scatter = _averaged(np.minimum(bend, 12.0 * uneven), row, 6.0 * uneven, 0.05)
    for i in range(n):
        r = row[i]
        k = chosen[r]
        off = lit_mean[i] / gain[r, k]
        u[r, k] -= off
        variance = max(power_mean[i], floor * floor, power[i] / 9.0)
        variance *= (slope_gain**2 + 0.006 * water_gain**2) / gain[r, k] ** 2
        sigma[r, k] = np.sqrt(max(variance, scatter[i]) + (doubt * off) ** 2)


@njit(cache=True, nogil=True)
def _usual(squares):  # type: ignore[no-untyped-def]
    """Variance whose squares of Gaussian deviates have this median; 0 for none."""
    known = squares[~np.isnan(squares)]
    return np.median(known) / 0.455 if len(known) > 0 else 0.0


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
                for ahead in range(25):
                    j = i + ahead if way == 0 else i - ahead
                    if 0 <= j < n and abs(row[j] - row[i]) < 40 and not np.isnan(values[j]):
                        state += values[j]
                        count += 1
                state /= max(count, 1)
            last = row[i]
            if not np.isnan(values[i]):
                state += rate * min(max(values[i] - state, -step), step)
            out[i] += 0.5 * state
    return out


@njit(cache=True, nogil=True)
def choose(u, gain, largest_step, least_run, chosen):  # type: ignore[no-untyped-def]
    """The most likely path down the rows through the candidates (Viterbi), only in pieces of `least_run` rows.

    A row may have none. A candidate earns its height relative to the image's own; a jump costs, but not without
    bound, since depth has edges. chosen (h,) gets the candidate's number or -1.
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
                earn = min(gain[r, s] / typical, 1.5) - 0.2 if not np.isnan(here) else -1e9
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
