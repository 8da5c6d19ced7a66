"""The files of a finished map, each complete or absent, and the report that says how good it is."""

from __future__ import annotations

import importlib.metadata
import time
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from garbi_map import __version__
from garbi_map.export import (
    Located,
    Place,
    Quantity,
    Report,
    Source,
    Topic,
    also_copc,
    bathymetry,
    correction,
    describe_seabed,
    plain_verdict,
    weak_places,
    write_contours,
    write_glb,
    write_hillshade,
    write_ply,
    write_report_html,
    write_report_json,
    write_seabed_tif,
    write_text,
    write_trajectory,
)
from garbi_map.export.solid import surface_of
from garbi_map.progress import Progress
from garbi_map.register import ENTROPY_RADIUS
from garbi_map.register.timing import NAMES
from garbi_map.seabed import triangulate
from garbi_map.sweep.store import SweepStore
from garbi_map.timeline import timeline
from garbi_map.words import many

if TYPE_CHECKING:
    from garbi_map.dive import Dive, Map
    from garbi_map.register import Registered

_LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "mcap",
    "rosbags",
    "filterpy",
    "kiss-icp",
    "open3d",
    "rerun-sdk",
    "laspy",
    "rasterio",
)

ENTROPY_NOTE = f"half ln |2 pi e C|, C of the points within {100 * ENTROPY_RADIUS:g} cm"

OUTPUTS = {
    "trajectory.tum": "map <- base_link, at 50 Hz and at every profile",
    "cloud.laz": "accepted points with time, intensity and sigma",
    "cloud.copc.laz": "the same file, by the name under which QGIS and PDAL know that they need not read all of it",
    "moving.laz": "points that later or earlier profiles saw through: what moved or floated, not in the map",
    "seabed.tif": "elevation, uncertainty, density, standard deviation and absolute uncertainty per cell",
    "contours.gpkg": "depth contours",
    "seabed.glb": "the surface as a mesh",
    "seabed.ply": "the same for CloudCompare and MeshLab, in double precision",
    "hillshade.png": "the surface from above",
    "map.rrd": "everything in Rerun: garbi view DIR",
    "report.json": "this report, for programs",
    "report.html": "this report",
    "config.yaml": "the configuration that was used, defaults included",
    "db": "the map's database: the next dive into this folder makes the map grow",
}
SURFACE = "the surface in three dimensions, walls and overhangs included"

_TORN = 1e-3
"""m between overlapping sweeps, ten times what is usual, from which on the drift estimate counts as failed."""


def write_outputs(
    out: Path,
    home: Path,
    dive: Dive,
    store: SweepStore,
    built: Map,
    clouds: Future[None],
    started: float,
    progress: Progress,
) -> None:
    """Write everything but the clouds, which are being written beside; report.json and report.html come last.

    home: the folder to which the files will be moved.
    """
    from garbi_map.view import record_map

    settings, reference = dive.config.export, built.located.reference
    progress.stage("files", 6)
    begin = time.perf_counter()
    mesh = triangulate(built.seabed, settings.max_triangles, settings.widest_hole)
    with ThreadPoolExecutor(1) as beside:  # the recording takes longer than all the others together
        recording = beside.submit(record_map, out / "map.rrd", dive, store, built, mesh)
        write_trajectory(out / "trajectory.tum", built.path)
        write_text(out / "config.yaml", dive.config.to_yaml())
        progress.advance()
        write_seabed_tif(out / "seabed.tif", built.seabed, reference)
        write_contours(out / "contours.gpkg", built.seabed, settings, reference)
        progress.advance()
        write_glb(out / "seabed.glb", mesh, reference)
        write_ply(out / "seabed.ply", mesh, reference)
        write_hillshade(out / "hillshade.png", built.seabed, settings, dive.paths[0].stem, not reference.is_local)
        progress.advance()
        clouds.result()
        also_copc(out / "cloud.laz")
        if dive.config.seabed.solid.make:
            mount = dive.navigation.mount("rig")
            solid = surface_of(out / "cloud.laz", built.path, mount, dive.config.seabed.solid, reference)
            write_ply(out / "surface.ply", solid, reference)
        progress.advance()
        recording.result()
        progress.advance()
    dive.timings["files"] = time.perf_counter() - begin
    dive.timings["all"] = time.perf_counter() - started
    report = make_report(dive, store, built)
    write_report_json(out / "report.json", report)
    navigation = built.navigated.trajectory
    write_report_html(out / "report.html", report, built.seabed, built.registered, navigation, settings, home)
    progress.advance()


