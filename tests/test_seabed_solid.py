"""The surface in three dimensions: round where an elevation grid is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from garbi_map.errors import GarbiError
from garbi_map.export import CloudWriter
from garbi_map.export.ply import write_ply
from garbi_map.export.solid import surface_of
from garbi_map.log.records import Mount
from garbi_map.seabed import Mesh, SeabedSettings, SolidSettings, SolidSurface, build_seabed
from tests.seabed_scene import plane, scan

RADIUS = 0.06
AXIS = np.array([0.0, 0.25])
"""y and z of a pipe along x, above a floor at z = 0."""
NOISE = 0.0003


def scanned(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) on pipe and floor and the eyes (n, 3) that saw them: from both sides, level with the pipe."""
    random = np.random.default_rng(seed)
    points, eyes = [], []
    for side in (-1.0, 1.0):
        eye = np.array([0.0, side * 0.9, 0.35])
        x = random.uniform(-0.22, 0.22, 12_000)
        turn = random.uniform(0, 2 * np.pi, 12_000)
        normal = np.stack([np.zeros_like(turn), np.cos(turn), np.sin(turn)], axis=1)
        place = RADIUS * normal + np.c_[x, np.broadcast_to(AXIS, (len(x), 2))]
        seen = ((eye - place) * normal).sum(1) / np.linalg.norm(eye - place, axis=1) > 0.2
        points.append(place[seen] + NOISE * random.standard_normal(seen.sum())[:, None] * normal[seen])
        floor = np.c_[random.uniform([-0.22, -0.24], [0.22, 0.24], (10_000, 2)), NOISE * random.standard_normal(10_000)]
        points.append(floor)
        eyes += [np.tile(eye, (len(part), 1)) for part in points[-2:]]
    return np.concatenate(points), np.concatenate(eyes)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """In one piece."""
    return made(*scanned())


def made(points: np.ndarray, eyes: np.ndarray, **settings: float) -> Mesh:
    solid = SolidSurface(SolidSettings(**{"voxel": 0.0045, **settings}))
    for part in np.array_split(np.random.default_rng(1).permutation(len(points)), 3):
        solid.add(points[part], eyes[part])
    return solid.finish()


def test_a_pipe_is_round_underneath_where_it_was_seen(mesh: Mesh) -> None:
    """Below its equator, down to where it turns away from all eyes, 95 % of the surface is within a millimetre."""
    away = mesh.vertices[:, 1:] - AXIS
    distance = np.linalg.norm(away, axis=1)
    pipe = (np.abs(distance - RADIUS) < 0.02) & (np.abs(mesh.vertices[:, 0]) < 0.2)
    under = pipe & (away[:, 1] < -0.25 * RADIUS) & (away[:, 1] > -0.85 * RADIUS)
    assert under.sum() > 300
    assert (away[under, 0] < 0).any() and (away[under, 0] > 0).any()
    off = np.abs(distance[under] - RADIUS)
    assert np.median(off) < 0.0003
    assert np.percentile(off, 95) < 0.001


def test_nothing_closes_the_water_between(mesh: Mesh) -> None:
    """What was not seen has no surface: nothing joins the pipe and the floor."""
    away = np.linalg.norm(mesh.vertices[:, 1:] - AXIS, axis=1)
    between = (mesh.vertices[:, 2] > 0.02) & (away > RADIUS + 0.015)
    assert not between.any()


def test_tiles_leave_no_seam() -> None:
    """Cut into cubes of 30 cm, the surface is as good, and no wider gap is left than the voxels."""
    points, eyes = scanned()
    mesh = made(points, eyes, tile=0.3)
    floor = mesh.vertices[(mesh.vertices[:, 2] < 0.01) & (np.abs(mesh.vertices[:, 1]) < 0.23)]
    x, y = np.meshgrid(np.linspace(-0.19, 0.19, 60), np.linspace(-0.2, 0.2, 60))
    gap = cKDTree(floor[:, :2]).query(np.c_[x.ravel(), y.ravel()])[0]
    assert gap.max() < 0.008
    assert np.percentile(np.abs(floor[:, 2]), 95) < 0.001


def test_too_little_is_no_surface() -> None:
    """One clear line."""
    with pytest.raises(GarbiError, match="too few points"):
        made(np.zeros((5, 3)), np.ones((5, 3)))


def test_other_programs_read_the_file(mesh: Mesh, tmp_path: Path) -> None:
    """By trimesh: the same triangles, in float64, coloured."""
    trimesh = pytest.importorskip("trimesh")
    write_ply(tmp_path / "surface.ply", Mesh(mesh.vertices + np.array([4e5, 6e6, -12.0]), mesh.triangles, mesh.filled))
    read = trimesh.load(tmp_path / "surface.ply", process=False)
    np.testing.assert_array_equal(read.faces, mesh.triangles)
    np.testing.assert_allclose(read.vertices - [4e5, 6e6, -12.0], mesh.vertices, atol=1e-8)
    assert read.visual.kind == "vertex"


def test_the_cloud_on_disk_gives_the_surface(tmp_path: Path) -> None:
    """Each point is seen from where the rig was at its time: a floor scanned from above faces up."""
    posed = [scan(plane, k) for k in range(2)]
    mount = Mount()
    with CloudWriter(tmp_path / "cloud.laz") as cloud:
        build_seabed(lambda: posed, SeabedSettings(), mount, cloud.write)
    path = posed[0][1]
    surface = surface_of(tmp_path / "cloud.laz", path, mount, SolidSettings())
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).mean() > 0.99
    assert np.percentile(np.abs(surface.vertices[:, 2] - 0.2 * surface.vertices[:, 0]), 95) < 0.001
