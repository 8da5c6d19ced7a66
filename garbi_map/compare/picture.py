"""What changed, seen from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from garbi_map.compare.change import Change
from garbi_map.compare.patches import Patch
from garbi_map.export.hillshade import relief
from garbi_map.export.settings import ExportSettings

_RISEN, _FALLEN = (60, 72, 214), (220, 120, 40)  # blue, green, red, as OpenCV wants it
_VOID = (246, 243, 240)
_PIXELS = 1400
"""Of the longer side, about."""


def picture(change: Change, patches: Sequence[Patch], labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(rows, columns, 3), blue, green, red, north up: shaded relief, what has risen red, what has fallen blue."""
    import cv2

    own = ExportSettings()
    shade = relief(change.elevation.astype(np.float32), change.cell, own.sun_azimuth, own.sun_elevation, 1.0)
    grey = np.clip(168 * shade, 0, 255)
    grey[~(change.compared | (labels > 0))] *= 0.45
    image = np.repeat(grey[..., None], 3, axis=2)
    rise = np.nan_to_num(change.rise)
    for colour, mask in ((_RISEN, (labels > 0) & (rise > 0)), (_FALLEN, (labels > 0) & (rise <= 0))):
        image[mask] = 0.25 * image[mask] + 0.75 * np.array(colour) * np.clip(shade[mask], 0.5, 1.2)[:, None]
    image[~np.isfinite(change.elevation)] = _VOID
    factor = max(1, _PIXELS // max(labels.shape))
    large = np.repeat(np.repeat(np.clip(image, 0, 255).astype(np.uint8)[::-1], factor, 0), factor, 1)
    large = np.ascontiguousarray(large)
    for patch in patches:
        column = int((patch.place[0] - change.origin[0]) / change.cell * factor)
        row = large.shape[0] - int((patch.place[1] - change.origin[1]) / change.cell * factor)
        if patch.move is not None:
            end = (column + int(patch.move[0] / change.cell * factor), row - int(patch.move[1] / change.cell * factor))
            cv2.arrowedLine(large, (column, row), end, (20, 20, 20), 2, cv2.LINE_AA, tipLength=0.2)
        for colour, width in (((255, 255, 255), 4), ((20, 20, 20), 1)):
            cv2.putText(large, str(patch.number), (column + 6, row - 6), 0, 0.6, colour, width, cv2.LINE_AA)
    return large
