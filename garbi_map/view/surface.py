"""The finished surface as a mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.palette import depth_colours, height_range
from garbi_map.seabed import Mesh
from garbi_map.view import style

if TYPE_CHECKING:
    from rerun import RecordingStream


def draw_surface(
    recording: RecordingStream, mesh: Mesh, path: str = style.MESH.path, heights: NDArray | None = None
) -> None:
    """The mesh, coloured by depth; half grey where it is interpolated over a hole.

    heights: what the colours span, m; None for those of the mesh.
    """
    import rerun as rr

    span = height_range(mesh.vertices[:, 2] if heights is None else heights)
    colours = depth_colours(mesh.vertices[:, 2], *span)
    grey = colours[mesh.filled].mean(axis=1, keepdims=True)
    colours[mesh.filled] = (0.5 * colours[mesh.filled] + 0.5 * grey).astype(np.uint8)
    surface = rr.Mesh3D(
        vertex_positions=mesh.vertices.astype(np.float32),
        vertex_normals=vertex_normals(mesh),
        triangle_indices=mesh.triangles.astype(np.uint32),
        vertex_colors=colours,
    )
    recording.log(path, surface, static=True)


def vertex_normals(mesh: Mesh) -> NDArray[np.float32]:
    """Unit normals (v, 3): the mean of the triangles around each vertex, by their area."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)
    total = np.empty_like(mesh.vertices)
    for axis in range(3):
        total[:, axis] = sum(
            np.bincount(mesh.triangles[:, corner], facing[:, axis], len(mesh.vertices)) for corner in range(3)
        )
    return (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)).astype(np.float32)
