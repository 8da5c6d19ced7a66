"""Whether a pipe is round underneath where it was seen: surface.ply of a pipe that spans the water, against the true one.

    python -m tools.bench.pipe [--keep DIR] [-o FILE.json]

scenarios/span.yaml, cast without images and placed by its own registration: the rig looks obliquely ahead, on the way there
and on the way back.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from garbi_map.config import Config
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import register
from garbi_map.seabed import AcceptedPoints, SolidSettings, SolidSurface, build_seabed
from garbi_map.sweep import Sweep
from tools.bench.dives import simulated
from tools.bench.uncertainty import onto_truth
from tools.simulator.scenario import load_scenario

Floats = NDArray[np.float64]

SCENARIO = Path(__file__).resolve().parents[1] / "simulator/scenarios/span.yaml"
NEAR = 0.02
"""m from the pipe's true surface, within which a vertex is one of its."""
SECTOR = 10
"""Degrees; round the pipe what was seen is counted in these."""
ENOUGH = 0.5
"""Share of the pipe's length, in steps of its radius, over which a sector must be there to count."""
ENDS = (10, 90)
"""Per cent of the points along the pipe between which its surface is judged: towards the ends of what was seen it frays."""


@dataclass(frozen=True)
class Result:
    """Of the vertices on the pipe, mm.

    seen_deg        round the pipe, of the points that were accepted
    covered_deg     and of the surface
    under_deg       of these below the pipe's axis
    radius_error    mean distance from the true surface, positive outwards, over the sectors
    worst_sector    the sector whose mean is farthest off
    median, p95     of the distance without its sign
    under_p95       of vertices below the axis
    """

    vertices: int
    seen_deg: int
    covered_deg: int
    under_deg: int
    radius_error: float
    worst_sector: float
    median: float
    p95: float
    under_p95: float


