"""A log as it was recorded, streamed into a recording: images with their stripe, the rig's view, the sensors' curves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, Log, Navigation
from garbi_map.view import style
from garbi_map.view.images import show_image
from garbi_map.view.silence import Silence, within
from garbi_map.view.stream import at, send_curves
from garbi_map.view.vehicle import draw_vehicle

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.rig import Rig
    from garbi_map.stripe import Stripe
    from garbi_map.sweep import Angle

_FIRST_WINDOW = 1.0
_WINDOW = 60.0
"""Seconds that are read at a time; the first window is short, so that there is something to look at."""
_MARGIN_NS = 1_000_000_000
_SHEET_POINTS = 24


def stream_log(
    recording: RecordingStream, log: Log, rig: Rig | None, config: Config, going_on: Callable[[], bool] = lambda: True
) -> None:
    """Send a log into a recording, window by window, in the order of time; memory does not grow with the log.

    Without a rig there is no vehicle and no profile; without an encoder no profile. Stops where `going_on` says no.
    """
    import rerun as rr

    recording.log(style.ABOUT, rr.TextDocument(about_log(log, rig), media_type="text/markdown"), static=True)
    recording.log(style.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    joint = rig.laser.joint if rig is not None else "laser_joint"
    told: set[str] = set()
    silence = Silence()
    drawn = False
    for begin_ns, end_ns in _windows(log.begin_ns, log.end_ns):
        navigation = log.navigation(begin_ns - _MARGIN_NS, end_ns + _MARGIN_NS, joint)
        if rig is not None and not drawn:
            draw_vehicle(recording, rig, navigation.mount("rig"))
            _dress(recording)
            drawn = True
        _sensors(recording, navigation, begin_ns, end_ns, config)
        for _ in _stripes(recording, log, rig, navigation, config, (begin_ns, end_ns), silence):
            if not going_on():
                return
        for stamp_ns, line in silence.gaps(navigation, begin_ns, end_ns):
            _tell(recording, stamp_ns, line)
        for line in log.losses:
            if line not in told:
                told.add(line)
                _tell(recording, begin_ns, line)
        recording.flush()
    for stamp_ns, line in silence.ends(log.end_ns):
        _tell(recording, stamp_ns, line)
    if not told and not silence.found:
        _tell(recording, log.begin_ns, "no gaps, no damage", level="INFO")


def about_log(log: Log, rig: Rig | None) -> str:
    """Markdown: what the screen shows and what is in the log."""
    seconds = (log.end_ns - log.begin_ns) * 1e-9
    shown = (style.STRIPE, style.PROFILE, style.SHEET)
    legend = "\n".join(f"- **{thing.name}**: {thing.meaning}" for thing in shown)
    topics = "\n".join(f"| `{name}` | {topic.count} | {topic.type} |" for name, topic in sorted(log.topics.items()))
    rig_line = "" if rig is not None else "\n\n**No rig file**: no vehicle and no profiles; give one with `--rig`."
    return f"""# A recorded dive, as it is

{seconds:.0f} s, {log.image_count} images, {log.size / 1e6:.0f} MB. Nothing is corrected here: the picture is what the camera
saw, the 3-D view is what the laser means from the vehicle's own place. `garbi map` makes the map of it.{rig_line}

{legend}

