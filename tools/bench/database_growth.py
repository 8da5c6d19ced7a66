"""How time and memory grow with the number of points, and how fast points are fused, beside Open3D's voxels."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.db import Pose, write_submap
from garbi_map.db.submaps import read_submap, read_swept
from garbi_map.db.tiles import fuse_submap, merge_memories
from garbi_map.executor import open_workers
from garbi_map.export import POINT_BYTES, CloudWriter, write_contours, write_glb, write_hillshade, write_seabed_tif
from garbi_map.seabed import CELL_BYTES, JudgedPoints, fuse, triangulate

SUBMAP_POINTS = 300_000
"""What half a minute of 20 images a second gives."""
SWATH, SPEED = 1.0, 0.12
"""m and m/s: the ground that a slow vehicle covers in that time, so that the area grows with the points."""
SWEEPS, PROFILES = 8, 75
REACH = 1.0
"""m, along the way, that a sweep covers."""
LANE = 36.0
TURNED = np.eye(4)
TURNED[:3, :3] = Rotation.from_euler("zyx", [0.01, 0.002, -0.003]).as_matrix()
"""map <- dive of a further dive."""


def growth(work: Path, count: int) -> dict[str, Any]:
    """Sites of 1, 3, 10, ... million points, up to `count`; each in a process of its own."""
    most = count or 100
    sizes = [size for size in (1, 3, 10, 30, 100) if size <= most]
    rows = []
    for size in sizes:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            rows.append(pool.submit(site, work / str(size), size).result())
        print(rows[-1], flush=True)
        shutil.rmtree(work / str(size))
    return {"sites": rows}


def site(work: Path, millions: float) -> dict[str, Any]:
    """From judged points to products: CPU microseconds per point of each stage, and the largest resident memory."""
    config, names = Config(), []
    stages = Stages()
    fuse_warm(work)
    for k in range(round(1e6 * millions / SUBMAP_POINTS)):
        parts = swath(k)
        with stages.measured("submaps"):
            names.append(write_submap(work, f"{k:06d}", parts))
    poses = [Pose.of(TURNED, one.frame) for one in names]
    tiles = []
    with stages.measured("fusion of submaps"):
        for one, pose in zip(names, poses, strict=True):
            tiles.append(fuse_submap(work / one.file, pose, config.seabed, memory(work, one.name)))
    fewer = config.seabed.model_copy(
        update={"max_cells": min(config.seabed.max_cells, config.export.room_for(CELL_BYTES))}
    )
    with stages.measured("merging"):
        memories = [(memory(work, one.name), own) for one, own in zip(names, tiles, strict=True)]
        seabed = merge_memories(memories, fewer).finish()
    with stages.measured("raster and mesh"):
        write_seabed_tif(work / "seabed.tif", seabed)
        mesh = triangulate(seabed, config.export.max_triangles, config.export.widest_hole)
        write_glb(work / "seabed.glb", mesh)
        write_contours(work / "contours.gpkg", seabed, config.export)
        write_hillshade(work / "hillshade.png", seabed, config.export, "", False)
    at_once = config.export.room_for(POINT_BYTES)
    with (
        stages.measured("cloud.laz"),
        CloudWriter(work / "cloud.laz", config.export.cloud_scale, None, at_once) as cloud,
    ):
        for one, pose in zip(names, poses, strict=True):
            for points in read_submap(work / one.file).sweeps(pose):
                cloud.write(points)
    total = sum(one.points for one in names)
    return {
        "million_points": round(total * 1e-6, 1),
        "area_m2": round(seabed.area),
        "cell_m": seabed.cell,
        "cpu_us_per_point": {name: round(1e6 * seconds / total, 3) for name, seconds in stages.spent.items()},
        "peak_mb": {name: round(peak) for name, peak in stages.peaks.items()},
        "budget_mb": round(1e3 * config.export.memory),
        "database_gb": round(sum(file.stat().st_size for file in work.rglob("*.parquet")) * 1e-9, 2),
    }


def fusion(work: Path, count: int) -> dict[str, Any]:
    """Million points per second of wall clock and of CPU: in memory by one thread and two, from Parquet to Parquet by one
    process and two, and of Open3D's voxels, in turns, each the best of three."""
    import open3d as o3d

    config = Config()
    fuse_warm(work)
    names = [write_submap(work, f"{k:06d}", swath(k)) for k in range(round((count or 6) * 1e6 / SUBMAP_POINTS))]
    jobs = [(work / one.file, Pose.of(TURNED, one.frame), config.seabed, memory(work, one.name)) for one in names]
    loaded = [read_swept(*job[:2]) for job in jobs]
    total = sum(one.points for one in names)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate([one.placed for one in loaded])))
    with open_workers(2) as pair, ThreadPoolExecutor(2) as threads:
        pair.run(fuse_submap, jobs[:4])
        ways: dict[str, Callable[[], object]] = {
            "fused in memory, one thread": lambda: [fuse(one, config.seabed) for one in loaded],
            "fused in memory, two threads": lambda: list(threads.map(partial(fuse, settings=config.seabed), loaded)),
            "from Parquet to Parquet, one process": lambda: [fuse_submap(*job) for job in jobs],
            "from Parquet to Parquet, two processes": lambda: pair.run(fuse_submap, jobs),
            "Open3D voxel_down_sample": lambda: cloud.voxel_down_sample(config.seabed.cell),
        }
        best = dict.fromkeys(ways, (np.inf, np.inf))
        for _ in range(3):
            for name, way in ways.items():
                wall, cpu = time.monotonic(), time.process_time()
                way()
                wall, cpu = time.monotonic() - wall, time.process_time() - cpu
                best[name] = min(best[name][0], wall), min(best[name][1], cpu)
    found: dict[str, Any] = {"million_points": total * 1e-6, "load_of_the_machine": round(os.getloadavg()[0], 1)}
    for name, (wall, cpu) in best.items():
        own = {"wall": round(total / wall * 1e-6, 2)}
        found[name] = own if "two processes" in name else own | {"cpu": round(total / cpu * 1e-6, 2)}
    return found


