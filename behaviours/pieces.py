"""Which points of a profile hang together: a surface shows a piece of line, a flake of snow a dot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Floats

ROW_GAP, STEP = 4, 0.12  # rows, m between neighbours of one piece
EXTENT = 0.12  # m, of a piece that neither a flake nor a few in a row reach


def solid(row: NDArray[np.int32], depth: Floats, rad_per_row: float) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """(n,) whether each point belongs to a piece long enough to be a surface; (n,) the number of its piece.

    row (n,) ascending, depth (n,) m, rad_per_row: angle between image rows."""
    if len(row) == 0:
        return np.zeros(0, bool), np.zeros(0, np.int64)
    broken = (np.diff(row) > ROW_GAP) | (np.abs(np.diff(depth)) > STEP)
    piece = np.r_[0, np.cumsum(broken)].astype(np.int64)
    first = np.r_[0, np.flatnonzero(broken) + 1]
    last = np.r_[np.flatnonzero(broken), len(row) - 1]
    extent = (row[last] - row[first]) * rad_per_row * depth[first]
    return (extent >= EXTENT)[piece], piece
