"""Where, roughly, one map lies in another: every heading and every shift that overlaps enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.compare.maps import MapFolder
from garbi_map.compare.settings import AlignmentSettings
from garbi_map.seabed.relief import Guess, find_shifts, relief_of

Floats = NDArray[np.float64]

_MOST_CELLS = 400
"""Along a side of the grid that is searched."""
_CLIP = 3.0
"""Standard deviations beyond which a tall thing counts no more: it may be what has moved."""


def guesses(first: MapFolder, second: MapFolder, settings: AlignmentSettings, most: int = 6) -> list[Guess]:
    """The best places of the second map in the first, best first."""
    extent = max(max(one.elevation.shape) * one.cell for one in (first, second))
    cell = max(settings.coarse_cell, extent / _MOST_CELLS, first.cell, second.cell)
    area = min(np.count_nonzero(one.known) * one.cell**2 for one in (first, second))
    headings = np.radians(np.arange(-180.0, 180.0, settings.yaw_step))
    still, loose = (_points(one, settings) for one in (first, second))
    return find_shifts(still, loose, headings, cell, settings.least_overlap * area, most)


def _points(one: MapFolder, settings: AlignmentSettings) -> Floats:
    """Known cells (k, 3): x, y and the clipped relief, in its standard deviations."""
    values = relief_of(one.elevation, one.cell, settings.relief_scale)[one.known]
    scale = max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-9)
    points = one.cells()
    points[:, 2] = np.clip(values / scale, -_CLIP, _CLIP)
    return points
