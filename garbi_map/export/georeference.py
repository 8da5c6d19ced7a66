"""From `map` to the coordinates that files are written in, and back."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOCAL_WKT = (
    'LOCAL_CS["garbi map frame: local, origin at the first pose, not georeferenced",'
    'UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)


@dataclass(frozen=True)
class Georeference:
    """The coordinate reference system of the files, and how `map` lies in it.

    easting = shift[0] + scale x, northing = shift[1] + scale y, height = shift[2] + z: the map's axes are the grid's, its
    metres are those of the ground, and one of them is `scale` of the grid's.

    wkt     of the compound system; the default is an engineering system that says that it is local
    shift   (east, north, up) of the map's origin, m
    scale   of the projection at the map's origin
    """

    wkt: str = LOCAL_WKT
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0

    @property
    def is_local(self) -> bool:
        """Whether nobody knows where on Earth the map is."""
        return self.wkt.startswith("LOCAL_CS")

    def placed(self, points: Floats) -> Floats:
        """Coordinates (n, 3) of points (n, 3) in `map`."""
        return points * (self.scale, self.scale, 1.0) + self.shift

    def unplaced(self, coordinates: Floats) -> Floats:
        """Points (n, 3) in `map` of coordinates (n, 3)."""
        return (coordinates - self.shift) / (self.scale, self.scale, 1.0)

    def from_map(self) -> dict[str, Any]:
        """Scale and shift as a dictionary, for files that carry them; `from_dictionary` is the way back."""
        entries = asdict(self)
        del entries["wkt"]
        return entries

    @classmethod
    def from_dictionary(cls, entries: dict[str, Any], wkt: str = LOCAL_WKT) -> Georeference:
        """What `from_map` gave. Raises KeyError, TypeError or ValueError where it is something else."""
        east, north, up = (float(value) for value in entries["shift"])
        return cls(wkt, (east, north, up), float(entries["scale"]))
