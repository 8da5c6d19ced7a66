"""A small dive over a plane, with its log, sweeps and finished map: all of it known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.dive import Dive, Map
from garbi_map.log import Image, LogWriter, Mount, open_log
from garbi_map.navigate import NavigationResult, Trajectory
from garbi_map.register import Agreement, Registered
from garbi_map.register.drift import Round
from garbi_map.rig import Rig
from garbi_map.seabed import Mesh, build_seabed, triangulate
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore
from tests.rigs import make_rig

START = 1_790_000_000_000_000_000
PERIOD_NS = 50_000_000
IMAGES = 60
PER_SWEEP = 30
VEHICLE_Z = -10.0
SEABED_Z = -11.3
OFFSET = np.array([0.05, -0.02, 0.01])
"""By how much the navigation alone is wrong, m."""
LOOK_DOWN = Mount(np.array([0.3, 0.0, -0.1]), Rotation.from_euler("y", 90, degrees=True).as_quat())
LASER_GREEN = (40, 230, 90)  # BGR
ROWS = np.arange(4, 572, 4)


@dataclass(frozen=True)
class Scene:
    """Everything that record_map takes; stripes: pixels (k, 2) of each image."""

    dive: Dive
    store: SweepStore
    built: Map
    mesh: Mesh
    stripes: list[NDArray]
    log: Path


def make_scene(folder: Path) -> Scene:
    """Two sweeps of thirty images each, over a plane at z = -11.3 m, seen from a vehicle that moves forward at z = -10 m."""
    config = Config()
    rig, stamps, alphas, truth, profiles, stripes = _geometry()
    log = write_log(folder / "dive.mcap", rig, stamps, alphas, stripes)
    store = SweepStore(folder / "sweeps")
    for index in range(IMAGES // PER_SWEEP):
        store.add(_sweep(index, stamps, alphas, profiles))
    store.finish([])
    seabed, builder = build_seabed(
        lambda: ((sweep, truth.at(sweep.stamp_ns).mounted(LOOK_DOWN)) for sweep in store), config.seabed, LOOK_DOWN
    )
    opened = open_log([log], config.log)
    dive = Dive([log], config, opened, rig, opened.navigation(), losses=["3 images: a damaged JPEG"])
    navigated = NavigationResult(_trajectory(stamps, OFFSET), np.tile([0.1, 0.0, 0.0], (IMAGES, 1)), {}, None, None)
    registered = Registered(
        trajectory=truth,
        inside=truth,
        rounds=[[Round(1.0, 10, 0.002, 0.1)]],
        graph_step=np.zeros(2),
        loops=1,
        agreement=Agreement(np.zeros((1, 2), np.float32), np.float32([0.02]), np.float32([0.001]), (-11.0, -12.0)),
        constants={},
    )
    mesh = triangulate(seabed, widest_hole=0.05)
    built = Map(navigated, registered, seabed, registered.trajectory, builder.accepted, dict(builder.rejected))
    return Scene(dive, store, built, mesh, stripes, log)


def make_log(path: Path) -> Path:
    """The scene's log alone."""
    rig, stamps, alphas, _, _, stripes = _geometry()
    return write_log(path, rig, stamps, alphas, stripes)


