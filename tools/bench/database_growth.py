"""How time and memory grow with the number of points, and how fast points are fused, beside Open3D's voxels."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.config import Config
from garbi_map.db import Pose, write_submap
from garbi_map.db.submaps import read_submap
from garbi_map.db.tiles import fuse_submap, merge_memories
from garbi_map.executor import open_workers
from garbi_map.export import CloudWriter
from garbi_map.seabed import JudgedPoints

SUBMAP_POINTS = 300_000
"""What half a minute of 20 images a second gives."""
SWATH, SPEED = 1.0, 0.12
"""m and m/s: the ground that a slow vehicle covers in that time, so that the area grows with the points."""
SWEEPS, PROFILES = 8, 75
REACH = 1.0
"""m, along the way, that a sweep covers."""
LANE = 36.0


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
    return {"sites": rows, "fusion": fusion(work / "speed")}


def site(work: Path, millions: float) -> dict[str, Any]:
    """From judged points to products: CPU microseconds per point of each stage, and the largest resident memory."""
    config, names = Config(), []
    spent: dict[str, float] = {}
    fuse_warm(work)
    for k in range(round(1e6 * millions / SUBMAP_POINTS)):
        parts = swath(k)
        with counted(spent, "submaps"):
            names.append(write_submap(work, f"{k:06d}", parts))
    poses = [Pose.of(np.eye(4), one.frame) for one in names]
    tiles = []
    with counted(spent, "fusion of submaps"):
        for one, pose in zip(names, poses, strict=True):
            tiles.append(fuse_submap(work / one.file, pose, config.seabed, memory(work, one.name)))
    with counted(spent, "merging"):
        grid = merge_memories(
            [(memory(work, one.name), own) for one, own in zip(names, tiles, strict=True)], config.seabed
        )
        seabed = grid.finish()
        del grid
    with counted(spent, "cloud.laz"), CloudWriter(work / "cloud.laz", config.export.cloud_scale) as cloud:
        for one, pose in zip(names, poses, strict=True):
            for points in read_submap(work / one.file).sweeps(pose):
                cloud.write(points)
    total = sum(one.points for one in names)
    return {
        "million_points": round(total * 1e-6, 1),
        "area_m2": round(seabed.area),
        "cell_m": seabed.cell,
        "cpu_us_per_point": {name: round(1e6 * seconds / total, 3) for name, seconds in spent.items()},
        "peak_mb": round(peak_mb()),
        "database_gb": round(sum(file.stat().st_size for file in work.rglob("*.parquet")) * 1e-9, 2),
    }


def fusion(work: Path, submaps: int = 20) -> dict[str, Any]:
    """Points per second of wall clock and of CPU, from Parquet to Parquet, on one process and two; and Open3D's."""
    import open3d as o3d

    config = Config()
    fuse_warm(work)
    names = [write_submap(work, f"{k:06d}", swath(k)) for k in range(submaps)]
    jobs = [(work / one.file, Pose.of(np.eye(4), one.frame), config.seabed, memory(work, one.name)) for one in names]
    total = sum(one.points for one in names)
    found: dict[str, Any] = {"million_points": total * 1e-6}
    for processes in (1, 2):
        with open_workers(processes) as crew:
            crew.run(fuse_submap, jobs[:4])
            begin = time.monotonic()
            crew.run(fuse_submap, jobs)
            found[f"{processes} process, million points/s of wall clock"] = round(
                total / (time.monotonic() - begin) * 1e-6, 2
            )
    begin = time.process_time()
    for job in jobs:
        fuse_submap(*job)
    found["million points/s of CPU, with files"] = round(total / (time.process_time() - begin) * 1e-6, 2)
    loaded = [list(read_submap(work / one.file).sweeps(Pose.of(np.eye(4), one.frame))) for one in names]
    from garbi_map.seabed import SurfaceGrid

    grid = SurfaceGrid(config.seabed)
    begin = time.process_time()
    for sweeps in loaded:
        for sweep in sweeps:
            grid.add(sweep)
    found["million points/s of CPU, in memory"] = round(total / (time.process_time() - begin) * 1e-6, 2)
    points = np.concatenate([sweep.points for sweeps in loaded for sweep in sweeps])
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    begin = time.process_time()
    cloud.voxel_down_sample(config.seabed.cell)
    found["Open3D voxel_down_sample, million points/s of CPU"] = round(total / (time.process_time() - begin) * 1e-6, 2)
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
    fuse_submap(work / one.file, Pose.of(np.eye(4), one.frame), Config().seabed, memory(work, "warm"))
    (work / one.file).unlink()
    memory(work, "warm").unlink()
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew


def peak_mb() -> float:
    """Largest resident memory."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


@contextmanager
def counted(spent: dict[str, float], name: str) -> Iterator[None]:
    """Adds the CPU seconds of a block."""
    begin = time.process_time()
    yield
    spent[name] = spent.get(name, 0.0) + time.process_time() - begin
