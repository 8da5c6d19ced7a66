"""Where on Earth `map` is."""

from __future__ import annotations

from dataclasses import dataclass

LOCAL_WKT = (
    'LOCAL_CS["garbi map frame: local, origin at the first pose, not georeferenced",'
    'UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)


@dataclass(frozen=True)
class Georeference:
    """A coordinate reference system (WKT), and what has to be added to `map` coordinates to be in it, m.

    The default is an engineering frame that says that it is local.
    """

    wkt: str = LOCAL_WKT
    easting: float = 0.0
    northing: float = 0.0
    height: float = 0.0
