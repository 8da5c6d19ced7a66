"""From a recorded dive to a seabed map: the whole job, stage by stage."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from garbi_map.aside import alone_in, remove_leftovers
from garbi_map.config import Config
from garbi_map.dive import Dive, Map
from garbi_map.errors import GarbiError
from garbi_map.log import open_log
from garbi_map.navigate import Trajectory, navigate
from garbi_map.progress import Progress, Show, Silent, counted, unseen
from garbi_map.register import Scanner, register
from garbi_map.rig import load_rig, parse_rig
from garbi_map.scan import ScanLosses, scan, scan_key
from garbi_map.seabed import AcceptedPoints, Seabed, SeabedBuilder, build_seabed
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore


def build_map(
    paths: list[Path],
    out: Path,
    config: Config,
    rig_path: Path | None = None,
    span: tuple[float | None, float | None] = (None, None),
    workers: int = 2,
    progress: Progress | None = None,
    show: Show = unseen,
) -> list[str]:
    """Build the seabed map of one or more logs into the folder `out`; returns what was left out, one line each.

    span: first and last second to use, counted from the log's begin. Stopped and started again, it goes on after the last
    finished stage that is worth keeping: the sweeps. `show` is given sweeps, path and points as they come.
    Raises GarbiError where the input cannot give a map, and where another run is writing into `out`.
    """
    from garbi_map.outputs import write_outputs

    progress = progress or Silent()
    started = time.perf_counter()
    dive = open_dive(paths, config, rig_path, span)
    for remark in dive.log.remarks:
        progress.note(remark)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GarbiError(f"{out}: cannot be made a folder: {error.strerror}") from error
    with alone_in(out):
        remove_leftovers(out)
        work = out / ".work"

        with timed(dive, "stripes and sweeps"):
            store = sweeps_of(dive, work, workers, progress, show)
        with timed(dive, "navigation"):
            progress.stage("navigation")
            navigated = navigate(dive.navigation, config.navigate, store.stamps())
        with timed(dive, "registration"):
            progress.stage("registration")
            scanner = Scanner(dive.rig, dive.angle, dive.navigation.mount("rig"))
            registered = register(
                store, dive.navigation, navigated, config.registration, config.navigate, progress.note, scanner
            )
        show(registered.trajectory)
        with timed(dive, "seabed"):
            progress.stage("seabed", 3 * len(store))
            seabed, builder = fuse(dive, store, registered.inside, out, progress, show)
        write_outputs(out, dive, store, Map(navigated, registered, seabed, builder), started, progress)
        shutil.rmtree(work, ignore_errors=True)
    return dive.left_out


def open_dive(
    paths: list[Path], config: Config, rig_path: Path | None, span: tuple[float | None, float | None] = (None, None)
) -> Dive:
    """The log, its rig and its navigation; a rig file that is given wins over the attached one."""
    log = open_log(paths, config.log)
    if rig_path is not None:
        rig = load_rig(rig_path)
    elif log.rig_text is not None:
        rig = parse_rig(log.rig_text, f"{paths[0]}: attachment rig.yaml")
    else:
        raise GarbiError(f"{paths[0]}: the log carries no rig.yaml; give one with --rig rig.yaml")
    if log.image_count == 0:
        raise GarbiError(
            f"{paths[0]}: no images on {config.log.topics.image}; name the topic in the configuration, log.topics.image"
        )
    begin_ns, end_ns = (None if t is None else log.begin_ns + round(t * 1e9) for t in span)
    first, last = max(begin_ns or log.begin_ns, log.begin_ns), log.end_ns if end_ns is None else end_ns
    if first >= min(last, log.end_ns):
        length = (log.end_ns - log.begin_ns) * 1e-9
        raise GarbiError(f"{paths[0]}: nothing between the asked seconds; the log lasts {length:.1f} s")
    navigation = log.navigation(begin_ns, end_ns, joint=rig.laser.joint)
    return Dive(paths, config, log, rig, navigation, (begin_ns, end_ns))


def sweeps_of(dive: Dive, work: Path, workers: int, progress: Progress, show: Show = unseen) -> SweepStore:
    """The sweeps of the dive on disk: those of an interrupted run where nothing has changed since, else made now."""
    folder = work / scan_key(dive.paths, dive.rig, dive.config, dive.span_ns)
    store = SweepStore.open(folder)
    if store is None:
        shutil.rmtree(work, ignore_errors=True)
        progress.stage("stripes and sweeps", dive.log.image_count)
        losses = ScanLosses()
        store = SweepStore(folder)
        for sweep in scan(dive.log, dive.rig, dive.navigation, dive.config, dive.span_ns, workers, losses, progress):
            store.add(sweep)
            show(sweep)
        store.finish([*dive.log.losses, *losses.lines()])
    dive.losses += store.losses
    if sum(entry.profiles for entry in store.entries) < 2:
        shutil.rmtree(work, ignore_errors=True)
        why = f" ({'; '.join(store.losses)})" if store.losses else ""
        raise GarbiError(
            f"{dive.paths[0]}: the laser is not seen in two images or more{why}; look at it with garbi stripe --overlay"
        )
    return store


def fuse(
    dive: Dive, store: SweepStore, trajectory: Trajectory, out: Path, progress: Progress, show: Show = unseen
) -> tuple[Seabed, SeabedBuilder]:
    """The accepted points of all sweeps, into cloud.laz and the surface; what moved, into moving.laz."""
    from garbi_map.export import CloudWriter

    mount = dive.navigation.mount("rig")

    def posed() -> Iterator[tuple[Sweep, Trajectory]]:
        for sweep in counted(store, progress):
            yield sweep, trajectory.at(sweep.stamp_ns).mounted(mount)

    scale = dive.config.export.cloud_scale
    with CloudWriter(out / "cloud.laz", scale) as cloud, CloudWriter(out / "moving.laz", scale) as moving:

        def take(points: AcceptedPoints) -> None:
            cloud.write(points)
            if points.moving is not None:
                moving.write(points.moving)
            show(points)

        return build_seabed(posed, dive.config.seabed, mount, take, dive.rig.eyes)


@contextmanager
def timed(dive: Dive, stage: str) -> Iterator[None]:
    """Adds the seconds of a stage to the dive's timings."""
    begin = time.perf_counter()
    yield
    dive.timings[stage] = time.perf_counter() - begin