def make_report(dive: Dive, store: SweepStore, built: Map) -> Report:
    """What was read, left out and reached."""
    log, settings = dive.log, dive.config.export
    entries = store.entries
    blank = sum(entry.blank for entry in entries)
    dark = [f"{many(blank, 'image')} without the laser: it was off, hidden or out of range"] if blank else []
    left_out = [*dive.left_out, *dark, *built.navigated.report.get("notes", []), *drift_notes(built.registered)]
    return Report(
        title=dive.paths[0].stem,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        source=Source(
            paths=[str(path) for path in dive.paths],
            begin_ns=log.begin_ns,
            duration_s=(log.end_ns - log.begin_ns) * 1e-9,
            images=log.image_count,
            topics=[Topic(name=name, type=topic.type, count=topic.count) for name, topic in log.topics.items()],
        ),
        verdict=plain_verdict(built.seabed, built.registered.agreement, len(left_out)),
        weak=weak_places(built.seabed, built.registered.agreement, settings.widest_hole),
        counts={
            "images": log.image_count,
            "profiles": sum(entry.profiles for entry in entries),
            "sweeps": len(entries),
            "points": sum(entry.points for entry in entries),
            "accepted": built.accepted,
            "loop closures": built.registered.loops,
        },
        rejected=built.rejected,
        left_out=left_out,
        residuals=_residuals(built),
        uncertainties=[*describe_seabed(built.seabed), *_pose_uncertainty(built), *_calibration(built)],
        bathymetry=bathymetry(
            built.seabed,
            built.registered,
            settings.widest_hole,
            dive.navigation.pressure is not None,
            built.located.sigma,
        ),
        place=_place(built.located),
        timings_s={name: round(seconds, 3) for name, seconds in dive.timings.items()},
        timeline=timeline(dive, store),
        configuration=dive.config.model_dump(mode="json"),
        versions={"garbi": __version__, **{name: importlib.metadata.version(name) for name in _LIBRARIES}},
        outputs=OUTPUTS | ({"surface.ply": SURFACE} if dive.config.seabed.solid.make else {}),
    )


def _place(located: Located) -> Place:
    origin = located.origin
    return Place(
        crs=located.reference.wkt,
        shift=located.reference.shift,
        scale=located.reference.scale,
        convergence_deg=float(np.degrees(located.convergence)),
        origin=None if origin is None else (origin.latitude, origin.longitude),
        sigma_m=located.sigma,
        notes=located.notes,
    )


def _residuals(built: Map) -> list[Quantity]:
    registered = built.registered
    (before, after), entropy = registered.agreement.median, registered.agreement.entropy
    found = correction(built.navigated.trajectory, registered.trajectory)
    last = registered.rounds[-1][-1] if registered.rounds else None
    return [
        Quantity(name="sweep to sweep, navigation alone", value=1e3 * before, unit="mm", note="median distance"),
        Quantity(name="sweep to sweep, this map", value=1e3 * after, unit="mm", note="median distance"),
        Quantity(name="mean map entropy, navigation alone", value=entropy[0], unit="nat", note=ENTROPY_NOTE),
        Quantity(name="mean map entropy, this map", value=entropy[1], unit="nat", note="the less, the sharper"),
        Quantity(name="matches", value=float(last.matches) if last else 0.0, note="surfel pairs of the last round"),
        Quantity(
            name="drift found",
            value=found.distance,
            unit="m",
            note="rms between the navigation filter's and this trajectory",
        ),
        Quantity(name="attitude drift found", value=float(np.rad2deg(found.angle)), unit="deg", note="rms, likewise"),
        Quantity(
            name="heading against the navigation filter",
            value=float(np.rad2deg(found.heading)),
            unit="deg",
            note="one turn of the whole map, not counted as drift",
        ),
        Quantity(
            name="largest step of the pose graph", value=1e3 * float(registered.graph_step.max(initial=0.0)), unit="mm"
        ),
        *_clocks(built),
    ]


def drift_notes(registered: Registered) -> list[str]:
    """What the drift estimate found to be wrong, with the sensors or with itself, one line each."""
    clocks = [str(offset) for offset in registered.clocks if offset.notable] + (registered.rig_notes or [])
    _, apart = registered.agreement.median
    if np.isnan(apart) or apart < _TORN:
        return clocks
    torn = f"sweeps that overlap still lie {1e3 * apart:.1f} mm apart: the vehicle's motion was not found, "
    return [
        *clocks,
        torn + "and the map and its uncertainty are not to be relied on; a DVL or quicker sweeps would help",
    ]


def _clocks(built: Map) -> list[Quantity]:
    """By how much the stamps of the sensors are late, whether or not that was corrected."""
    said = {"applied": "corrected", "kept": "nothing to correct", "unseen": "cannot be told from this dive, left alone"}
    return [
        Quantity(
            name=f"{NAMES[offset.name]}, late by",
            value=None if offset.state == "unseen" else 1e3 * offset.value,
            unit="ms",
            note=f"1 sigma {1e3 * offset.sigma:.2g} ms; {said[offset.state]}",
        )
        for offset in built.registered.clocks
    ]


def _pose_uncertainty(built: Map) -> list[Quantity]:
    out = []
    for where, trajectory in (("inside the map", built.registered.inside), ("absolute", built.registered.trajectory)):
        sigma = np.median(np.sqrt(np.diagonal(trajectory.covariance, axis1=1, axis2=2)), axis=0)
        out += [
            Quantity(name=f"position {where}", value=1e3 * float(np.linalg.norm(sigma[:3])), unit="mm", note="1 sigma"),
            Quantity(name=f"attitude {where}", value=float(np.rad2deg(sigma[3:].max())), unit="deg", note="1 sigma"),
        ]
    return out


def _calibration(built: Map) -> list[Quantity]:
    """What the rig's calibration leaves open in the map."""
    doubt, known = built.doubt, built.seabed.known
    if doubt is None:
        return []
    told = (
        "by the covariance in rig.yaml"
        if doubt.told
        else "rig.yaml tells no covariance: as after a careful calibration"
    )
    return [
        Quantity(
            name=f"calibration {where}", value=1e3 * float(np.median(sigma[known])), unit="mm", note=f"1 sigma; {told}"
        )
        for where, sigma in (("inside the map", doubt.bent), ("absolute", doubt.displaced))
    ]
