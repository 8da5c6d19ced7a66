"""Compiled loops over the pixels of an image: where each row may have the stripe, to a fraction of a pixel."""

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
