"""Where one relief lies in another: normalised correlation of elevation grids over all shifts and some headings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SMOOTH = 0.25
"""m; what is longer than this is taken away, for tilts and depths differ between dives."""
_LARGEST = 2048
"""Cells along a side, beyond which they are made larger."""
_INDEPENDENT = 0.1
"""m; nearer places of a relief tell nearly the same."""
_PEAKS = 3
"""Of each heading that are handed on."""
_EMPTY = 1e-9


@dataclass(frozen=True)
class Guess:
    """A turn about the vertical, rad, then a shift (2,) m, that lays the second relief on the first.

    evidence: how much better the two then explain each other than by chance, in nats per independent patch; a high
    correlation over a corner is less than a good one over a large common ground.
    """

    heading: float
    shift: Floats
    evidence: float


def find_shifts(
    known: Floats, points: Floats, headings: Floats, cell: float, least_overlap: float, most: int
) -> list[Guess]:
    """The best guesses, at most `most`, the best first, of how points (n, 3) lie on the known (m, 3), both m.

    Masked normalised cross-correlation by FFT (Padfield, IEEE Transactions on Image Processing 21(5), 2012).
    least_overlap is in m^2.
    """
    extent = max(np.ptp(known[:, :2], axis=0).max(), np.ptp(points[:, :2], axis=0).max())
    cell = max(cell, 2 * float(extent) / _LARGEST)
    fixed, low = _relief(known, cell)
    centre = points[:, :2].mean(axis=0)
    guesses = []
    for heading in headings:
        c, s = np.cos(heading), np.sin(heading)
        turned = np.column_stack([(points[:, :2] - centre) @ np.array([[c, s], [-s, c]]), points[:, 2]])
        moving, corner = _relief(turned, cell)
        evidence = _correlate(fixed, moving, least_overlap / cell**2) * (cell / _INDEPENDENT) ** 2
        for _ in range(_PEAKS):
            row, column = np.unravel_index(int(np.argmax(evidence)), evidence.shape)
            best = float(evidence[row, column])
            if best <= 0:
                break
            lag = np.array([column, row]) - np.array(moving.shape[::-1]) + 1
            shift = low + lag * cell - corner  # of what was turned about the centre
            guesses.append(Guess(float(heading), shift - np.array([[c, -s], [s, c]]) @ centre, best))
            around = max(2, round(0.1 / cell))
            evidence[max(0, row - around) : row + around + 1, max(0, column - around) : column + around + 1] = 0
    return sorted(guesses, key=lambda guess: -guess.evidence)[:most]


def _relief(points: Floats, cell: float) -> tuple[NDArray[np.float32], Floats]:
    """Heights (rows, columns) without their long waves, NaN where nothing is, and the centre (2,) of the first cell."""
    from scipy.ndimage import gaussian_filter

    index = np.floor(points[:, :2] / cell).astype(np.int64)
    low = index.min(axis=0)
    column, row = (index - low).T
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    flat = row * shape[1] + column
    count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
    height = points[:, 2] - points[:, 2].mean()
    total = np.bincount(flat, height, minlength=shape[0] * shape[1]).reshape(shape)
    hit = count > 0
    mean = np.divide(total, count, out=np.zeros(shape), where=hit)
    share = gaussian_filter(hit.astype(np.float64), _SMOOTH / cell, mode="constant")
    smooth = gaussian_filter(mean, _SMOOTH / cell, mode="constant") / np.maximum(share, _EMPTY)
    return np.where(hit, mean - smooth, np.nan).astype(np.float32), (low + 0.5) * cell


def _correlate(fixed: NDArray[np.float32], moving: NDArray[np.float32], least: float) -> Floats:
    """For every lag of `moving` in `fixed`: common cells n and their correlation r as -n/2 ln(1 - r^2), the logarithm of the
    likelihood ratio; 0 where r is negative or n is less than `least`."""
    from scipy.fft import irfft2, next_fast_len, rfft2

    shape = [a + b - 1 for a, b in zip(fixed.shape, moving.shape, strict=True)]
    size = [next_fast_len(length, real=True) for length in shape]

    def spectra(grid: NDArray[np.float32], flipped: bool) -> list[NDArray]:
        hit = np.isfinite(grid)
        value = np.where(hit, grid, 0.0).astype(np.float64)
        value *= 1.0 / max(float(value[hit].std()), _EMPTY)
        parts = (hit.astype(np.float64), value, value**2)
        return [rfft2(part[::-1, ::-1] if flipped else part, size) for part in parts]

    def back(product: NDArray) -> Floats:
        out: Floats = irfft2(product, size)[: shape[0], : shape[1]]
        return out

    (hit_f, one_f, two_f), (hit_m, one_m, two_m) = spectra(fixed, False), spectra(moving, True)
    common = np.maximum(np.rint(back(hit_f * hit_m)), 1.0)
    sum_f, sum_m = back(one_f * hit_m), back(hit_f * one_m)
    covariance = back(one_f * one_m) - sum_f * sum_m / common
    variance_f = np.maximum(back(two_f * hit_m) - sum_f**2 / common, 0.0)
    variance_m = np.maximum(back(hit_f * two_m) - sum_m**2 / common, 0.0)
    scale = np.sqrt(variance_f * variance_m)
    known = (common >= least) & (scale > 1e-3 * common)
    r = np.where(known, np.clip(covariance / np.maximum(scale, _EMPTY), 0.0, 0.9999), 0.0)
    return -0.5 * common * np.log1p(-(r**2))
