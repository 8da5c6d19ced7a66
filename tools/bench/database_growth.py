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

from garbi_map.calibrate.map_uncertainty import MapSamples, View
from garbi_map.config import Config
from garbi_map.db import Database, Pose, StoredDive, SubmapFile, join_map, write_poses, write_submap
from garbi_map.db.submaps import read_swept
from garbi_map.db.tiles import fuse_submap
from garbi_map.executor import open_workers
from garbi_map.export import POINT_BYTES, CloudWriter, write_contours, write_glb, write_hillshade, write_seabed_tif
from garbi_map.log.records import Mount
from garbi_map.navigate import Trajectory
from garbi_map.rig import Camera, Laser, Rig
from garbi_map.seabed import CELL_BYTES, JudgedPoints, SeabedBuilder, fuse, judge_in_stretches, triangulate
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore
from tools.bench.database_swath import SUBMAP_POINTS, SWEEPS, judged_swath, swath

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
            pool.submit(site, work / "warm", 0.3).result()  # compiled code and libraries are loaded
            rows.append(pool.submit(site, work / str(size), size).result())
        print(rows[-1], flush=True)
        shutil.rmtree(work)
    return {"sites": rows}


def site(work: Path, millions: float) -> dict[str, Any]:
    """One dive from its sweeps and its path to the products of its map, and then a dive of 0.9 million points that joins it:
    CPU microseconds per point of each stage, and the largest resident memory."""
    config, stages = Config(), Stages()
    swaths = range(round(1e6 * millions / SUBMAP_POINTS))
    room = config.export.room_for(CELL_BYTES)
    with Database(work / "db") as database, open_workers(1) as crew:
        with stages.measured("judging"):
            lay(database, *dive(work, "first", swaths, 0, config, stages), config)
        with stages.measured("fusion of submaps"):
            database.fuse(config.seabed, crew)
        with stages.measured("merging"):
            seabed = database.surface(config.seabed, room).finish()
        with stages.measured("calibration"):
            samples, view = MapSamples(seabed), scanner()
            for _, points in database.points():
                samples.add(points, view)
            seabed = samples.uncertainty(database.poses_at).carried_into(seabed, 0.0)
        with stages.measured("raster and mesh"):
            write_seabed_tif(work / "seabed.tif", seabed)
            mesh = triangulate(seabed, config.export.max_triangles, config.export.widest_hole)
            write_glb(work / "seabed.glb", mesh)
            write_contours(work / "contours.gpkg", seabed, config.export)
            write_hillshade(work / "hillshade.png", seabed, config.export, "", False)
        area, cell = seabed.area, seabed.cell
        at_once = config.export.room_for(POINT_BYTES)
        with (
            stages.measured("cloud.laz"),
            CloudWriter(work / "cloud.laz", config.export.cloud_scale, None, at_once) as cloud,
        ):
            for _, points in database.points():
                cloud.write(points)
        total = sum(one.written.points for one in database.submaps)
        per_point = {name: round(1e6 * seconds / total, 3) for name, seconds in stages.spent.items()}
        del seabed, mesh, samples
        with stages.measured("a further dive joins"):
            lay(database, *dive(work, "second", range(3), 1, config, stages), config)
    return {
        "million_points": round(total * 1e-6, 1),
        "area_m2": round(area),
        "cell_m": cell,
        "cpu_us_per_point": per_point,
        "further_dive_cpu_s": round(stages.spent["a further dive joins"], 1),
        "peak_mb": {name: round(peak) for name, peak in stages.peaks.items()},
        "budget_mb": round(1e3 * config.export.memory),
        "database_gb": round(sum(file.stat().st_size for file in work.rglob("*.parquet")) * 1e-9, 2),
    }