def main() -> int:
    """Print one line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="folder in which profiles are kept")
    parser.add_argument("--picture", type=Path, help="PNG of the pipe's cross-section")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the result")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        result = bench(arguments.keep or Path(scratch), arguments.picture)
    print(result)
    if arguments.out:
        arguments.out.write_text(json.dumps(asdict(result), indent=1) + "\n")
    return 0


def bench(work: Path, picture: Path | None = None) -> Result:
    """The dive, its map and its surface."""
    config = Config()
    dive = simulated("span", load_scenario(SCENARIO), work, config)
    mount = dive.navigation.mount("rig")
    solid, parts = SolidSurface(SolidSettings()), []
    with tempfile.TemporaryDirectory() as scratch:
        store = dive.copied(Path(scratch) / "sweeps")
        navigated = navigate(dive.navigation, config.navigate, store.stamps())
        inside = register(
            store, dive.navigation, navigated, config.registration, config.navigate, scanner=dive.scanner
        ).inside

        def posed() -> Iterator[tuple[Sweep, Trajectory]]:
            for sweep in store:
                yield sweep, inside.at(sweep.stamp_ns).mounted(mount)

        def take(points: AcceptedPoints) -> None:
            parts.append(points.points)
            solid.add(points.points, inside.at(points.stamp_ns).mounted(mount).position)

        build_seabed(posed, config.seabed, mount, take, dive.scanner.rig.eyes)
    cloud, mesh = np.concatenate(parts), solid.finish()
    rotation, shift = onto_truth(cloud[::7], dive, inside)
    assert dive.truth.surface is not None
    pipe = Pipe.of(*dive.truth.surface)
    off, turn, along = pipe.seen(rotation.apply(mesh.vertices) + shift)
    points = pipe.seen(rotation.apply(cloud) + shift)
    if picture is not None:
        draw(picture, pipe.radius, (points, (off, turn, along)))
    first, last = np.percentile(points[2], ENDS)
    well = (along > first) & (along < last)
    off, turn, along = off[well], turn[well], along[well]
    covered = pipe.sectors(turn, along)
    sector = (turn % 360 // SECTOR).astype(int)
    means = np.array([off[sector == one].mean() for one in covered])
    under = turn < 0
    return Result(
        vertices=len(off),
        seen_deg=SECTOR * len(pipe.sectors(*points[1:])),
        covered_deg=SECTOR * len(covered),
        under_deg=SECTOR * int((covered >= 180 // SECTOR).sum()),
        radius_error=1e3 * float(means.mean()),
        worst_sector=1e3 * float(means[np.argmax(np.abs(means))]),
        median=1e3 * float(np.median(np.abs(off))),
        p95=1e3 * float(np.percentile(np.abs(off), 95)),
        under_p95=1e3 * float(np.percentile(np.abs(off[under]), 95)),
    )


@dataclass(frozen=True)
class Pipe:
    """The true pipe: its mesh, a place on its axis (3,), the axis (3,), which is level, its length and radius, m."""

    scene: Any
    middle: Floats
    axis: Floats
    length: float
    radius: float

    @classmethod
    def of(cls, vertices: Floats, triangles: NDArray[np.int32]) -> Pipe:
        """The longest thing of a true surface that touches no other."""
        import open3d as o3d

        edges = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
        graph = coo_array((np.ones(len(edges), bool), edges.T), shape=(len(vertices),) * 2)
        label = connected_components(graph, directed=False)[1]
        ground = np.bincount(label).argmax()
        longest = max(
            (one for one in np.unique(label) if one != ground),
            key=lambda one: np.ptp(vertices[label == one], axis=0).max(),
        )
        own = vertices[label == longest]
        middle = (own.min(0) + own.max(0)) / 2
        axis = np.linalg.svd(own - middle)[2][0]
        away = own - middle - ((own - middle) @ axis)[:, None] * axis
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(
            o3d.core.Tensor.from_numpy((vertices - middle).astype(np.float32)),
            o3d.core.Tensor.from_numpy(triangles[label[triangles[:, 0]] == longest].astype(np.uint32)),
        )
        return cls(scene, middle, axis, float(np.ptp(own @ axis)), float(np.linalg.norm(away, axis=1).max()))

    def seen(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Of those of the points (n, 3) that are the pipe's, but near its ends: distance from its surface, m, positive
        outwards; angle round it, degrees, -180 to 180, negative underneath; place along it, m."""
        import open3d as o3d

        own = points - self.middle
        along = own @ self.axis
        away = own - along[:, None] * self.axis
        near = np.abs(np.linalg.norm(away, axis=1) - self.radius) < NEAR
        near &= np.abs(along) < 0.5 * self.length - 2 * self.radius
        off = self.scene.compute_signed_distance(o3d.core.Tensor.from_numpy(own[near].astype(np.float32))).numpy()
        side = np.cross(self.axis, [0.0, 0.0, 1.0])
        turn = np.degrees(np.arctan2(away[near, 2], away[near] @ side))
        return off.astype(float), turn, along[near]

    def sectors(self, turn: Floats, along: Floats) -> NDArray[np.int64]:
        """The sectors round the pipe, counted from one side upwards, that are there over most of the length."""
        step = np.floor(along / self.radius).astype(int)
        steps = max(np.ptp(step) + 1, 1) if len(step) else 1
        sector = (turn % 360 // SECTOR).astype(int)
        pairs = np.unique(np.stack([sector, step]), axis=1)[0]
        return np.flatnonzero(np.bincount(pairs, minlength=360 // SECTOR) >= ENOUGH * steps)


def draw(path: Path, radius: float, both: tuple[tuple[Floats, Floats, Floats], ...]) -> None:
    """The cross-section, 0.1 mm a pixel: accepted points grey, the surface red, the true circle black."""
    import cv2

    size, scale = 1400, 1e4
    image = np.full((size, size, 3), 255, np.uint8)
    for (off, turn, _), colour in zip(both, ((190, 190, 190), (40, 40, 220)), strict=True):
        reach, angle = (radius + off) * scale, np.radians(turn)
        column = (size / 2 + reach * np.cos(angle)).astype(int).clip(0, size - 1)
        row = (size / 2 - reach * np.sin(angle)).astype(int).clip(0, size - 1)
        image[row, column] = colour
    cv2.circle(image, (size // 2, size // 2), round(radius * scale), (0, 0, 0), 1, cv2.LINE_AA)
    cv2.imwrite(str(path), image)


if __name__ == "__main__":
    raise SystemExit(main())
