"""A dive by itself, stage by stage: sweeps, navigation, registration, judged points. Each stage is kept on disk."""

from __future__ import annotations

import shutil
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.config import Config
from garbi_map.db import SubmapFile, keep, recall, write_poses, write_submap
from garbi_map.dive import Dive, Span, open_dive
from garbi_map.errors import GarbiError
from garbi_map.executor import Serial
from garbi_map.navigate import NavigationResult, Trajectory, navigate
from garbi_map.progress import Progress, Show, Silent, counted, unseen
from garbi_map.register import Registered, Scanner, register
from garbi_map.register.agreement import Agreement
from garbi_map.register.drift import Round
from garbi_map.register.timing import Offset
from garbi_map.scan import ScanLosses, scan
from garbi_map.seabed import JudgedPoints, SeabedBuilder, judge_in_stretches
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore

_REGISTERED = "registered.npz"
_KINDS = (NavigationResult, Registered, Trajectory, Round, Agreement, Offset)


@dataclass(frozen=True)
class Judged:
    """The points that were accepted, as submaps on disk; how many, and how many were left out, by reason."""

    submaps: list[SubmapFile]
    accepted: int
    rejected: dict[str, int]


@dataclass(frozen=True)
class Estimate:
    """A dive in its own frame, which begins where it begins."""

    store: SweepStore
    navigated: NavigationResult
    registered: Registered
    judged: Judged


def estimate(
    dive: Dive, database: Path, work: Path, workers: int = 2, progress: Progress | None = None, show: Show = unseen
) -> Estimate:
    """Estimate a dive; its submaps and its trajectory go into the database's folder, where nothing names them yet.

    What an earlier run has kept in `work` is taken from there. `show` is given sweeps, path and points as they come.
    Raises GarbiError where the input cannot give a map.
    """
    progress = progress or Silent()
    threading.Thread(target=_import_ahead).start()
    with timed(dive, "stripes and sweeps"):
        sweeps = sweeps_of(dive, work, workers, progress, show)
    folder = work / dive.key
    with timed(dive, "navigation and registration"):
        store, navigated, registered = registered_of(dive, sweeps, folder, progress)
    show(registered.trajectory)
    with ThreadPoolExecutor(1) if workers > 1 else Serial() as beside, timed(dive, "seabed"):
        ended = beside.submit(checked_rig, dive, store, navigated, registered, folder)
        judged = judged_of(dive, store, registered.inside, database, folder, progress, show)
        write_poses(database / trajectory_file(dive), registered.trajectory)
        navigated, registered = ended.result()
    return Estimate(store, navigated, registered, judged)


def _import_ahead() -> None:
    """Libraries of the later stages, seconds in all, while images are decoded, which leaves Python idle.

    One that is broken is for the stage that needs it to tell.
    """
    for name in ("garbi_map.navigate.eskf", "open3d", "rerun"):
        with suppress(Exception):
            import_module(name)


def estimate_apart(
    paths: list[Path], config: Config, rig_path: Path | None, span: Span, database: Path, work: Path
) -> None:
    """The same as a job for any worker, on one thread; the results are what it leaves on disk."""
    estimate(open_dive(paths, config, rig_path, span), database, work, workers=1)


def trajectory_file(dive: Dive) -> str:
    """Relative to the database."""
    return f"trajectories/{dive.key}.parquet"


def sweeps_of(dive: Dive, work: Path, workers: int, progress: Progress, show: Show = unseen) -> SweepStore:
    """The sweeps of the dive on disk: those of an interrupted run where nothing has changed since, else made now."""
    folder = work / dive.sweeps_key
    store = SweepStore.open(folder)
    if store is None:
        shutil.rmtree(folder, ignore_errors=True)
        progress.stage("stripes and sweeps", dive.log.image_count)
        losses = ScanLosses()
        store = SweepStore(folder)
        for sweep in scan(dive.log, dive.rig, dive.navigation, dive.config, dive.span_ns, workers, losses, progress):
            store.add(sweep)
            show(sweep)
        store.finish([*dive.log.losses, *losses.lines()])
    dive.losses += store.losses
    if sum(entry.profiles for entry in store.entries) < 2:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            work.rmdir()
        why = f" ({'; '.join(store.losses)})" if store.losses else ""
        raise GarbiError(
            f"{dive.paths[0]}: the laser is not seen in two images or more{why}; look at it with garbi stripe --overlay"
        )
    return store


