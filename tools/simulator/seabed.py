"""The ground and what lies on it, drawn from the scenario's seed, and the rays that meet it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from tools.simulator import shapes
from tools.simulator.route import Reference
from tools.simulator.scenario import Mover, Scenario, Seabed, Thing
from tools.simulator.shapes import Mesh


@dataclass(frozen=True)
class Ground:
    """Heights (len(y), len(x)) m over the axes x and y (m, map)."""

    heights: Floats
    x: Floats
    y: Floats

    def at(self, x: float, y: float) -> float:
        """Height at one place, bilinear, held outside."""
        step = self.x[1] - self.x[0]
        place = [[(y - self.y[0]) / step], [(x - self.x[0]) / step]]
        return float(map_coordinates(self.heights, place, order=1, mode="nearest")[0])


@dataclass
class Texture:
    """Diffuse reflectance as a smooth random function of the place: a sum of plane waves from 3 cm to 1 m."""

    mean: float
    variation: float
    wave: Floats = field(repr=False)
    phase: Floats = field(repr=False)

    def at(self, points: Floats) -> NDArray[np.float32]:
        """Albedo (n,) at points (n, 3) m."""
        waves = np.cos(points.astype(np.float32) @ self.wave.T.astype(np.float32) + self.phase.astype(np.float32))
        relative = np.exp(self.variation * waves.sum(1) * np.sqrt(2 / len(self.phase)))
        return np.clip(self.mean * relative, 0.02, 0.95).astype(np.float32)


@dataclass
class Scene:
    """What rays meet: the still seabed, and bodies that move through it.

    mesh      the true still surface, map, m
    """

    mesh: Mesh
    texture: Texture
    movers: tuple[Mover, ...] = ()

    @cached_property
    def _still(self) -> Any:
        return _ray_casting(self.mesh)

    @cached_property
    def _moving(self) -> list[tuple[Mover, Any]]:
        return [(mover, _ray_casting(_body(mover))) for mover in self.movers]

    def cast(self, origin: Floats, direction: Floats, time: float) -> tuple[Floats, Floats]:
        """Distance (n,) m to the first surface (inf where there is none) and its unit normal (n, 3), turned towards the
        ray's origin, of rays from origin (n, 3) along unit direction (n, 3), map, at a time (s)."""
        distance, normal = _cast(self._still, origin, direction)
        for mover, body in self._moving:
            near, its_normal = _cast(body, origin - mover_centre(mover, time), direction)
            closer = near < distance
            distance = np.where(closer, near, distance)
            normal[closer] = its_normal[closer]
        away = (normal * direction).sum(1) > 0
        normal[away] *= -1
        return distance, normal

    def on_ground(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points (n, 3) m lie on the still seabed, within a millimetre, and not on what moves."""
        return _distance(self._still, points) < 1e-3

    def distances(self, points: Floats, time: float) -> tuple[Floats, Floats]:
        """Of points (n, 3) m, map, from the still seabed and from the nearest moving body at a time (s), (n,) m each."""
        body = np.full(len(points), np.inf)
        for mover, shape in self._moving:
            body = np.minimum(body, _distance(shape, points - mover_centre(mover, time)))
        return _distance(self._still, points), body

    def heights(self, x: Floats, y: Floats) -> Floats:
        """Height (len(y), len(x)) m, map, of the still seabed seen from above; NaN where there is none."""
        top = float(self.mesh[0][:, 2].max()) + 1.0
        east, north = np.meshgrid(x, y)
        above = np.stack([east.ravel(), north.ravel(), np.full(east.size, top)], axis=1)
        distance, _ = _cast(self._still, above, np.tile([0.0, 0.0, -1.0], (east.size, 1)))
        return np.where(np.isfinite(distance), top - distance, np.nan).reshape(east.shape)

    def write(self, path: Path) -> None:
        """The true still surface as binary PLY."""
        o3d = _open3d()
        points, triangles = self.mesh
        mesh = o3d.t.geometry.TriangleMesh(o3d.core.Tensor(points.astype(np.float32)), o3d.core.Tensor(triangles))
        o3d.t.io.write_triangle_mesh(str(path), mesh)


def mover_centre(mover: Mover, time: float) -> Floats:
    """Where a moving body is at a time (s): (3,) m, map."""
    velocity = np.array(mover.velocity)
    across = np.cross(velocity, [0.0, 0.0, 1.0]) if np.hypot(*velocity[:2]) > 1e-9 else np.array([0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    return np.array(mover.start) + velocity * time + across * mover.swing * np.sin(2 * np.pi * time / mover.period)


def make_scene(scenario: Scenario, reference: Reference) -> Scene:
    """The scene of a scenario: the same for the same seed, whatever the sensors."""
    seabed = scenario.seabed
    rng = np.random.default_rng([scenario.seed if seabed.seed is None else seabed.seed, 1])
    low = reference.position.min(0) - seabed.margin
    high = reference.position.max(0) + seabed.margin
    ground = make_ground(seabed, low, high, rng)
    meshes = [shapes.grid(ground.heights, ground.x, ground.y)]
    meshes += _stones(seabed, ground, rng)
    meshes += _made_by_man(seabed, ground, reference)
    meshes += [_laid(thing, ground) for thing in seabed.things]
    lengths = np.exp(rng.uniform(np.log(0.03), np.log(1.0), 24))
    wave = rng.normal(size=(24, 3))
    wave *= (2 * np.pi / lengths / np.linalg.norm(wave, axis=1))[:, None]
    texture = Texture(seabed.albedo, seabed.texture, wave, rng.uniform(0, 2 * np.pi, 24))
    return Scene(shapes.merged(meshes), texture, scenario.movers)


def make_ground(seabed: Seabed, low: Floats, high: Floats, rng: np.random.Generator) -> Ground:
    """Undulation, ripples whose crests bend and fork, and grain, over the rectangle from low (2,) to high (2,) m."""
    x = np.arange(low[0], high[0] + seabed.cell, seabed.cell)
    y = np.arange(low[1], high[1] + seabed.cell, seabed.cell)
    shape = (len(y), len(x))
    broad = _noise(shape, 0.35 / seabed.cell, rng)
    bend = _noise(shape, 0.3 / seabed.cell, rng)
    height = 0.5 + 0.5 * np.clip(0.6 + 0.5 * _noise(shape, 0.5 / seabed.cell, rng), 0, 1)
    heading = rng.uniform(0, np.pi)
    along = np.cos(heading) * x[None, :] + np.sin(heading) * y[:, None]
    phase = 2 * np.pi * along / seabed.ripple_length + 1.6 * bend
    # Wave ripples have sharper crests than troughs: a second harmonic in phase with the first.
    ripple = 0.5 * seabed.ripple_height * height * (np.cos(phase) + 0.2 * np.cos(2 * phase) - 0.1)
    grain = seabed.roughness * _noise(shape, 1.2, rng)
    return Ground(seabed.relief * broad + ripple + grain, x, y)


def _noise(shape: tuple[int, int], cells: float, rng: np.random.Generator) -> Floats:
    """Gaussian noise of unit variance, correlated over that many cells."""
    smooth = gaussian_filter(rng.normal(size=shape), cells, mode="reflect")
    return (smooth - smooth.mean()) / max(smooth.std(), 1e-12)


def _stones(seabed: Seabed, ground: Ground, rng: np.random.Generator) -> list[Mesh]:
    """Stones of power-law sizes, a third to a half of each in the ground."""
    area = (ground.x[-1] - ground.x[0]) * (ground.y[-1] - ground.y[0])
    small, large = seabed.stone_size
    made = []
    for _ in range(rng.poisson(seabed.stones * area)):
        share, power = rng.uniform(), -1.6
        radius = (small**power + share * (large**power - small**power)) ** (1 / power)
        x, y = rng.uniform(ground.x[0], ground.x[-1]), rng.uniform(ground.y[0], ground.y[-1])
        z = ground.at(x, y) + radius * rng.uniform(0.0, 0.3)
        made.append(shapes.moved(shapes.stone(radius, rng), np.array([x, y, z])))
    return made


def _laid(thing: Thing, ground: Ground) -> Mesh:
    """One of the scenario's things, on the ground where it lies."""
    if thing.kind == "stone":
        mesh = shapes.stone(thing.size, np.random.default_rng([thing.shape, 8]))
    elif thing.kind == "sphere":
        points, triangles = shapes.sphere(4)
        mesh = points * thing.size, triangles
    else:
        mesh = shapes.cube(thing.size)
    rise = (0.5 if thing.kind == "block" else 0.6 if thing.kind == "stone" else 1.0) * thing.size
    place = np.array([*thing.at, ground.at(*thing.at) + rise - thing.sunk * thing.size])
    return shapes.moved(mesh, place, Rotation.from_euler("z", thing.turn))


def _made_by_man(seabed: Seabed, ground: Ground, reference: Reference) -> list[Mesh]:
    """Pipe, parallelepiped, rod and wall, placed relative to the route's first leg."""
    heading = reference.heading[0]
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    along = Rotation.from_euler("z", heading)
    middle = (reference.position.min(0) + reference.position.max(0)) / 2
    reach = float(np.linalg.norm(reference.position.max(0) - reference.position.min(0)))
    made = []
    if seabed.pipe_radius > 0:
        place = middle + 0.25 * left
        z = ground.at(*place) + 0.6 * seabed.pipe_radius
        pipe = shapes.cylinder(seabed.pipe_radius, reach + 2 * seabed.margin)
        made.append(shapes.moved(pipe, np.r_[place, z], Rotation.from_euler("z", heading + 0.12)))
    if seabed.block:
        place = reference.position[0] + 0.45 * ahead - 0.12 * left
        turned = Rotation.from_euler("z", heading + 0.4)
        made.append(shapes.moved(shapes.block(), np.r_[place, ground.at(*place) - 0.004], turned))
    if seabed.rod_radius > 0:
        across = Rotation.from_euler("z", heading + np.pi / 2)
        rod = shapes.cylinder(seabed.rod_radius, 1.6, around=24)
        made.append(shapes.moved(rod, np.r_[middle, ground.at(*middle) + 0.15], across))
    if seabed.wall > 0:
        far = ((reference.position - middle) @ ahead).max() + seabed.wall_distance
        rng = np.random.default_rng([len(ground.x), len(ground.y), 7])
        u = np.arange(-2.5, 2.5, 0.01)
        v = np.arange(-0.3, seabed.wall, 0.01)
        face = seabed.relief * _noise((len(v), len(u)), 12.0, rng) + seabed.roughness * _noise(
            (len(v), len(u)), 1.2, rng
        )
        points, triangles = shapes.grid(face, u, v)
        upright = np.stack([points[:, 2], points[:, 0], points[:, 1]], 1)
        made.append(shapes.moved((upright, triangles), np.r_[middle + far * ahead, 0.0], along))
    return made


def _body(mover: Mover) -> Mesh:
    """The mesh of a moving body about its centre."""
    heading = Rotation.from_euler("z", np.arctan2(mover.velocity[1], mover.velocity[0]))
    if mover.kind == "fish":
        return shapes.moved(shapes.fish(mover.size), np.zeros(3), heading)
    if mover.kind == "cable":
        upright = Rotation.from_euler("y", np.pi / 2)
        return shapes.moved(shapes.cylinder(0.01, mover.size, around=24), np.zeros(3), upright)
    points, triangles = shapes.sphere(4)
    return points * mover.size / 2, triangles


def _open3d() -> Any:
    """Open3D, late and untyped: its stubs refuse numpy arrays that it takes."""
    import open3d

    return open3d


def _ray_casting(mesh: Mesh) -> Any:
    o3d = _open3d()
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.core.Tensor(mesh[0].astype(np.float32)), o3d.core.Tensor(mesh[1].astype(np.uint32)))
    return scene


def _distance(scene: Any, points: Floats) -> Floats:
    away = scene.compute_distance(_open3d().core.Tensor(points.astype(np.float32)), nthreads=1)
    return np.asarray(away.numpy(), np.float64)


def _cast(scene: Any, origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
    o3d = _open3d()
    rays = np.concatenate([origin, direction], 1).astype(np.float32)
    found = scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)
    return found["t_hit"].numpy().astype(np.float64), found["primitive_normals"].numpy().astype(np.float64)