def _geometry() -> tuple[Rig, NDArray, NDArray, Trajectory, list[NDArray], list[NDArray]]:
    """Rig, stamps and laser angles of the images, the true path, the profiles and the stripes."""
    rig = make_rig(distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
    stamps = START + PERIOD_NS * np.arange(IMAGES)
    alphas = 0.2 + 0.25 * np.abs(np.arange(IMAGES) / PER_SWEEP - 1.0)
    truth = _trajectory(stamps, np.zeros(3))
    poses = truth.mounted(LOOK_DOWN)
    profiles = [profile(rig, alpha, poses, k) for k, alpha in enumerate(alphas)]
    return rig, stamps, alphas, truth, profiles, [rig.project(points) for points in profiles]


def profile(rig: Rig, alpha: float, poses: Trajectory, index: int) -> NDArray[np.float64]:
    """Where the sheet cuts the plane, (n, 3) m in the rig frame, on the rows of the image that see it."""
    turn, place = poses.rotation[index].as_matrix(), poses.position[index]
    u = np.linspace(0.0, rig.camera.width - 1.0, 200)
    normal = rig.sheet(alpha)[0]
    points = []
    for row in ROWS:  # along a row the sheet is crossed once
        origin, direction = rig.rays(u, np.full_like(u, row))
        world_origin, world_direction = origin @ turn.T + place, direction @ turn.T
        ground = origin + direction * ((SEABED_Z - world_origin[:, 2]) / world_direction[:, 2])[:, None]
        side = (ground - rig.laser.apex) @ normal
        cross = np.flatnonzero(side[:-1] * side[1:] < 0)
        if len(cross):
            k = cross[0]
            share = side[k] / (side[k] - side[k + 1])
            points.append(ground[k] + share * (ground[k + 1] - ground[k]))
    return np.array(points).reshape(-1, 3)


def write_log(path: Path, rig: Rig, stamps: NDArray, alphas: NDArray, stripes: list[NDArray]) -> Path:
    """Images with the stripe drawn on them, encoder at 100 Hz, attitude and pressure."""
    import cv2

    with LogWriter(path) as log:
        log.attach("rig.yaml", "application/yaml", rig.to_yaml().encode())
        log.write_mounts(int(stamps[0]), {"rig": LOOK_DOWN, "imu_link": Mount()})
        for k, stamp in enumerate(stamps.tolist()):
            picture = np.full((rig.camera.height, rig.camera.width, 3), 12, np.uint8)
            line = np.round(stripes[k]).astype(np.int32)
            cv2.polylines(picture, [line], False, LASER_GREEN, 3)
            noise = np.random.default_rng(k).integers(0, 6, picture.shape, np.uint8)
            log.write_image(Image(stamp, stamp, "jpeg", cv2.imencode(".jpg", picture + noise)[1].tobytes()))
            log.write_imu(stamp, [0, 0, 0], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3) * 1e-4)
            log.write_pressure(stamp, 101325.0 + 10.0 * 1025.0 * 9.80665)
        for stamp in range(int(stamps[0]), int(stamps[-1]) + 1, 10_000_000):
            log.write_encoder(stamp, float(np.interp(stamp - stamps[0], stamps - stamps[0], alphas)))
    return path


def recorded(path: Path) -> dict[str, dict[str, list]]:
    """Entity path -> column -> rows, of a recording; the column `stamp` is absent where all is static."""
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = found.setdefault(chunk.entity_path.removeprefix("/"), {})
        for name in batch.schema.names:
            values = batch.column(name)
            if pa.types.is_timestamp(values.type):
                values = values.cast(pa.int64())  # nanoseconds; what a timestamp becomes depends on what is installed
            columns.setdefault(name, []).extend(values.to_pylist())
    return found


def _trajectory(stamps: NDArray, offset: NDArray) -> Trajectory:
    position = np.stack([0.005 * np.arange(IMAGES), np.zeros(IMAGES), np.full(IMAGES, VEHICLE_Z)], axis=1) + offset
    covariance = np.tile(np.diag([1e-4, 4e-4, 1e-5, 1e-6, 1e-6, 1e-6]), (IMAGES, 1, 1))
    return Trajectory(stamps, position, np.tile([0.0, 0.0, 0.0, 1.0], (IMAGES, 1)), covariance)


def _sweep(index: int, stamps: NDArray, alphas: NDArray, profiles: list[NDArray]) -> Sweep:
    own = slice(index * PER_SWEEP, (index + 1) * PER_SWEEP)
    points = np.concatenate(profiles[own])
    lengths = [len(one) for one in profiles[own]]
    count = len(points)
    return Sweep(
        index,
        stamps[own],
        alphas[own],
        points,
        np.full(count, 1e-3, np.float32),
        np.full(count, 150.0, np.float32),
        np.repeat(np.arange(PER_SWEEP), lengths).astype(np.int32),
        np.concatenate([np.arange(length) for length in lengths]).astype(np.int32),
    )
