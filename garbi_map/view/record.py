"""The recording of a map, map.rrd: everything on one timeline, with its layout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Image
from garbi_map.view import style
from garbi_map.view.about import about_map
from garbi_map.view.blueprint import map_blueprint
from garbi_map.view.cloud import Lookup, packed, runs, thinned
from garbi_map.view.stream import at, recording_file, send_curves
from garbi_map.view.vehicle import draw_vehicle

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.pipeline import Dive, Map
    from garbi_map.seabed import Mesh
    from garbi_map.sweep import Sweep
    from garbi_map.sweep.store import SweepStore

_PROFILES_PER_STEP = 8
"""Profiles after which the growing map gets its new points."""


def record_map(path: Path, dive: Dive, store: SweepStore, built: Map, mesh: Mesh) -> None:
    """Write map.rrd, complete or not at all. Memory holds one sweep and one image at a time.

    Raises GarbiError where the file system refuses.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    blueprint = map_blueprint((low + high) / 2, float(np.linalg.norm(high - low)))
    with recording_file(path, dive.paths[0].stem, blueprint) as recording:
        import rerun as rr

        recording.log(style.ABOUT, rr.TextDocument(about_map(dive, built), media_type="text/markdown"), static=True)
        recording.log(style.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        draw_vehicle(recording, dive.rig, dive.navigation.mount("rig"))
        _trajectories(recording, dive, built)
        _curves(recording, dive, built)
        _mesh(recording, mesh, built)
        shown = _images(recording, dive)
        _sweeps(recording, dive, store, built, shown)
        _losses(recording, dive)


def _trajectories(recording: RecordingStream, dive: Dive, built: Map) -> None:
    import rerun as rr

    ours, navigation = built.registered.trajectory, built.navigated.trajectory
    rows = rr.Transform3D.columns(
        translation=ours.position.astype(np.float32), quaternion=ours.quaternion.astype(np.float32)
    )
    recording.send_columns(style.VEHICLE, at(ours.stamp_ns), rows)
    for thing, line, radius in ((style.ROUTE, ours, 0.006), (style.ROUTE_NAVIGATION, navigation, 0.004)):
        points = line.position[thinned(len(line.position), 20_000)].astype(np.float32)
        recording.log(thing.path, rr.LineStrips3D([points], radii=radius, colors=[thing.colour]), static=True)
    period = dive.config.view.ellipsoid_period
    count = max(int((ours.stamp_ns[-1] - ours.stamp_ns[0]) * 1e-9 / period), 1) + 1
    there = ours.at(np.linspace(ours.stamp_ns[0], ours.stamp_ns[-1], count).astype(np.int64))
    variance, axes = np.linalg.eigh(there.covariance[:, :3, :3])
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    recording.log(
        style.POSE_SIGMA.path,
        rr.Ellipsoids3D(
            centers=there.position,
            half_sizes=style.SIGMA_SCALE * np.sqrt(np.maximum(variance, 0.0)),
            quaternions=Rotation.from_matrix(axes).as_quat(),
            colors=[style.POSE_SIGMA.colour] * count,
            line_radii=0.0015,
        ),
        static=True,
    )


def _curves(recording: RecordingStream, dive: Dive, built: Map) -> None:
    ours = built.registered.trajectory
    navigation = built.navigated.trajectory.at(ours.stamp_ns)
    off = 1e3 * (ours.position - navigation.position)
    turn = np.rad2deg((ours.rotation * navigation.rotation.inv()).as_rotvec())
    axes = (style.X_AXIS, style.Y_AXIS, style.Z_AXIS)
    position = list(zip(("x, mm", "y, mm", "z, mm"), axes, off.T, strict=True))
    attitude = list(zip(("roll, deg", "pitch, deg", "yaw, deg"), axes, turn.T, strict=True))
    send_curves(recording, style.DRIFT_POSITION, ours.stamp_ns, position)
    send_curves(recording, style.DRIFT_ATTITUDE, ours.stamp_ns, attitude)
    send_curves(recording, style.DEPTH, ours.stamp_ns, [("depth, m", style.Z_AXIS, -ours.position[:, 2])])
    speed = np.linalg.norm(built.navigated.velocity, axis=1)
    send_curves(recording, style.SPEED, built.navigated.trajectory.stamp_ns, [("speed, m/s", style.OURS, speed)])
    encoder = dive.navigation.encoder
    if encoder is not None and len(encoder.angle):
        angle = np.rad2deg(encoder.angle)
        send_curves(recording, style.ENCODER, encoder.stamp_ns, [("laser angle, deg", style.LASER, angle)])


def _mesh(recording: RecordingStream, mesh: Mesh, built: Map) -> None:
    import rerun as rr

    from garbi_map.export.palette import depth_colours

    lookup = Lookup.of(built.seabed)
    recording.log(
        style.MESH.path,
        rr.Mesh3D(
            vertex_positions=mesh.vertices.astype(np.float32),
            triangle_indices=mesh.triangles.astype(np.uint32),
            vertex_colors=packed(depth_colours(mesh.vertices[:, 2], *lookup.depths)),
        ),
        static=True,
    )


def _images(recording: RecordingStream, dive: Dive) -> NDArray[np.int64] | None:
    """The stamps of the images that are shown; None where the recording shall have no images."""
    import rerun as rr

    settings = dive.config.view
    if not settings.images:
        return None
    stamps = []
    for number, image in enumerate(dive.log.images(*dive.span_ns)):
        if number % settings.every:
            continue
        stamps.append(image.stamp_ns)
        recording.set_time(style.TIMELINE, timestamp=np.datetime64(image.stamp_ns, "ns"))
        recording.log(style.IMAGE, _shown(image))
    recording.reset_time()
    if stamps:
        recording.log(style.IMAGE, rr.EncodedImage.from_fields(draw_order=-10.0), static=True)
    return np.array(stamps, np.int64)


def _shown(image: Image) -> object:
    """A compressed image as it was recorded, a raw one decoded."""
    import rerun as rr

    if image.encoding in ("jpeg", "png"):
        return rr.EncodedImage(contents=bytes(image.data), media_type=f"image/{image.encoding}")
    from garbi_map.stripe.decode import decode

    pixels = decode(image)
    return rr.Image(pixels, color_model="L" if pixels.ndim == 2 else "BGR")


def _sweeps(
    recording: RecordingStream, dive: Dive, store: SweepStore, built: Map, shown: NDArray[np.int64] | None
) -> None:
    import rerun as rr

    lookup = Lookup.of(built.seabed)
    mount = dive.navigation.mount("rig")
    settings = dive.config.view
    for thing in style.COLOURINGS:
        recording.log(thing.path, rr.Points3D.from_fields(radii=0.004), static=True)
    recording.log(style.PROFILE.path, rr.Points3D.from_fields(radii=0.006, colors=[style.LASER]), static=True)
    recording.log(style.STRIPE.path, rr.Points2D.from_fields(radii=1.5, colors=[style.LASER]), static=True)
    misfit: list[tuple[int, float, float]] = []
    for sweep in store:
        _profiles(recording, dive, sweep, shown)
        chosen = thinned(len(sweep.points), 2 * settings.points_per_sweep)
        profile, own = sweep.profile[chosen], sweep.points[chosen]
        poses = built.registered.trajectory.at(sweep.stamp_ns).mounted(mount)
        points = poses.rotation[profile].apply(own) + poses.position[profile]
        good = np.flatnonzero(lookup.on_surface(points, settings.outlier_band))
        if len(good) == 0:
            continue
        before = built.navigated.trajectory.at(sweep.stamp_ns).mounted(mount)
        raw = before.rotation[profile[good]].apply(own[good]) + before.position[profile[good]]
        misfit.append((int(sweep.stamp_ns[-1]), _typical(lookup.beside(points[good])), _typical(lookup.beside(raw))))
        keep = good[thinned(len(good), settings.points_per_sweep)]
        first, lengths = runs(profile[keep] // _PROFILES_PER_STEP)
        stamps = at(sweep.stamp_ns[profile[keep][np.r_[first[1:], len(keep)] - 1]])
        positions = points[keep].astype(np.float32)
        colours = lookup.colours(points[keep], sweep.intensity[chosen][keep], sweep.index)
        for thing in style.COLOURINGS:
            rows = rr.Points3D.columns(positions=positions, colors=colours[thing.path]).partition(lengths)
            recording.send_columns(thing.path, stamps, rows)
    if misfit:
        stamp, ours, navigation = (np.array(column) for column in zip(*misfit, strict=True))
        send_curves(
            recording,
            style.MISFIT,
            stamp,
            [("this map, mm", style.OURS, 1e3 * ours), ("navigation alone, mm", style.NAVIGATION, 1e3 * navigation)],
        )
    distance = [1e3 * found.distance for found in built.registered.rounds[-1]] if built.registered.rounds else []
    if distance:
        recording.log(style.ROUNDS, rr.BarChart(distance, color=style.OURS), static=True)


def _profiles(recording: RecordingStream, dive: Dive, sweep: Sweep, shown: NDArray[np.int64] | None) -> None:
    """Profile and stripe of every image that is shown."""
    import rerun as rr

    used = np.ones(len(sweep.stamp_ns), bool)
    if shown is not None:
        used = np.isin(sweep.stamp_ns, shown)
    keep = np.flatnonzero(used[sweep.profile])
    keep = keep[thinned(len(keep), 96 * int(used.sum()))]
    if len(keep) == 0:
        return
    own = sweep.points[keep]
    first, lengths = runs(sweep.profile[keep])
    stamps = at(sweep.stamp_ns[sweep.profile[keep][first]])
    rows = rr.Points3D.columns(positions=own.astype(np.float32)).partition(lengths)
    recording.send_columns(style.PROFILE.path, stamps, rows)
    if shown is not None:
        pixels = dive.rig.project(own).astype(np.float32)
        recording.send_columns(style.STRIPE.path, stamps, rr.Points2D.columns(positions=pixels).partition(lengths))


def _typical(off: NDArray) -> float:
    """Median distance; NaN where nothing is known."""
    finite = np.abs(off[np.isfinite(off)])
    return float(np.median(finite)) if len(finite) else float("nan")


def _losses(recording: RecordingStream, dive: Dive) -> None:
    import rerun as rr

    lines = dive.left_out
    recording.set_time(style.TIMELINE, timestamp=np.datetime64(dive.log.begin_ns, "ns"))
    for line in lines or ["nothing was left out"]:
        recording.log(style.LOSSES, rr.TextLog(line, level="WARN" if lines else "INFO"))
    recording.reset_time()
