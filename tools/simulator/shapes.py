"""Meshes of what lies on the seabed: (vertices (n, 3) m, triangles (m, 3) int)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats

Mesh = tuple[Floats, NDArray[np.int32]]

# The paper's parallelepiped: its slanting side is 82 mm long.
BLOCK_BASE, BLOCK_SLANT, BLOCK_WIDTH, BLOCK_ANGLE = 0.12, 0.082, 0.15, np.radians(60.0)


def moved(mesh: Mesh, position: Floats, rotation: Rotation | None = None) -> Mesh:
    """The mesh turned, then shifted."""
    points = mesh[0] if rotation is None else rotation.apply(mesh[0])
    return points + position, mesh[1]


def merged(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    offsets = np.cumsum([0] + [len(points) for points, _ in meshes[:-1]])
    triangles = [part + offset for (_, part), offset in zip(meshes, offsets, strict=True)]
    return np.concatenate([points for points, _ in meshes]), np.concatenate(triangles).astype(np.int32)


def grid(heights: Floats, x: Floats, y: Floats) -> Mesh:
    """A heightfield: heights (len(y), len(x)) over the axes x and y."""
    rows, columns = heights.shape
    xx, yy = np.meshgrid(x, y)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None, :]).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], 1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], 1)
    points = np.stack([xx.ravel(), yy.ravel(), heights.ravel()], 1)
    return points, np.concatenate([lower, upper]).astype(np.int32)


def sphere(subdivisions: int) -> Mesh:
    """A unit sphere: an icosahedron whose triangles are split in four `subdivisions` times."""
    g = (1 + 5**0.5) / 2
    signs = np.array([[-1, g], [1, g], [-1, -g], [1, -g]])
    zero = np.zeros(4)
    points = np.concatenate([np.c_[signs, zero], np.c_[zero, signs], np.c_[signs[:, 1], zero, signs[:, 0]]])
    # A face of the icosahedron is three vertices that are nearest neighbours of each other (edge length 2).
    near = np.abs(np.linalg.norm(points[:, None] - points[None], axis=2) - 2) < 1e-9
    triples = [
        (a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]
    ]
    faces = np.array(triples)
    corners = points[faces]
    inward = (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * corners[:, 0]).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    points = points / np.linalg.norm(points[0])
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = index.reshape(-1, 3) + len(points)
        halves = points[unique].mean(1)
        points = np.concatenate([points, halves / np.linalg.norm(halves, axis=1, keepdims=True)])
        a, b, c = faces.T
        ab, bc, ca = middle.T
        quarters = [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        faces = np.concatenate(quarters)
    return points, faces.astype(np.int32)


def stone(radius: float, rng: np.random.Generator) -> Mesh:
    """A lumpy, flattened ellipsoid of about that radius."""
    points, triangles = sphere(3 if radius < 0.05 else 4)
    lumps = np.ones(len(points))
    for wave in (2.0, 3.5, 6.0, 11.0):
        direction = rng.normal(size=(3, 3))
        direction *= wave / np.linalg.norm(direction, axis=1, keepdims=True)
        lumps += 0.16 / wave * np.sin(points @ direction.T + rng.uniform(0, 2 * np.pi, 3)).sum(1)
    axes = radius * np.array([1.0, rng.uniform(0.65, 1.0), rng.uniform(0.45, 0.75)])
    turned = Rotation.from_euler("zx", [rng.uniform(0, 2 * np.pi), rng.normal(0, 0.25)])
    return turned.apply(points * lumps[:, None] * axes), triangles


def cylinder(radius: float, length: float, around: int = 96) -> Mesh:
    """Along x, centred, open at both ends."""
    angle = 2 * np.pi * np.arange(around) / around
    along = np.linspace(-length / 2, length / 2, max(2, int(length / 0.05)))
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    points = np.concatenate([np.repeat(along, around)[:, None], np.tile(ring, (len(along), 1))], 1)
    first = (np.arange(len(along) - 1)[:, None] * around + np.arange(around)[None, :]).ravel()
    turn = (np.arange(len(along) - 1)[:, None] * around + (np.arange(around)[None, :] + 1) % around).ravel()
    lower = np.stack([first, turn, first + around], 1)
    upper = np.stack([turn, turn + around, first + around], 1)
    return points, np.concatenate([lower, upper]).astype(np.int32)


def block() -> Mesh:
    """The parallelepiped: standing on z = 0, its slanting faces rise towards +x."""
    rise = BLOCK_SLANT * np.array([np.cos(BLOCK_ANGLE), 0.0, np.sin(BLOCK_ANGLE)])
    foot = np.array([[0, 0, 0], [BLOCK_BASE, 0, 0], [BLOCK_BASE, BLOCK_WIDTH, 0], [0, BLOCK_WIDTH, 0]], float)
    points = np.concatenate([foot, foot + rise]) - [BLOCK_BASE / 2, BLOCK_WIDTH / 2, 0]
    quads = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    triangles = [[q[i] for i in t] for q in quads for t in ((0, 1, 2), (0, 2, 3))]
    return points, np.array(triangles, np.int32)


def cube(edge: float) -> Mesh:
    """Centred, its faces along the axes."""
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float) * edge / 2
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return corner, np.array([[q[i] for i in t] for q in quads for t in ((0, 1, 2), (0, 2, 3))], np.int32)


def fish(length: float) -> Mesh:
    """A flattened ellipsoid along x: what a fish is to a range sensor."""
    points, triangles = sphere(3)
    return points * (length * np.array([0.5, 0.1, 0.17])), triangles