| topic | messages | type |
| --- | --- | --- |
{topics}
"""


def _windows(begin_ns: int, end_ns: int) -> Iterator[tuple[int, int]]:
    start, length = begin_ns, int(_FIRST_WINDOW * 1e9)
    while start <= end_ns:
        yield start, start + length
        start, length = start + length, int(_WINDOW * 1e9)


def _dress(recording: RecordingStream) -> None:
    import rerun as rr

    recording.log(style.PROFILE.path, rr.Points3D.from_fields(radii=0.004, colors=[style.LASER]), static=True)
    recording.log(style.STRIPE.path, rr.Points2D.from_fields(radii=-1.0, colors=[style.STRIPE.colour]), static=True)


def _tell(recording: RecordingStream, stamp_ns: int, line: str, level: str = "WARN") -> None:
    import rerun as rr

    recording.set_time(style.TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
    recording.log(style.LOSSES, rr.TextLog(line, level=level))


def _sensors(recording: RecordingStream, navigation: Navigation, begin_ns: int, end_ns: int, config: Config) -> None:
    import rerun as rr

    axes = (style.X_AXIS, style.Y_AXIS, style.Z_AXIS)
    if navigation.encoder is not None:
        own = within(navigation.encoder.stamp_ns, begin_ns, end_ns)
        angle = np.rad2deg(navigation.encoder.angle[own])
        send_curves(recording, style.ENCODER, navigation.encoder.stamp_ns[own], [("laser angle", style.LASER, angle)])
    if navigation.imu is not None:
        own = within(navigation.imu.stamp_ns, begin_ns, end_ns)
        known = np.isfinite(navigation.imu.attitude[own]).all(axis=1)
        stamps = navigation.imu.stamp_ns[own][known]
        if len(stamps):
            mount = Rotation.from_quat(navigation.mount("imu_link").quaternion)
            attitude = Rotation.from_quat(navigation.imu.attitude[own][known]) * mount.inv()
            yaw, pitch, roll = attitude.as_euler("ZYX", degrees=True).T
            curves = list(zip(("roll", "pitch", "yaw"), axes, (roll, pitch, yaw), strict=True))
            send_curves(recording, style.ATTITUDE, stamps, curves)
            rows = rr.Transform3D.columns(quaternion=attitude.as_quat().astype(np.float32))
            recording.send_columns(style.VEHICLE, at(stamps), rows)
    if navigation.pressure is not None:
        own = within(navigation.pressure.stamp_ns, begin_ns, end_ns)
        water = config.navigate
        depth = (navigation.pressure.pressure[own] - water.atmosphere) / (water.water_density * water.gravity)
        send_curves(recording, style.DEPTH, navigation.pressure.stamp_ns[own], [("depth", style.Z_AXIS, depth)])
    if navigation.dvl is not None:
        own = within(navigation.dvl.stamp_ns, begin_ns, end_ns)
        velocity = Rotation.from_quat(navigation.mount("dvl_link").quaternion).apply(navigation.dvl.velocity[own])
        curves = list(zip(("forward", "left", "up"), axes, velocity.T, strict=True))
        send_curves(recording, style.VELOCITY, navigation.dvl.stamp_ns[own], curves)


def _stripes(
    recording: RecordingStream,
    log: Log,
    rig: Rig | None,
    navigation: Navigation,
    config: Config,
    span_ns: tuple[int, int],
    silence: Silence,
) -> Iterator[int]:
    """Draw images, stripes and profiles of a window; yields the stamp of each, so that the caller may stop."""
    from garbi_map.stripe import StripeDetector, detect_all

    def images() -> Iterator[Image]:
        for image in log.images(*span_ns):
            silence.image(image.stamp_ns)
            if (silence.images - 1) % config.view.every:
                continue
            if config.view.images:
                show_image(recording, image)
            yield image

    angle = _angle(rig, navigation, config)
    detector = StripeDetector(config.stripe, rig)
    strength: list[tuple[int, float, float]] = []
    for stripe in detect_all(images(), detector, None if angle is None else angle.alpha):
        _draw(recording, stripe, rig, angle, config)
        peak = float(np.median(stripe.intensity)) if len(stripe.row) else 0.0
        strength.append((stripe.stamp_ns, float(len(stripe.row)), peak))
        yield stripe.stamp_ns
    if strength:
        stamps, rows, peaks = (np.array(column) for column in zip(*strength, strict=True))
        curves = [("rows found", style.LASER, rows), ("strength, 0..255", style.OURS, peaks)]
        send_curves(recording, style.STRIPE_ROWS, stamps, curves)


def _angle(rig: Rig | None, navigation: Navigation, config: Config) -> Angle | None:
    """The laser's angle where rig and log tell it."""
    from garbi_map.sweep import laser_angle

    try:
        return None if rig is None else laser_angle(navigation.encoder, rig, config.sweep)
    except GarbiError:
        return None


def _draw(recording: RecordingStream, stripe: Stripe, rig: Rig | None, angle: Angle | None, config: Config) -> None:
    import rerun as rr

    recording.set_time(style.TIMELINE, timestamp=np.datetime64(stripe.stamp_ns, "ns"))
    pixels = np.stack([stripe.u + 0.5, stripe.row + 0.5], axis=1).astype(np.float32)
    recording.log(style.STRIPE.path, rr.Points2D.from_fields(positions=pixels))
    alpha = float("nan") if angle is None else angle.alpha(stripe.stamp_ns)
    if rig is None or np.isnan(alpha):
        return
    points = rig.triangulate(stripe.u, stripe.row, alpha).points
    depth = rig.depth(points)
    seen = points[(depth >= config.sweep.min_range) & (depth <= config.sweep.max_range)].astype(np.float32)
    recording.log(style.PROFILE.path, rr.Points3D.from_fields(positions=seen))
    if len(seen) < 2:
        recording.log(style.SHEET.path, rr.Clear(recursive=False))
        return
    edge = seen[np.linspace(0, len(seen) - 1, _SHEET_POINTS).astype(int)]
    corner = np.arange(1, _SHEET_POINTS, dtype=np.uint32)
    recording.log(
        style.SHEET.path,
        rr.Mesh3D(
            vertex_positions=np.vstack([rig.laser.apex.astype(np.float32), edge]),
            triangle_indices=np.stack([np.zeros_like(corner), corner, corner + 1], axis=1),
            albedo_factor=(*style.LASER, 45),
        ),
    )
