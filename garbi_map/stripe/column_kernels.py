"""Compiled correlations about candidates: the column to a fraction of a pixel, and what the water does to it."""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.stripe.kernels import CANDIDATES, CLIPPED, HEIGHT, copy_third


@njit(cache=True, nogil=True)
def refine(image, channel, place, slope, curvature, water, rest, spread, least, u, gain, pull, noise, clipped):  # type: ignore[no-untyped-def]
    """Each candidate's column u (h, 3), where its correlation with `slope` is zero, NaN where it is not `least` high.

    The tables are those of Templates. gain (h, 3): grey levels by which the correlation changes per px; pull (h, 3):
    what the water adds to the correlation; noise (h, 3): response of `rest`; clipped (h, 3) bool.
    """
    rows, columns = image.shape[0], image.shape[1]
    flat = image.reshape(-1)
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
            _copy_row(image, flat, r, channel, origin, row)
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
                tilt = _dot(slope, phase, row, at)
                bend = _dot(curvature, phase, row, at)
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
            top = max(row[at + reach], row[at + reach + 1])
            u[r, k] = x
            whole = base - reach - wing >= 0 and base + reach + wing + 1 < columns
            pull[r, k] = _dot(water, phase, row, at - wing) if whole else np.nan
            noise[r, k] = _dot(rest, phase, row, at)
            clipped[r, k] = top >= CLIPPED


@njit(cache=True, nogil=True)
def measure_again(image, channel, chosen, slope, curvature, water, spread, off, u, gain, pull):  # type: ignore[no-untyped-def]
    """gain and pull of the chosen candidates about their columns u (h, 3), from which the water's pull off (h,) px was
    taken; u becomes where the correlation with `slope` would be zero if it went on as it does there, or as it was."""
    columns = image.shape[1]
    flat = image.reshape(-1)
    phases, taps = slope.shape
    reach = taps // 2 - 1
    wing = (water.shape[1] - taps) // 2
    row = np.empty(water.shape[1], np.float32)
    for r in range(len(chosen)):
        k = chosen[r]
        if k < 0:
            continue
        base = int(u[r, k])
        phase = int((u[r, k] - base) * phases + 0.5)
        if phase == phases:
            base += 1
            phase = 0
        origin = base - reach - wing
        if not 0 <= origin <= columns - len(row):
            u[r, k] += off[r]
            pull[r, k] = np.nan
            continue
        _copy_row(image, flat, r, channel, origin, row)
        bend = _dot(curvature, phase, row, wing) / spread
        if bend < 0.5 * gain[r, k]:
            u[r, k] += off[r]
            pull[r, k] = np.nan
            continue
        gain[r, k] = bend
        u[r, k] = base + phase / phases + _dot(slope, phase, row, wing) / bend
        pull[r, k] = _dot(water, phase, row, 0)


@njit(cache=True, nogil=True, inline="always")
def _copy_row(image, flat, r, channel, origin, row):  # type: ignore[no-untyped-def]
    """The laser's channel of row r from column `origin` on; beyond the image as at its edge."""
    columns, depth = image.shape[1], image.shape[2]
    if depth == 3 and origin >= 0 and origin + len(row) <= columns:
        copy_third(flat, 3 * (r * columns + origin) + channel, row, len(row))
    else:
        for j in range(len(row)):
            row[j] = image[r, min(max(origin + j, 0), columns - 1), channel]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _dot(kernel, phase, line, begin):  # type: ignore[no-untyped-def]
    total = np.float32(0.0)
    for j in range(kernel.shape[1]):
        total += kernel[np.uintp(phase), np.uintp(j)] * line[np.uintp(begin + j)]
    return total
