"""Where, roughly, one relief lies in another: every heading and every shift, by correlation of elevation grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import gaussian_filter, maximum_filter

from garbi_map.compare.maps import MapFolder
from garbi_map.compare.settings import AlignmentSettings

Floats = NDArray[np.float64]

_MOST_CELLS = 400
"""Along a side of the grid that is searched."""
_CLIP = 3.0
"""Standard deviations beyond which a tall thing counts no more: it may be what has moved."""


@dataclass(frozen=True)
class Guess:
    """x_a = R(yaw) x_b + shift (2,) m, and how well the reliefs agree there: correlation times root of the overlap."""

    yaw: float
    shift: Floats
    score: float


def relief_of(elevation: Floats, cell: float, scale: float) -> Floats:
    """Elevation (rows, columns) less what is broader than `scale` m; NaN where not known."""
    known = np.isfinite(elevation)
    sigma = scale / cell
    weight = gaussian_filter(known.astype(float), sigma, mode="constant")
    broad = gaussian_filter(np.where(known, elevation, 0.0), sigma, mode="constant") / np.maximum(weight, 1e-9)
    return np.where(known, elevation - broad, np.nan)


def guesses(first: MapFolder, second: MapFolder, settings: AlignmentSettings, most: int = 6) -> list[Guess]:
    """The best places of the second map in the first, best first: all headings, all shifts that overlap enough.

    Correlation of partly known images over all shifts at once: Padfield, Masked object registration in the Fourier
    domain, 2012.
    """
    extent = max(max(one.elevation.shape) * one.cell for one in (first, second))
    cell = max(settings.coarse_cell, extent / _MOST_CELLS, first.cell, second.cell)
    still, origin = _gridded(_points(first, settings), cell)
    loose = _points(second, settings)
    middle = loose[:, :2].mean(0)
    size = int(np.ceil(2 * np.linalg.norm(loose[:, :2] - middle, axis=1).max() / cell)) + 3
    shape = tuple(fft.next_fast_len(side + size, real=True) for side in still.shape)
    fixed = [fft.rfft2(image, shape) for image in _images(still)]
    need = settings.least_overlap * min(np.isfinite(still).sum(), np.isfinite(_gridded(loose, cell)[0]).sum())
    found: list[Guess] = []
    for yaw in np.radians(np.arange(-180.0, 180.0, settings.yaw_step)):
        c, s = np.cos(yaw), np.sin(yaw)
        turned = np.c_[(loose[:, :2] - middle) @ np.array([[c, s], [-s, c]]), loose[:, 2]]
        image, corner = _gridded(turned, cell)
        score = _correlation(fixed, image, shape, need)
        peaks = np.argwhere((score == maximum_filter(score, 5)) & (score > 0))
        for peak in sorted(peaks, key=lambda at: -score[tuple(at)])[:2]:
            lag = np.where(peak >= np.array(shape) - image.shape, peak - np.array(shape), peak)[::-1]
            shift = origin + lag * cell - corner
            turn = np.array([[c, -s], [s, c]])
            found.append(Guess(float(yaw), shift - turn @ middle, float(score[tuple(peak)])))
    return sorted(found, key=lambda guess: -guess.score)[:most]


def _points(one: MapFolder, settings: AlignmentSettings) -> Floats:
    """Known cells (k, 3): x, y and the clipped relief, in its standard deviations."""
    relief = relief_of(one.elevation, one.cell, settings.relief_scale)
    points = one.cells()
    values = relief[one.known]
    scale = max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-9)
    points[:, 2] = np.clip(values / scale, -_CLIP, _CLIP)
    return points


def _gridded(points: Floats, cell: float) -> tuple[Floats, Floats]:
    """Mean of the values of points (k, 3) per cell, NaN where there are none, and the (x, y) of cell (0, 0)."""
    low = points[:, :2].min(0)
    index = np.floor((points[:, :2] - low) / cell).astype(int)
    columns, rows = index.max(0) + 1
    flat = index[:, 1] * columns + index[:, 0]
    count = np.bincount(flat, minlength=rows * columns)
    total = np.bincount(flat, points[:, 2], minlength=rows * columns)
    image = np.divide(total, count, out=np.full(rows * columns, np.nan), where=count > 0)
    return image.reshape(rows, columns), low


def _images(image: Floats) -> tuple[Floats, Floats, Floats]:
    known = np.isfinite(image)
    values = np.where(known, image - np.nanmean(image), 0.0)
    return values, known.astype(float), values**2


def _correlation(fixed: list[NDArray], image: Floats, shape: tuple[int, ...], need: float) -> Floats:
    """Score of every shift of `image`, cyclic; zero where fewer than `need` cells overlap."""
    values, known, squares = (fft.rfft2(one, shape).conj() for one in _images(image))

    def summed(a: NDArray, b: NDArray) -> Floats:
        return fft.irfft2(a * b, shape)

    overlap = summed(fixed[1], known)
    energy = summed(fixed[2], known) * summed(fixed[1], squares)
    good = (overlap >= need) & (energy > 1e-9)
    both = summed(fixed[0], values)
    share = np.divide(both, np.sqrt(np.maximum(energy, 1e-12)), out=np.zeros(shape), where=good)
    return share * np.sqrt(np.where(good, overlap, 0.0) / max(float(overlap.max()), 1.0))
