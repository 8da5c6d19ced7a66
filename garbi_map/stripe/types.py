"""The laser line in one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Stripe:
    """The rows of one image in which the laser was found, in ascending order.

    row        (n,) int32, pixel row (centre of row v is at v)
    u          (n,) float32, sub-pixel column (centre of column u is at u)
    sigma      (n,) float32, 1-sigma of u, px
    intensity  (n,) float32, peak above background in the laser's channel, 0..255
    saturated  (n,) bool, the peak is clipped
    """

    stamp_ns: int
    row: NDArray[np.int32]
    u: NDArray[np.float32]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    saturated: NDArray[np.bool_]
