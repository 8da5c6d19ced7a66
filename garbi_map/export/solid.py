"""The seabed in three dimensions, walls and overhangs included, of the points of a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.export.georeference import Georeference
from garbi_map.log.records import Mount
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import Mesh, SolidSettings, SolidSurface

_AT_ONCE = 500_000
"""Points that are read at once."""


def surface_of(
    cloud: Path, trajectory: Trajectory, mount: Mount, settings: SolidSettings, reference: Georeference | None = None
) -> Mesh:
    """The surface, in `map`, of the points of cloud.laz, each seen from where the rig was at its time.

    trajectory: map <- base_link; mount: base_link <- rig; reference: what the cloud was written with.
    Raises GarbiError where there are too few points.
    """
    import laspy

    solid, reference = SolidSurface(settings), reference or Georeference()
    with laspy.open(cloud) as file:
        for chunk in file.chunk_iterator(_AT_ONCE):
            points = reference.unplaced(
                np.stack([np.asarray(chunk.x), np.asarray(chunk.y), np.asarray(chunk.z)], axis=1)
            )
            stamps, member = np.unique(np.round(np.asarray(chunk.gps_time) * 1e9).astype(np.int64), return_inverse=True)
            solid.add(points, trajectory.at(stamps).mounted(mount).position[member.ravel()])
    return solid.finish()
