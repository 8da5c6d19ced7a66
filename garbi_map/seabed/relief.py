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


def relief_of(elevation: Floats, cell: float, scale: float) -> Floats:
    """Elevation (rows, columns) m less what is broader than `scale` m; NaN where not known."""
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(elevation)
    share = gaussian_filter(known.astype(np.float64), scale / cell, mode="constant")
    broad = gaussian_filter(np.where(known, elevation, 0.0), scale / cell, mode="constant") / np.maximum(share, _EMPTY)
    return np.where(known, elevation - broad, np.nan)


def find_shifts(
    known: Floats, points: Floats, headings: Floats, cell: float, least_overlap: float, most: int
) -> list[Guess]:
    """The best guesses, at most `most`, the best first, of how points (n, 3) lie on the known (m, 3), both m.

    Masked normalised cross-correlation by FFT (Padfield, IEEE Transactions on Image Processing 21(5), 2012).
    least_overlap is in m^2.
    """
    extent = max(np.ptp(known[:, :2], axis=0).max(), np.ptp(points[:, :2], axis=0).max())
    cell = max(cell, 2 * float(extent) / _LARGEST)
    fixed, low = _gridded(known, cell)
    centre = points[:, :2].mean(axis=0)
    across = 2 * float(np.linalg.norm(points[:, :2] - centre, axis=1).max())
    search = _Search(fixed, int(np.ceil(across / cell)) + 2)
    guesses = []
    for heading in headings:
        c, s = np.cos(heading), np.sin(heading)
        turned = np.column_stack([(points[:, :2] - centre) @ np.array([[c, s], [-s, c]]), points[:, 2]])
        moving, corner = _gridded(turned, cell)
        evidence = search.evidence(moving, least_overlap / cell**2) * (cell / _INDEPENDENT) ** 2
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


def _gridded(points: Floats, cell: float) -> tuple[Floats, Floats]:
    """The relief (rows, columns) of points (n, 3), NaN where nothing is, and the centre (2,) of the first cell."""
    index = np.floor(points[:, :2] / cell).astype(np.int64)
    low = index.min(axis=0)
    column, row = (index - low).T
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    flat = row * shape[1] + column
    count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
    height = points[:, 2] - points[:, 2].mean()
    total = np.bincount(flat, height, minlength=shape[0] * shape[1]).reshape(shape)
    mean = np.divide(total, count, out=np.full(shape, np.nan), where=count > 0)
    return relief_of(mean, cell, _SMOOTH), (low + 0.5) * cell


class _Search:
    """A relief (rows, columns) in which others of at most `most` cells along a side are looked for."""

    def __init__(self, fixed: Floats, most: int) -> None:
        from scipy.fft import next_fast_len

        self._shape = fixed.shape
        self._size = [next_fast_len(length + most - 1, real=True) for length in fixed.shape]
        self._spectra = self._of(fixed)

    def _of(self, grid: Floats) -> list[NDArray]:
        """Spectra of where it is known, of its values in their standard deviations, and of their squares."""
        from scipy.fft import rfft2

        hit = np.isfinite(grid)
        value = np.where(hit, grid, 0.0)
        value *= 1.0 / max(float(value[hit].std()), _EMPTY)
        return [rfft2(part, self._size) for part in (hit.astype(np.float64), value, value**2)]

    def evidence(self, moving: Floats, least: float) -> Floats:
        """For every lag of `moving`: common cells n and their correlation r as -n/2 ln(1 - r^2), the logarithm of the
        likelihood ratio; 0 where r is negative or n is less than `least`."""
        from scipy.fft import irfft2

        shape = [a + b - 1 for a, b in zip(self._shape, moving.shape, strict=True)]

        def back(product: NDArray) -> Floats:
            out: Floats = irfft2(product, self._size)[: shape[0], : shape[1]]
            return out

        (hit_f, one_f, two_f), (hit_m, one_m, two_m) = self._spectra, self._of(moving[::-1, ::-1])
        common = np.maximum(np.rint(back(hit_f * hit_m)), 1.0)
        sum_f, sum_m = back(one_f * hit_m), back(hit_f * one_m)
        covariance = back(one_f * one_m) - sum_f * sum_m / common
        variance_f = np.maximum(back(two_f * hit_m) - sum_f**2 / common, 0.0)
        variance_m = np.maximum(back(hit_f * two_m) - sum_m**2 / common, 0.0)
        scale = np.sqrt(variance_f * variance_m)
        known = (common >= least) & (scale > 1e-3 * common)
        r = np.where(known, np.clip(covariance / np.maximum(scale, _EMPTY), 0.0, 0.9999), 0.0)
        return -0.5 * common * np.log1p(-(r**2))
