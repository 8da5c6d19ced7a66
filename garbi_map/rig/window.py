"""The window that a laser in a housing shines through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from garbi_map.log.records import Floats

KINDS = ("flat", "turning", "cylinder")


@dataclass(frozen=True)
class LaserWindow:
    """A window between the laser, in air, and the water. The sheet fans out from the apex.

    kind          "flat": fixed in the rig; "turning": flat, on the laser; "cylinder": coaxial with the laser's axis
    normal        unit, pointing out: rig frame (flat), or the laser's, x along the sheet (turning); a cylinder has none
    distance      apex to the inner face along the normal, or the cylinder's inner radius, m
    thickness     m
    index_glass   refractive index of the window, relative to the air inside
    index_water   of the medium outside
    """

    kind: Literal["flat", "turning", "cylinder"]
    normal: tuple[float, float, float]
    distance: float
    thickness: float
    index_glass: float
    index_water: float

    @property
    def parameters(self) -> Floats:
        """(8,) as the kernels take them."""
        numbers = [*self.normal, self.distance, self.thickness, self.index_glass, self.index_water]
        return np.array([float(KINDS.index(self.kind)), *numbers])
