"""surface.ply: the seabed in three dimensions, walls and overhangs included."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.aside import written_aside
from garbi_map.export.palette import depth_colours, height_range
from garbi_map.log.records import Mount
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import Mesh, SolidSettings, SolidSurface

_AT_ONCE = 500_000
"""Points that are read at once."""


def surface_of(cloud: Path, trajectory: Trajectory, mount: Mount, settings: SolidSettings) -> Mesh:
    """The surface of the points of cloud.laz, each seen from where the rig was at its time.

    trajectory: map <- base_link; mount: base_link <- rig. Raises GarbiError where there are too few points.
    """
    import laspy

    solid = SolidSurface(settings)
    with laspy.open(cloud) as file:
        for chunk in file.chunk_iterator(_AT_ONCE):
            points = np.stack([np.asarray(chunk.x), np.asarray(chunk.y), np.asarray(chunk.z)], axis=1)
            stamps, member = np.unique(np.round(np.asarray(chunk.gps_time) * 1e9).astype(np.int64), return_inverse=True)
            solid.add(points, trajectory.at(stamps).mounted(mount).position[member.ravel()])
    return solid.finish()


def write_surface_ply(path: Path, mesh: Mesh) -> None:
    """Binary PLY in `map`, float64, coloured by depth. Raises GarbiError where the file cannot be written."""
    vertex = np.zeros(len(mesh.vertices), [("place", "<f8", 3), ("colour", "u1", 3)])
    vertex["place"] = mesh.vertices
    vertex["colour"] = depth_colours(mesh.vertices[:, 2], *height_range(mesh.vertices[:, 2]))
    face = np.zeros(len(mesh.triangles), [("count", "u1"), ("corner", "<i4", 3)])
    face["count"], face["corner"] = 3, mesh.triangles
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment garbi: frame map, metres",
        f"element vertex {len(vertex)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        f"element face {len(face)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with written_aside(path) as aside:
        aside.write_bytes("\n".join([*lines, ""]).encode() + vertex.tobytes() + face.tobytes())
