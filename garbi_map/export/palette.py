"""Colours of depth, one ramp for every product."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.seabed.types import Mesh

# deep to shallow, sRGB; lightness rises all the way, so that it also reads in grey
_ANCHORS = np.array(
    [[22, 30, 82], [27, 74, 128], [30, 116, 148], [50, 156, 152], [112, 191, 146], [188, 219, 152], [250, 240, 190]],
    np.float64,
)


def depth_colours(height: NDArray, low: float, high: float) -> NDArray[np.uint8]:
    """sRGB (..., 3) of heights (...), m: dark blue at `low` and below, pale at `high` and above; any where NaN."""
    share = np.clip((np.nan_to_num(height) - low) / max(high - low, 1e-9), 0.0, 1.0) * (len(_ANCHORS) - 1)
    index = np.arange(len(_ANCHORS))
    return np.stack([np.interp(share, index, _ANCHORS[:, k]) for k in range(3)], -1).round().astype(np.uint8)


def height_range(height: NDArray) -> tuple[float, float]:
    """What the ramp spans: all but half a percent of the finite heights at either end, m."""
    finite = height[np.isfinite(height)]
    low, high = np.percentile(finite, [0.5, 99.5])
    return float(low), float(max(high, low + 1e-3))


def mesh_colours(mesh: Mesh) -> NDArray[np.float64]:
    """sRGB (v, 3), 0 to 1, of a surface's vertices by their height; greyed where interpolated over a hole."""
    height = mesh.vertices[:, 2]
    colours = depth_colours(height, *height_range(height)) / 255.0
    colours[mesh.filled] = 0.5 * colours[mesh.filled] + 0.5 * colours[mesh.filled].mean(1, keepdims=True)
    return colours
