"""Small holes, closed for what is only looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fill_holes(elevation: NDArray, width: int) -> tuple[NDArray, NDArray[np.bool_]]:
    """Close gaps (NaN) of up to `width` cells between two known cells of a row or of a column, linearly.

    Returns the elevation (rows, columns) and which cells were interpolated.
    """
    known = np.isfinite(elevation)
    total = np.zeros(elevation.shape)
    count = np.zeros(elevation.shape, np.int32)
    for values, mask, sums, counts in (
        (elevation, known, total, count),
        (elevation.T, known.T, total.T, count.T),
    ):
        flat = np.where(mask, np.arange(mask.shape[1]), -1)
        before = np.maximum.accumulate(flat, 1)
        after = np.where(mask, np.arange(mask.shape[1]), mask.shape[1])
        after = np.minimum.accumulate(after[:, ::-1], 1)[:, ::-1]
        row, column = np.nonzero(~mask & (before >= 0) & (after < mask.shape[1]) & (after - before - 1 <= width))
        left, right = before[row, column], after[row, column]
        share = (column - left) / (right - left)
        sums[row, column] += values[row, left] * (1 - share) + values[row, right] * share
        counts[row, column] += 1
    filled = count > 0
    return np.where(filled, total / np.maximum(count, 1), elevation).astype(elevation.dtype), filled
