"""Where the stripe truly lies in the images of a dive whose seabed and trajectory are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.log import Image, open_log
from garbi_map.log.settings import LogSettings
from garbi_map.navigate import Trajectory
from garbi_map.rig import Rig, parse_rig
from garbi_map.sweep import laser_angle
from garbi_map.sweep.settings import SweepSettings

RAYS = 3000
"""Rays in which the sheet is cast; neighbours are about a fifth of a row apart."""
HALF_FAN = 0.6
"""rad"""
ALONE = 0.02
"""m by which the camera may see a point before the sheet's, for the point to count as hidden."""


@dataclass(frozen=True)
class TrueStripe:
    """An image, the laser's angle (rad) and where rows meet the lit line: row (n,) ascending, u (n,) px. A row may
    be there several times or, where nothing of the known surface is lit, not at all."""

    image: Image
    alpha: float
    row: NDArray[np.int64]
    u: NDArray[np.float64]


def rig_of(dive: Path) -> Rig:
    """The rig of a dive's folder."""
    return parse_rig((dive / "rig.yaml").read_text(), str(dive / "rig.yaml"))


def simulated(name: str, seconds: float, folder: Path) -> Path:
    """A dive's folder with the first seconds of one of the simulator's scenarios, in `folder`."""
    from tools.simulator.dive import Dive
    from tools.simulator.record import write_log, write_truth
    from tools.simulator.scenario import load_scenario

    scenario = load_scenario(Path(__file__).parents[1] / "simulator" / "scenarios" / f"{name}.yaml")
    dive = Dive(scenario.model_copy(update={"duration": seconds})).fly()
    place = folder / name
    place.mkdir()
    write_log(dive, place / "dive.mcap", 1, None)
    write_truth(dive, place)
    return place


def true_stripes(dive: Path, every: int) -> Iterator[TrueStripe]:
    """Every so many-th image of a dive's folder with its true stripe."""
    import open3d as o3d

    log = open_log([dive / "dive.mcap"], LogSettings())
    rig, navigation = rig_of(dive), log.navigation()
    angle = laser_angle(navigation.encoder, rig, SweepSettings())
    table = np.loadtxt(dive / "truth_trajectory.tum")
    epoch = np.floor(table[0, 0])
    stamps = int(epoch) * 10**9 + np.round((table[:, 0] - epoch) * 1e9).astype(np.int64)
    truth = Trajectory(stamps, table[:, 1:4], table[:, 4:8], np.zeros((len(table), 6, 6)))
    mount = navigation.mount("rig")
    surface = o3d.t.geometry.RaycastingScene()
    mesh = o3d.io.read_triangle_mesh(dive / "truth_seabed.ply")
    surface.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))

    def cast(origin: NDArray, direction: NDArray) -> NDArray:
        rays = np.concatenate([np.broadcast_to(origin, direction.shape), direction], axis=1).astype(np.float32)
        return np.asarray(surface.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy(), float)

    for number, image in enumerate(log.images()):
        alpha = angle.alpha(image.stamp_ns)
        if number % every or np.isnan(alpha):
            continue
        pose = truth.at(np.array([image.stamp_ns])).mounted(mount)
        turn, place = pose.rotation.as_matrix()[0], pose.position[0]
        normal = rig.sheet(alpha)[0]
        ahead = np.cross(normal, [0.0, 0.0, 1.0])
        ahead *= np.sign(ahead[0]) / np.linalg.norm(ahead)
        aside = np.cross(ahead, normal)
        fan = np.linspace(-HALF_FAN, HALF_FAN, RAYS)[:, None]
        direction = np.cos(fan) * ahead + np.sin(fan) * aside
        reach = cast(rig.laser.apex @ turn.T + place, direction @ turn.T)
        lit = np.isfinite(reach)
        points = np.where(lit[:, None], rig.laser.apex + np.where(lit, reach, 1.0)[:, None] * direction, np.nan)
        sight = np.where(lit[:, None], points - rig.camera.centre, [1.0, 0.0, 0.0])
        away = np.linalg.norm(sight, axis=1)
        lit &= cast(rig.camera.centre @ turn.T + place, sight / away[:, None] @ turn.T) > away - ALONE
        pixel = rig.project(points)
        lit &= np.isfinite(pixel).all(axis=1)
        yield TrueStripe(image, alpha, *_rows(pixel, lit, np.where(lit, reach, 0.0)))


def _rows(pixel: NDArray, lit: NDArray, reach: NDArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Columns where the line through neighbouring lit points crosses the middle of rows."""
    joined = lit[:-1] & lit[1:] & (np.abs(np.diff(reach)) < ALONE)
    v0, v1, u0, u1 = pixel[:-1, 1], pixel[1:, 1], pixel[:-1, 0], pixel[1:, 0]
    row = np.ceil(np.minimum(v0, v1))
    crossed = joined & (row <= np.maximum(v0, v1)) & (v0 != v1)
    part = (row[crossed] - v0[crossed]) / (v1 - v0)[crossed]
    order = np.argsort(row[crossed], kind="stable")
    return row[crossed][order].astype(np.int64), (u0[crossed] + part * (u1 - u0)[crossed])[order]
