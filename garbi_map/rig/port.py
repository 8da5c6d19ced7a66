"""The flat window that a camera in a housing looks through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats


@dataclass(frozen=True)
class Port:
    """A flat window between air, where the camera is calibrated, and water.

    normal        unit, camera optical frame, pointing out
    distance      pinhole to the inner face along the normal, m
    thickness     m
    index_glass   refractive index of the window, relative to the air inside
    index_water   of the medium outside
    """

    normal: tuple[float, float, float]
    distance: float
    thickness: float
    index_glass: float
    index_water: float

    @property
    def parameters(self) -> Floats:
        """(7,) as the kernels take them."""
        return np.array([*self.normal, self.distance, self.thickness, self.index_glass, self.index_water])