def registered_of(
    dive: Dive, sweeps: SweepStore, folder: Path, progress: Progress
) -> tuple[SweepStore, NavigationResult, Registered]:
    """The sweeps as the registration leaves them, which may set their clock right, and both trajectories."""
    kept, own = folder / _REGISTERED, folder / "sweeps"
    known, store = recall(kept, _KINDS), SweepStore.open(own)
    if known is not None and store is not None:
        return store, *known
    shutil.rmtree(own, ignore_errors=True)
    store = sweeps.linked(own)
    progress.stage("navigation")
    navigated = navigate(dive.navigation, dive.config.navigate, store.stamps())
    progress.stage("registration")
    scanner = Scanner(dive.rig, dive.angle, dive.navigation.mount("rig"))
    settings = dive.config
    registered = register(
        store, dive.navigation, navigated, settings.registration, settings.navigate, progress.note, scanner
    )
    return store, navigated, registered


def checked_rig(
    dive: Dive, store: SweepStore, navigated: NavigationResult, registered: Registered, folder: Path
) -> tuple[NavigationResult, Registered]:
    """Both trajectories with what the sweeps say against the rig, kept on disk."""
    from garbi_map.calibrate.field import placed
    from garbi_map.calibrate.field_check import rig_notes

    if registered.rig_notes is None:
        registered = replace(registered, rig_notes=rig_notes(placed(dive, store, navigated, registered)))
        navigated = replace(navigated, inertial=None, attitude=None)  # intermediate, and as large as the log's own
        keep(folder / _REGISTERED, (navigated, registered))
    return navigated, registered


def judged_of(
    dive: Dive,
    store: SweepStore,
    trajectory: Trajectory,
    database: Path,
    folder: Path,
    progress: Progress,
    show: Show = unseen,
) -> Judged:
    """The points that belong to the seabed, judged by all sweeps of the dive; on disk as submaps."""
    kept = folder / "judged.npz"
    known = recall(kept, (Judged, SubmapFile))
    if known is not None and all((database / file).is_file() for submap in known.submaps for file in submap.files):
        return known
    progress.stage("seabed", 3 * len(store))
    mount = dive.navigation.mount("rig")

    def posed(begin: int, end: int) -> Iterator[tuple[Sweep, Trajectory]]:
        for index in counted(range(begin, end), progress):
            sweep = store.load(index)
            yield sweep, trajectory.at(sweep.stamp_ns).mounted(mount)

    def judge() -> SeabedBuilder:
        return SeabedBuilder(dive.config.seabed, mount, dive.rig.eyes)

    submaps: list[SubmapFile] = []
    parts: list[tuple[int, JudgedPoints, NDArray[np.float64]]] = []
    longest = round(dive.config.database.submap_seconds * 1e9)

    def close() -> None:
        if sum(len(points.points) for _, points, _ in parts):
            submaps.append(write_submap(database, f"{dive.key}-{len(submaps):04d}", parts))
        parts.clear()

    begin_ns = 0
    accepted, rejected = 0, Counter[str]()
    for sweep, poses, points in judge_in_stretches(posed, len(store), judge):
        accepted += len(points.points)
        rejected.update(points.rejected)
        if parts and sweep.stamp_ns[-1] - begin_ns > longest:
            close()
        if not parts:
            begin_ns = int(sweep.stamp_ns[0])
        parts.append((sweep.index, points, poses.position[sweep.profile[points.mask]]))
        show(points)
    close()
    if not submaps:
        raise GarbiError(f"{dive.paths[0]}: no point of the seabed was accepted: there is no map to make")
    judged = Judged(submaps, accepted, dict(rejected))
    keep(kept, judged)
    return judged


@contextmanager
def timed(dive: Dive, stage: str) -> Iterator[None]:
    """Adds the seconds of a stage to the dive's timings."""
    begin = time.perf_counter()
    yield
    dive.timings[stage] = time.perf_counter() - begin
