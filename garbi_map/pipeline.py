"""From recorded dives to a seabed map that grows with each of them: the whole job, stage by stage."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from garbi_map.aside import alone_in, make_folder, remove_leftovers
from garbi_map.calibrate.map_uncertainty import MapSamples, View
from garbi_map.config import Config
from garbi_map.db import Database, StoredDive, join_map, laid, lay_all
from garbi_map.dive import Dive, Map, Span, open_dive
from garbi_map.errors import GarbiError
from garbi_map.estimate import Estimate, estimate, estimate_apart, sweeps_of, timed, trajectory_file
from garbi_map.executor import beside, open_workers
from garbi_map.export import POINT_BYTES, CloudWriter, Georeference, Located
from garbi_map.outputs import write_outputs
from garbi_map.place import check_place, place_on_earth
from garbi_map.progress import Progress, Show, Silent, unseen
from garbi_map.publish import is_published, published, roll_forward
from garbi_map.recordings import split_recordings
from garbi_map.rig import parse_rig
from garbi_map.seabed import CELL_BYTES

__all__ = ["build_map", "open_dive", "sweeps_of"]


def build_map(
    paths: list[Path],
    out: Path,
    config: Config,
    rig_path: Path | None = None,
    span: Span = (None, None),
    workers: int = 2,
    progress: Progress | None = None,
    show: Show = unseen,
    dask: str | None = None,
) -> list[str]:
    """Build the seabed map of one or more dives into the folder `out`; returns what was left out, one line each.

    Where there is a map already, the dives join it; one that it holds already, made in the same way, changes nothing.
    Stopped and started again, it goes on after the last stage that was finished, and gives the same map to the byte.
    Several dives are estimated by that many processes, or by the workers of the Dask scheduler at an address.
    Raises GarbiError where the input cannot give a map, and where another run is writing into `out`.
    """
    progress = progress or Silent()
    started = time.perf_counter()
    rig_path = rig_path and rig_path.absolute()
    recordings = split_recordings(paths, config.log, config.database.split_gap)
    dives = [open_dive(recording, config, rig_path, span) for recording in recordings]
    for remark in dict.fromkeys(remark for dive in dives for remark in dive.log.remarks):
        progress.note(remark)
    make_folder(out)
    with (
        alone_in(out),
        Database(out.absolute() / "db") as database,
        open_workers(workers if len(dives) > 1 else 1, dask) as crew,
    ):
        remove_leftovers(out)
        roll_forward(database, out)
        new = [dive for dive in dives if not database.holds(dive.recording, dive.key)]
        if not new and is_published(database, out, config):
            return left_out(database, dives)
        check_orphans(database, out)
        check_rigs(database, new)
        check_place(database, dives[0])

        work = out.absolute() / ".work"
        jobs: list[tuple[Any, ...]] = []
        if len(new) > 1 or dask is not None:
            progress.stage("dives, each by itself", len(new))
            jobs = [
                ([path.absolute() for path in dive.paths], config, rig_path, span, database.folder, work)
                for dive in new
            ]

        def lay(dive: Dive) -> tuple[Dive, Estimate]:
            for _ in islice(apart, 1):  # it joins the map while others are still estimated
                progress.advance()
            made = estimate(dive, database.folder, work, workers, progress, show)
            if dive in new:
                with timed(dive, "place in the map"):
                    first = place_on_earth(database, dive, made).transform
                    join_map(database, stored(dive, made), made.judged.submaps, config.database.place, first)
            return dive, made

        with closing(crew.results(estimate_apart, jobs)) as apart:
            dive, made = lay_all(new or dives[-1:], lay)
        with timed(dive, "fusion"):
            progress.stage("fusion")
            database.fuse(config.seabed, crew)
            database.remove_unnamed()
        with published(database, out, config) as files, beside() as (thread, wanted):
            located = place_on_earth(database, dive, made)
            clouds = thread.submit(write_clouds, database, files, config, located.reference, wanted)
            with timed(dive, "surface and its uncertainty"):
                built = with_calibration(map_of(database, dive, made, located), database, dive)
            write_outputs(files, out, dive, made.store, built, clouds, started, progress)
        shutil.rmtree(work, ignore_errors=True)
        return left_out(database, dives)


def check_orphans(database: Database, out: Path) -> None:
    """Raises GarbiError where a folder holds the files of a map whose database is gone: a new map would replace them."""
    left = [name for name in ("cloud.laz", "seabed.tif", "trajectory.tum") if (out / name).exists()]
    if left and not database.dives:
        raise GarbiError(
            f"{out}: holds {left[0]} of a map without its database: put {database.folder} back, or choose another folder"
        )


def check_rigs(database: Database, new: list[Dive]) -> None:
    """Raises GarbiError where a dive was made with another rig than those that it joins, unless that is allowed."""
    replaced = {dive.recording for dive in new}
    rigs = [known.rig for known in database.dives if known.recording not in replaced]
    for dive in new:
        rigs.append(dive.rig.to_yaml())
        if rigs[0] != rigs[-1] and not dive.config.database.several_rigs:
            raise GarbiError(
                f"{dive.paths[0]}: the map in {database.folder.parent} is of dives with another rig.yaml; choose another "
                "folder, or say database: {several_rigs: true} in the configuration"
            )


def left_out(database: Database, dives: list[Dive]) -> list[str]:
    """What was in the logs and is not in the map, one line each."""
    return [line for dive in dives for line in database.dive(dive.recording).left_out]


def stored(dive: Dive, made: Estimate) -> StoredDive:
    """The dive as the catalogue knows it, before it has a place."""
    stamps = made.registered.trajectory.stamp_ns
    return StoredDive(
        recording=dive.recording,
        estimate=dive.key,
        title=dive.title,
        begin_ns=int(stamps[0]),
        end_ns=int(stamps[-1]),
        rig=dive.rig.to_yaml(),
        mount=dive.navigation.mount("rig"),
        configuration=dive.config.to_yaml(),
        trajectory=trajectory_file(dive),
        accepted=made.judged.accepted,
        rejected=made.judged.rejected,
        left_out=dive.left_out,
    )


def map_of(database: Database, dive: Dive, made: Estimate, located: Located) -> Map:
    """The map of all dives, and this one's estimate as it lies in it."""
    submaps = database.dive(dive.recording).submaps
    rejected: Counter[str] = Counter()
    for known in database.dives:
        rejected.update(known.rejected)
    return Map(
        navigated=replace(made.navigated, trajectory=laid(made.navigated.trajectory, submaps)),
        registered=replace(
            made.registered,
            trajectory=laid(made.registered.trajectory, submaps),
            inside=laid(made.registered.inside, submaps),
            agreement=made.registered.agreement.moved(submaps[0].transform),
        ),
        seabed=database.surface(dive.config.seabed, dive.config.export.room_for(CELL_BYTES)).finish(),
        path=database.trajectory(),
        accepted=sum(known.accepted for known in database.dives),
        rejected=dict(rejected),
        located=located,
    )


def write_clouds(
    database: Database, files: Path, config: Config, reference: Georeference, wanted: Callable[[], None]
) -> None:
    """The points of all dives: those of the seabed, and apart from them what moved; `wanted` is called for each part."""
    accepted = (points for _, points in database.points())
    for name, parts in (("cloud.laz", accepted), ("moving.laz", database.moving())):
        at_once = config.export.room_for(POINT_BYTES)
        with CloudWriter(files / name, config.export.cloud_scale, reference, at_once) as cloud:
            for points in parts:
                wanted()
                cloud.write(points)


def with_calibration(built: Map, database: Database, dive: Dive) -> Map:
    """The map with what the calibration and the path leave open in the uncertainties of its cells."""
    rigs = {known.rig: parse_rig(known.rig, database.folder.name) for known in database.dives}
    views = {known.recording: View(rigs[known.rig], known.mount) for known in database.dives}
    samples = MapSamples(built.seabed)
    for known, points in database.points():
        samples.add(points, views[known.recording])
    doubt = samples.uncertainty(database.poses_at)
    level = dive.config.export.surface_sigma if dive.navigation.pressure is not None else 0.0
    return replace(built, seabed=doubt.carried_into(built.seabed, level), doubt=doubt)