def dive(
    work: Path, name: str, swaths: range, number: int, config: Config, stages: Stages
) -> tuple[StoredDive, list[SubmapFile]]:
    """The sweeps of a dive judged, as submaps on disk; what simulates them is not measured."""
    with stages.unmeasured():
        store, path = simulated(work / name, swaths, number)

    def posed(begin: int, end: int) -> Iterator[tuple[Sweep, Trajectory]]:
        for index in range(begin, end):
            sweep = store.load(index)
            yield sweep, path.at(sweep.stamp_ns)

    written: list[SubmapFile] = []
    parts: list[tuple[int, JudgedPoints, np.ndarray]] = []
    for sweep, poses, points in judge_in_stretches(posed, len(store), lambda: SeabedBuilder(config.seabed)):
        parts.append((sweep.index, points, poses.position[sweep.profile[points.mask]]))
        if len(parts) == SWEEPS:
            written.append(write_submap(work / "db", f"{name}{len(written):06d}", parts))
            parts.clear()
    write_poses(work / "db" / f"trajectories/{name}.parquet", path)
    shutil.rmtree(work / name)
    ends = int(path.stamp_ns[0]), int(path.stamp_ns[-1])
    accepted = sum(one.points for one in written)
    file = f"trajectories/{name}.parquet"
    return StoredDive(name, name, name, *ends, "", Mount(), "", file, accepted, {}, []), written


def lay(database: Database, new: StoredDive, written: list[SubmapFile], config: Config) -> None:
    """A dive joins the map."""
    join_map(database, new, written, config.database.place)


def simulated(folder: Path, swaths: range, number: int) -> tuple[SweepStore, Trajectory]:
    """Sweeps on disk, and the path."""
    store, paths = SweepStore(folder), []
    for k in swaths:
        sweeps, path, _ = swath(k, number)
        paths.append(path)
        for sweep in sweeps:
            store.add(sweep)
    store.finish([])
    parts = ("stamp_ns", "position", "quaternion", "covariance")
    return store, Trajectory(*(np.concatenate([getattr(path, part) for path in paths]) for part in parts))


def scanner() -> View:
    """A rig that looks down, its sheet across the way."""
    forward = tuple(Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]).as_quat().tolist())
    camera = Camera("camera", 768, 576, 812.0, 812.0, 384.0, 288.0, (0.0,) * 5, (0.0,) * 3, forward, None)
    laser = Laser(x=0.0, y=-0.4, z=0.0, delta=0.0, theta=0.0, gamma=0.0, beta=0.02)
    down = Rotation.from_matrix([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]).as_quat()
    return View(Rig(camera, laser), Mount(quaternion=down))


def fusion(work: Path, count: int) -> dict[str, Any]:
    """Million points per second of wall clock and of CPU: in memory by one thread and two, from Parquet to Parquet by one
    process and two, and of Open3D's voxels, in turns, each the best of three."""
    import open3d as o3d

    config = Config()
    fuse_warm(work)
    names = [write_submap(work, f"{k:06d}", judged_swath(k)) for k in range(round((count or 6) * 1e6 / SUBMAP_POINTS))]
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


def memory(work: Path, name: str) -> Path:
    """Where the memory of a submap goes."""
    return work / f"memories/{name}.parquet"


def fuse_warm(work: Path) -> None:
    """Load compiled code before anything is measured."""
    work.mkdir(parents=True, exist_ok=True)
    one = write_submap(work, "warm", judged_swath(0))
    fuse_submap(work / one.file, Pose.of(TURNED, one.frame), Config().seabed, memory(work, "warm"))
    (work / one.file).unlink()
    memory(work, "warm").unlink()


class Stages:
    """CPU seconds and largest resident memory, MB, of each stage."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._left_out = 0.0
        self.peaks: dict[str, float] = {}

    @contextmanager
    def measured(self, name: str) -> Iterator[None]:
        """A block that is of this stage."""
        own = Path("/proc/self")
        (own / "clear_refs").write_text("5")  # the peak begins anew
        begin = time.process_time() - self._left_out
        yield
        self.spent[name] = time.process_time() - self._left_out - begin
        peak = next(line for line in (own / "status").read_text().splitlines() if line.startswith("VmHWM"))
        self.peaks[name] = int(peak.split()[1]) / 1024

    @contextmanager
    def unmeasured(self) -> Iterator[None]:
        """A block within one, that is not of it: no seconds of it count."""
        begin = time.process_time()
        yield
        self._left_out += time.process_time() - begin
