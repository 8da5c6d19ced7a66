"""What stands and moves in a trial: meshes for the rays, and exact shapes to tell a collision."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.types import Profile
from garbi_map.log.records import Floats
from tools.simulator import shapes
from tools.simulator.dive import Dive
from tools.simulator.scenario import Mover, Scenario
from tools.simulator.seabed import Scene, mover_centre
from tools.simulator.sensors import START_NS
from tools.simulator.shapes import Mesh
from tools.trials import kernels

ON, SHOWN = 0.08, 5  # m off a moving thing's skin within which a point lies on it; points of a profile that show it


@dataclass(frozen=True)
class Block:
    """A box: centre and half size (3,) m, turned about the vertical by `heading` rad."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    heading: float = 0.0
    kind: str = "wall"

    def mesh(self) -> Mesh:
        """Triangles fine enough for no purpose but rays: twelve."""
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * self.half
        quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        triangles = [[q[i] for i in t] for q in quads for t in ((0, 1, 2), (0, 2, 3))]
        turned = Rotation.from_euler("z", self.heading).apply(corners)
        return turned + np.array(self.centre), np.array(triangles, np.int32)

    def surface(self, step: float = 0.08) -> Floats:
        """Points (n, 3) all over it."""
        axes = [np.linspace(-h, h, max(int(2 * h / step), 1) + 1) for h in self.half]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        edge = (np.abs(np.abs(grid) - self.half) < 1e-9).any(1)
        return Rotation.from_euler("z", self.heading).apply(grid[edge]) + np.array(self.centre)


@dataclass(frozen=True)
class Rod:
    """A cylinder from `foot` to `head` (3,) m: pillar, pipe or cable."""

    foot: tuple[float, float, float]
    head: tuple[float, float, float]
    radius: float
    kind: str = "pillar"

    def mesh(self) -> Mesh:
        """See Block."""
        foot, head = np.array(self.foot), np.array(self.head)
        along = head - foot
        length = float(np.linalg.norm(along))
        turn, _ = Rotation.align_vectors([along / length], [[1.0, 0.0, 0.0]])
        around = 48 if self.radius > 0.05 else 16
        return shapes.moved(shapes.cylinder(self.radius, length, around), (foot + head) / 2, turn)

    def surface(self, step: float = 0.05) -> Floats:
        """See Block."""
        points, _ = self.mesh()
        return points


class PlainScene(Scene):
    """A scene whose rays meet the shapes themselves, not their triangles: some ten times as fast."""

    def __init__(self, ground: Scene, still: list[Block | Rod], movers: tuple[Mover, ...]) -> None:
        """ground: a scene of nothing but its ground, a grid. Movers are spheres."""
        super().__init__(ground.mesh, ground.texture, movers)
        points = ground.mesh[0]
        columns = int(np.argmax(points[:, 1] > points[0, 1]))
        self._heights = np.ascontiguousarray(points[:, 2].reshape(-1, columns))
        self._corner, self._cell = points[0, :2].copy(), float(points[1, 0] - points[0, 0])
        blocks = [[*one.centre, *one.half, one.heading] for one in still if isinstance(one, Block)]
        rods = [[*one.foot, *one.head, one.radius] for one in still if isinstance(one, Rod)]
        self._blocks, self._rods = np.array(blocks).reshape(-1, 7), np.array(rods).reshape(-1, 7)

    def cast(self, origin: Floats, direction: Floats, time: float) -> tuple[Floats, Floats]:
        """See Scene."""
        balls = np.array([[*mover_centre(one, time), one.size / 2] for one in self.movers]).reshape(-1, 4)
        return kernels.cast(origin, direction, self._heights, self._corner, self._cell, self._blocks, self._rods, balls)


@dataclass
class World:
    """The obstacles of a trial besides the seabed."""

    still: list[Block | Rod] = field(default_factory=list)
    movers: tuple[Mover, ...] = ()

    def make_plain(self, scenario: Scenario) -> Dive:
        """A dive in this world for profiles only, see PlainScene."""
        dive = Dive(scenario)
        dive.scene = PlainScene(dive.scene, self.still, self.movers)
        return dive

    def make(self, scenario: Scenario) -> Dive:
        """A dive in this world."""
        dive = Dive(scenario)
        parts = [dive.scene.mesh, *(one.mesh() for one in self.still)]
        dive.scene = Scene(shapes.merged(parts), dive.scene.texture, self.movers)
        return dive

    def points(self) -> Floats:
        """(n, 3) m, map, all over what stands still."""
        found = [one.surface() for one in self.still]
        return np.concatenate(found) if found else np.empty((0, 3))

    def gap(self, points: Floats, position: Floats, rotation: Floats, half: Floats, time: float) -> float:
        """m from the hull (a box) to the nearest obstacle; 0 or less: they touch. points: `self.points()`."""
        gap = np.inf
        if len(points):
            near = points[(np.abs(points - position) < 3.0).all(1)]
            if len(near):
                gap = _gap((near - position) @ rotation, half, 0.0)
        for mover in self.movers:
            centre = mover_centre(mover, time)
            gap = min(gap, _gap(((centre - position) @ rotation)[None], half, mover.size / 2))
        return gap


def shown(dive: Dive, movers: tuple[Mover, ...], profile: Profile) -> list[int]:
    """Which of the things that move a profile has points on, wherever navigation took the vehicle to be."""
    time = (profile.stamp_ns - START_NS) * 1e-9
    now = dive.motion.at(time)
    points = now.rotation[0].apply(profile.pose.to_base(profile.points)) + now.position[0]
    off = [np.linalg.norm(points - mover_centre(one, time), axis=1) - one.size / 2 for one in movers]
    return [number for number, found in enumerate(off) if (found < ON).sum() >= SHOWN]


def _gap(points: Floats, half: Floats, radius: float) -> float:
    outside = np.maximum(np.abs(points) - half, 0.0)
    inside = (outside == 0.0).all(1)
    return -0.01 if inside.any() else float(np.linalg.norm(outside, axis=1).min()) - radius
