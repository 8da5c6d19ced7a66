"""The surface as PLY, which CloudCompare, MeshLab and Open3D open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.aside import written_aside
from garbi_map.export.georeference import Georeference
from garbi_map.export.palette import mesh_colours
from garbi_map.seabed.types import Mesh


def write_ply(path: Path, mesh: Mesh, reference: Georeference | None = None) -> None:
    """Write the mesh in `map`, binary, coordinates in double precision, coloured by depth.

    Comments in the header say how `map` lies on Earth. Raises GarbiError where the file cannot be written.
    """
    vertices = np.zeros(len(mesh.vertices), [(axis, "<f8") for axis in "xyz"] + [(c, "u1") for c in _COLOURS])
    for k, axis in enumerate("xyz"):
        vertices[axis] = mesh.vertices[:, k]
    for colour, values in zip(_COLOURS, (255 * mesh_colours(mesh)).round().T, strict=True):
        vertices[colour] = values
    triangles = np.zeros(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, mesh.triangles
    own = reference or Georeference()
    east, north, up = own.shift
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment garbi: map frame, metres, x east, y north, z up",
        f"comment crs {own.wkt}",
        f"comment easting = {east!r} + {own.scale!r} x, northing = {north!r} + {own.scale!r} y, height = {up!r} + z",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in _COLOURS),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write("\n".join(header).encode("ascii", "replace") + b"\n")
        file.write(vertices.data)
        file.write(triangles.data)


_COLOURS = ("red", "green", "blue")