def swath(number: int) -> list[tuple[int, JudgedPoints, np.ndarray]]:
    """Half a minute of sweeps over ripples, on the way along lanes."""
    rng = np.random.default_rng(number)
    length = SPEED * 30.0
    per_lane = round(LANE / length)
    lane, along = divmod(number, per_lane)
    each = SUBMAP_POINTS // SWEEPS
    parts = []
    for k in range(SWEEPS):
        profile = np.arange(each) * PROFILES // each
        pass_ = profile / PROFILES if k % 2 else 1.0 - profile / PROFILES  # there and back, as the mirror turns
        x = along * length + (k + 0.5) * length / SWEEPS + REACH * (pass_ - 0.5)
        row = np.arange(each) % (each // PROFILES)
        y = 0.9 * SWATH * lane + SWATH * (row + rng.uniform(0, 1, each)) * PROFILES / each
        slope = np.stack([0.3 * np.cos(40 * x), np.zeros(each)], axis=1)
        points = np.column_stack([x, y, 0.0075 * np.sin(40 * x) + 3e-4 * rng.normal(size=each)])
        stamps = profile.astype(np.int64) * 50_000_000 + (SWEEPS * number + k) * 4_000_000_000
        judged = JudgedPoints(
            stamps, points, np.full(each, 4e-4, np.float32), rng.uniform(50, 200, each).astype(np.float32),
            np.zeros(each, np.uint8), gradient=slope, noise=rng.uniform(5e-8, 2e-7, each), pose=np.full(each, 2e-4),
        )  # fmt: skip
        parts.append((k, judged, points + np.array([0.0, 0.0, 1.3])))
    return parts


def memory(work: Path, name: str) -> Path:
    """Where the memory of a submap goes."""
    return work / f"memories/{name}.parquet"


def fuse_warm(work: Path) -> None:
    """Load compiled code before anything is measured."""
    work.mkdir(parents=True, exist_ok=True)
    one = write_submap(work, "warm", swath(0))
    fuse_submap(work / one.file, Pose.of(TURNED, one.frame), Config().seabed, memory(work, "warm"))
    (work / one.file).unlink()
    memory(work, "warm").unlink()


class Stages:
    """CPU seconds and largest resident memory, MB, of each stage."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self.peaks: dict[str, float] = {}

    @contextmanager
    def measured(self, name: str) -> Iterator[None]:
        """A block that is of this stage."""
        own = Path("/proc/self")
        (own / "clear_refs").write_text("5")  # the peak begins anew
        begin = time.process_time()
        yield
        self.spent[name] = self.spent.get(name, 0.0) + time.process_time() - begin
        peak = next(line for line in (own / "status").read_text().splitlines() if line.startswith("VmHWM"))
        self.peaks[name] = max(self.peaks.get(name, 0.0), int(peak.split()[1]) / 1024)
