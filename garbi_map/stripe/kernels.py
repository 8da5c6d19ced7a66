"""Compiled loops over the pixels of an image: where each row may have the stripe, its width and the noise."""

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
def search(image, channel, table, bits, first, last, contrast, significance, narrowest, widest):  # type: ignore[no-untyped-def]
    """Candidates' columns (h, 3), the least height of one and the dark's noise, grey levels, and the stripe's spread,
    px: what has to be known before the kernels to measure with are chosen. Only the window's pixels are read."""
    rows = len(image)
    noise = noise_of(image, channel, first, last, max(rows // 32, 1))
    least = max(contrast, significance * noise)
    place, width = np.empty((rows, CANDIDATES)), np.empty((rows, CANDIDATES))
    find_candidates(image, channel, table, bits, first, last, 0.4 * least, place, width)
    return place, least, noise, spread_of(image, channel, place, width, rows // 32 + 1, narrowest, widest)


@njit(cache=True, nogil=True)
def find_candidates(image, channel, table, bits, first, last, threshold, place, width):  # type: ignore[no-untyped-def]
    """Up to three peaks per row that stand out from both sides and pass the colour gate, the brightest first.

    image (h, w, c) uint8; first, last (h,) columns of the window; threshold: least mean of a peak above the mean of its
    surroundings; place (h, 3) column, NaN where there is none; width (h, 3) full width at half maximum, px.
    """
    rows, columns, depth = image.shape
    flat = image.reshape(-1)
    count = columns // BLOCK
    line = np.empty(columns, np.uint8)
    total = np.zeros(count + 2 * _PAD, np.int16)
    rise = np.zeros(count + 2 * _PAD, np.int16)
    marks = np.zeros(8 * (count // 8 + 2), np.uint8)
    eights = marks.view(np.uint64)
    bright = np.empty(CANDIDATES)
    least = np.int16(min(4 * BLOCK * threshold, 32767.0))
    for r in range(rows):
        for k in range(CANDIDATES):
            place[r, k] = np.nan
            bright[k] = 0.0
        low, high = max(first[r], 0.0), min(last[r], columns - 1.0)
        if not last[r] >= first[r] or count < 2:
            continue
        begin, end = max(int(low) // BLOCK - 1, 0), min(int(high) // BLOCK + 2, count)
        near, far = max(begin - _PAD, 0), min(end + _PAD, count)
        if depth == 3:
            copy_third(flat, 3 * (r * columns + BLOCK * near) + channel, line, BLOCK * (far - near))
        else:
            _copy(flat, r * columns + BLOCK * near, line, BLOCK * (far - near))
        _sum_blocks(line, total, _PAD + near, far - near)
        for b in range(begin, _PAD + near):
            total[b] = total[_PAD + near]
        for b in range(_PAD + far, 2 * _PAD + end):
            total[b] = total[_PAD + far - 1]
        _stand_out(total, rise, _PAD + begin, end - begin)
        rise[_PAD + begin - 1] = 0
        rise[_PAD + end - 1] = 0
        rise[_PAD + end] = 0
        _mark_peaks(rise, least, _PAD + begin, marks, end - begin)
        for b in range(end - begin, end - begin + 8):
            marks[b] = 0
        for eight in range((end - begin + 7) // 8):
            if eights[eight] == 0:
                continue
            for b in range(_PAD + begin + 8 * eight, _PAD + begin + 8 * eight + 8):
                if marks[b - _PAD - begin] == 0:
                    continue
                core = total[b] + total[b + 1]
                left, right = total[b - 4] + total[b - 3], total[b + 4] + total[b + 5]
                if core > left and core > right:
                    side = 0.25 * (left + right) / BLOCK
                    at = BLOCK * (b - _PAD - near)
                    stop = BLOCK * (far - near) - 1
                    _keep(
                        image,
                        line,
                        stop,
                        BLOCK * near,
                        table,
                        bits,
                        r,
                        at,
                        low,
                        high,
                        side,
                        threshold,
                        bright,
                        place,
                        width,
                    )


# The compiler uses vector instructions for these five: strides are literal, nothing else is in the loop, and an unsigned
# index is not looked at for being negative.


@njit(cache=True, nogil=True)
def copy_third(source, begin, line, count):  # type: ignore[no-untyped-def]
    for c in range(count):
        line[np.uintp(c)] = source[np.uintp(begin + 3 * c)]


@njit(cache=True, nogil=True)
def _copy(source, begin, line, count):  # type: ignore[no-untyped-def]
    for c in range(count):
        line[np.uintp(c)] = source[np.uintp(begin + c)]


@njit(cache=True, nogil=True)
def _sum_blocks(line, total, begin, count):  # type: ignore[no-untyped-def]
    for b in range(count):
        k = 4 * b
        total[np.uintp(begin + b)] = (
            np.int32(line[np.uintp(k)])
            + np.int32(line[np.uintp(k + 1)])
            + np.int32(line[np.uintp(k + 2)])
            + np.int32(line[np.uintp(k + 3)])
        )


@njit(cache=True, nogil=True)
def _stand_out(total, rise, begin, count):  # type: ignore[no-untyped-def]
    """Twice what two blocks hold, less what those AWAY to either side hold."""
    for b in range(begin, begin + count):
        left, right = total[np.uintp(b - 4)] + total[np.uintp(b - 3)], total[np.uintp(b + 4)] + total[np.uintp(b + 5)]
        rise[np.uintp(b)] = 2 * (total[np.uintp(b)] + total[np.uintp(b + 1)]) - left - right


@njit(cache=True, nogil=True)
def _mark_peaks(rise, least, begin, marks, count):  # type: ignore[no-untyped-def]
    """1 where rise is above `least`, above what is before it and not below what is after it."""
    for m in range(count):
        b = begin + m
        here = rise[np.uintp(b)]
        marks[np.uintp(m)] = (here > least) & (here > rise[np.uintp(b - 1)]) & (here >= rise[np.uintp(b + 1)])


@njit(cache=True, nogil=True)
def _keep(  # type: ignore[no-untyped-def]
    image, line, end, origin, table, bits, r, begin, first, last, side, least, bright, place, width
):
    """Keep the peak within the two blocks at `begin`, if its colour is the laser's, in order of its height.

    line: the laser's channel of row r from column `origin` on, up to index `end`; begin: an index of it.
    """
    low, high = max(begin - 1, 1), min(begin + 2 * BLOCK, end - 1)
    peak, top = low, np.int32(-1)
    before, here = np.int32(line[low - 1]), np.int32(line[low])
    for c in range(low, high + 1):
        after = np.int32(line[c + 1])
        value = before + 2 * here + after
        if value > top:
            top = value
            peak = c
        before, here = here, after
    height = 0.25 * top - side
    if height <= least:
        return
    if image.shape[2] == 3:
        shift = 8 - bits
        passed = False
        for c in range(origin + peak - 1, origin + peak + 2):
            b, g, red = image[r, c, 0] >> shift, image[r, c, 1] >> shift, image[r, c, 2] >> shift
            passed |= table[(b << (2 * bits)) | (g << bits) | red] > 0
        if not passed:
            return
    half = side + 0.5 * height
    dim = np.int32(half)
    left = peak
    while left > 0 and peak - left < 2 * AWAY and line[left] > dim:
        left -= 1
    right = peak
    while right < end and right - peak < 2 * AWAY and line[right] > dim:
        right += 1
    a0, a1 = float(line[left]), float(line[min(left + 1, end)])
    b0, b1 = float(line[right]), float(line[max(right - 1, 0)])
    x0 = left + (half - a0) / (a1 - a0) if a1 > half >= a0 else float(left)
    x1 = right - (half - b0) / (b1 - b0) if b1 > half >= b0 else float(right)
    middle = origin + 0.5 * (x0 + x1)
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
    root, wide_root = np.exp(-0.5 / start**2), np.exp(-1.0 / (4.5 * start**2))
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
            begin = int(x) - reach
            d = (begin - x) / start
            bell, wide_bell = np.exp(-0.5 * d * d), np.exp(-d * d / 4.5)
            ratio, wide_ratio = np.exp(-d / start) * root, np.exp(-d / (2.25 * start)) * wide_root
            for c in range(begin, begin + 2 * reach + 2):
                value = float(image[r, c, channel])
                clipped += value >= CLIPPED
                tilt += d * bell * value
                fine += (1.0 - d * d) * bell * value
                coarse += (1.0 - d * d / 2.25) * wide_bell * value
                # a Gaussian at even steps without its exponential: the ratio of neighbours is itself geometric
                bell *= ratio
                ratio *= root * root
                wide_bell *= wide_ratio
                wide_ratio *= wide_root * wide_root
                d += 1.0 / start
            if fine <= 0.0:
                break
            if turn < 2:
                x += min(max(start * tilt / fine, -start), start)
        if fine > 0.0 and coarse > 0.0 and clipped < 12 * start:
            share = (coarse / (3.375 * fine)) ** (2.0 / 3.0)
            if 1.0 / 2.25 < share < 1.0:
                found[n] = start * np.sqrt((2.25 * share - 1.0) / (1.0 - share))
                n += 1
    return np.median(found[:n]) if n >= 4 else start


@njit(cache=True, nogil=True)
def noise_of(image, channel, first, last, step):  # type: ignore[no-untyped-def]
    """1 sigma of a dark pixel's noise: second differences within the window of every `step`-th row, away from the
    brightest pixel, which may be the stripe."""
    rows, columns = image.shape[0], image.shape[1]
    histogram = np.zeros(1024, np.int64)
    n = 0
    for r in range(step // 2, rows, step):
        begin, end = max(int(first[r]), 2), min(int(last[r]) + 1, columns - 2)
        top, at = np.int64(-1), 0
        for c in range(begin, end, 3):
            if image[r, c, channel] > top:
                top = np.int64(image[r, c, channel])
                at = c
        for c in range(begin, end, 3):
            if abs(c - at) < AWAY // 2:
                continue
            d = np.int64(image[r, c - 1, channel]) - 2 * np.int64(image[r, c, channel]) + image[r, c + 1, channel]
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
