"""The recording of a map, map.rrd: everything on one timeline, with its layout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.seabed import triangulate
from garbi_map.view import style
from garbi_map.view.about import about_map
from garbi_map.view.blueprint import map_blueprint
from garbi_map.view.budget import share_out
from garbi_map.view.images import send_images
from garbi_map.view.losses import send_losses
from garbi_map.view.stream import at, name_curves, recording_file, send_curves
from garbi_map.view.surface import draw_surface
from garbi_map.view.sweeps import send_sweeps
from garbi_map.view.thin import thinned
from garbi_map.view.truth import Truth
from garbi_map.view.vehicle import draw_vehicle

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.dive import Dive, Map
    from garbi_map.seabed import Mesh
    from garbi_map.sweep.store import SweepStore

_VERTICES = 20_000
"""Most points of a drawn path."""
_SEEN = 0.06
"""m, to which the ellipsoids of the path are enlarged at most."""


def record_map(path: Path, dive: Dive, store: SweepStore, built: Map, mesh: Mesh) -> None:
    """Write map.rrd, complete or not at all; memory holds one sweep and one image at a time.

    The mesh and the points are thinned as far as ViewSettings.size_ratio asks for.
    Raises GarbiError where the file system refuses.
    """
    import rerun as rr

    settings = dive.config.view
    ours = built.registered.trajectory
    seconds = float(ours.stamp_ns[-1] - ours.stamp_ns[0]) * 1e-9
    truth = Truth.of(dive.log, ours, mesh.vertices)
    surface = truth.points if truth else None
    layout = map_blueprint(mesh.vertices, ours.position, seconds / settings.longest_film, surface)
    with recording_file(path, "map", dive.paths[0].stem, layout) as recording:
        draw_vehicle(recording, dive.rig, dive.navigation.mount("rig"))
        _draw_routes(recording, dive, built)
        _draw_loops(recording, store, built)
        larger = _draw_ellipsoids(recording, dive, built)
        words = about_map(dive, built, truth, larger)
        recording.log(style.ABOUT, rr.TextDocument(words, media_type="text/markdown"), static=True)
        _send_curves(recording, dive, built)
        shown, size = None, 0
        if settings.images:
            shown, size = send_images(recording, dive.log.images(*dive.span_ns), settings.every)
        profiles = sum(entry.profiles for entry in store.entries) // settings.every
        budget = share_out(dive.log.size, size, seconds, len(store), profiles, settings)
        triangles = budget.triangles if surface is None else budget.triangles // 2
        if len(mesh.triangles) > triangles:
            mesh = triangulate(built.seabed, triangles, dive.config.export.widest_hole)
        draw_surface(recording, mesh)
        if truth is not None:
            truth.draw(recording, mesh.vertices, triangles)
        send_sweeps(recording, dive, store, built, budget, shown)
        lost = dive.left_out
        send_losses(recording, lost or ["nothing was left out"], dive.log.begin_ns)


def _draw_routes(recording: RecordingStream, dive: Dive, built: Map) -> None:
    import rerun as rr

    ours, navigation = built.registered.trajectory, built.navigated.trajectory
    rows = rr.Transform3D.columns(
        translation=ours.position.astype(np.float32), quaternion=ours.quaternion.astype(np.float32)
    )
    recording.send_columns(style.VEHICLE, at(ours.stamp_ns), rows)
    for thing, line, radius in ((style.ROUTE, ours, 0.006), (style.ROUTE_NAVIGATION, navigation, 0.004)):
        points = line.position[thinned(len(line.position), _VERTICES)].astype(np.float32)
        recording.log(thing.path, rr.LineStrips3D([points], radii=radius, colors=[thing.colour]), static=True)


def _draw_ellipsoids(recording: RecordingStream, dive: Dive, built: Map) -> float:
    """How sure the path is, every few seconds; returns how many times larger than 1 sigma that is drawn."""
    import rerun as rr

    ours = built.registered.trajectory
    steps = np.arange(ours.stamp_ns[0], ours.stamp_ns[-1] + 1, round(dive.config.view.ellipsoid_period * 1e9))
    there = built.registered.inside.at(steps[thinned(len(steps), _VERTICES // 20)])
    variance, axes = np.linalg.eigh(there.covariance[:, :3, :3])
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # eigenvectors may be left-handed
    sigma = np.sqrt(np.maximum(variance, 0.0))
    larger = _enlarged(float(np.median(sigma.max(axis=1))))
    ellipsoids = rr.Ellipsoids3D(
        centers=there.position,
        half_sizes=larger * sigma,
        quaternions=Rotation.from_matrix(axes).as_quat(),
        colors=[style.POSE_SIGMA.colour],
        line_radii=0.0015,
    )
    recording.log(style.POSE_SIGMA.path, ellipsoids, static=True)
    return larger


def _enlarged(length: float) -> float:
    """How many times, 1, 2, 5, 10, 20 ..., a length in m is to be drawn larger, that it can be seen."""
    most = max(_SEEN / max(length, 1e-9), 1.0)
    decade = 10.0 ** np.floor(np.log10(most))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= most))


def _draw_loops(recording: RecordingStream, store: SweepStore, built: Map) -> None:
    """A line between the vehicle's places in the middle of two sweeps that were found to show the same ground."""
    import rerun as rr

    looped = [pair for pair in built.registered.looped if max(pair) < len(store.entries)]
    if not looped:
        return
    middle = np.array([(entry.begin_ns + entry.end_ns) // 2 for entry in store.entries], np.int64)
    place = built.registered.trajectory.at(middle).position
    chosen = np.array(looped)[thinned(len(looped), _VERTICES // 10)]
    lines = rr.LineStrips3D(place[chosen].astype(np.float32), radii=0.0025, colors=[style.LOOPS.colour] * len(chosen))
    recording.log(style.LOOPS.path, lines, static=True)


def _send_curves(recording: RecordingStream, dive: Dive, built: Map) -> None:
    import rerun as rr

    ours, own = built.registered.trajectory, built.navigated.trajectory
    navigation = own.at(ours.stamp_ns)
    turn = (ours.rotation * navigation.rotation.inv()).as_rotvec()  # about x, y, z of the map: roll, pitch, yaw
    for plot in (style.DRIFT_POSITION, style.DRIFT_TILT, style.DRIFT_YAW, style.DEPTH, style.SPEED, style.ENCODER):
        name_curves(recording, plot)
    send_curves(recording, style.DRIFT_POSITION, ours.stamp_ns, 1e3 * (ours.position - navigation.position))
    send_curves(recording, style.DRIFT_TILT, ours.stamp_ns, np.rad2deg(turn[:, :2]))
    send_curves(recording, style.DRIFT_YAW, ours.stamp_ns, np.rad2deg(turn[:, 2]))
    send_curves(recording, style.DEPTH, ours.stamp_ns, -ours.position[:, 2])
    send_curves(recording, style.SPEED, own.stamp_ns, np.linalg.norm(built.navigated.velocity, axis=1))
    encoder = dive.navigation.encoder
    if encoder is not None:
        send_curves(recording, style.ENCODER, encoder.stamp_ns, np.rad2deg(encoder.angle))
    rounds = built.registered.rounds
    if rounds:
        distances = [1e3 * one.distance for one in rounds[-1]]
        recording.log(style.ROUNDS, rr.BarChart(distances, color=style.OURS), static=True)
