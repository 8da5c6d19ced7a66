"""The surface as binary glTF 2.0, which Blender and every web viewer open."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import written_aside
from garbi_map.export.georeference import Georeference
from garbi_map.export.palette import mesh_colours
from garbi_map.seabed.types import Mesh

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_UNSIGNED_BYTE, _UNSIGNED_INT, _FLOAT = 5121, 5125, 5126


def write_glb(path: Path, mesh: Mesh, reference: Georeference | None = None) -> None:
    """Write the mesh coloured by depth; what was interpolated over holes is greyed.

    glTF is y up: (x, y, z) of `map` becomes (x, z, -y), metres. Vertices are float32 about the node's translation. Viewers
    compute in float32, so that the file stays in `map`; how that lies on Earth is in the asset's extras.
    Raises GarbiError where the file cannot be written.
    """
    y_up = mesh.vertices[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    centre = np.round(0.5 * (y_up.min(0) + y_up.max(0)), 3)
    position = (y_up - centre).astype(np.float32)
    buffers = (
        (position, _FLOAT, "VEC3", _ARRAY_BUFFER),
        (_normals(position, mesh.triangles), _FLOAT, "VEC3", _ARRAY_BUFFER),
        (_colours(mesh), _UNSIGNED_BYTE, "VEC4", _ARRAY_BUFFER),
        (mesh.triangles.astype(np.uint32).ravel(), _UNSIGNED_INT, "SCALAR", _ELEMENT_ARRAY_BUFFER),
    )
    views, accessors, offset = [], [], 0
    for number, (array, component, kind, target) in enumerate(buffers):
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes, "target": target})
        accessors.append({"bufferView": number, "componentType": component, "count": len(array), "type": kind})
        offset += array.nbytes
    accessors[0] |= {"min": position.min(0).tolist(), "max": position.max(0).tolist()}
    accessors[2]["normalized"] = True
    extras = {"frame": "map: x, z, -y, metres"}
    if reference is not None:
        extras |= {"crs": reference.wkt, "coordinates": "shift + (scale x, scale y, z)", **reference.from_map()}
    document = {
        "asset": {"version": "2.0", "generator": "garbi", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "seabed", "mesh": 0, "translation": centre.tolist()}],
        "meshes": [
            {
                "name": "seabed",
                "primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0}],
            }
        ],
        "materials": [
            {
                "name": "depth",
                "doubleSided": True,
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9},
            }
        ],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + offset))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", offset, b"BIN\0"))
        for array, *_ in buffers:
            file.write(array.tobytes())


def _normals(position: NDArray[np.float32], triangles: NDArray[np.int32]) -> NDArray[np.float32]:
    """Unit normals (v, 3) of the vertices, weighted by the area of their triangles."""
    a, b, c = (position[triangles[:, k]].astype(np.float64) for k in range(3))
    face = np.cross(b - a, c - a)
    corner = triangles.ravel()
    normal = np.stack(
        [np.bincount(corner, np.repeat(face[:, k], 3), minlength=len(position)) for k in range(3)], axis=1
    )
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.tile([0.0, 1.0, 0.0], (len(normal), 1)), where=length > 0).astype(
        np.float32
    )


def _colours(mesh: Mesh) -> NDArray[np.uint8]:
    """RGBA (v, 4): glTF wants vertex colours linear, not sRGB."""
    srgb = mesh_colours(mesh)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.hstack([(255 * linear).round(), np.full((len(linear), 1), 255)]).astype(np.uint8)
