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
from garbi_map.view.images import send_image, send_stripes, style_stripe
from garbi_map.view.silence import Silence, within
from garbi_map.view.stream import at, name_curves, send_curves, set_time
from garbi_map.view.vehicle import draw_profiles, draw_vehicle

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.rig import Rig
    from garbi_map.stripe import Stripe
    from garbi_map.sweep import Angle

_FIRST_WINDOW = 1.0
_WINDOW = 60.0
"""Seconds that are read at a time; the first window is short, so that there is something to look at."""
_MARGIN_NS = 1_000_000_000
_BATCH = 25
"""Stripes that are sent at once."""


def stream_log(
    recording: RecordingStream, log: Log, rig: Rig | None, config: Config, going_on: Callable[[], bool] = lambda: True
) -> None:
    """Send a log into a recording, window by window, in the order of time; memory does not grow with the log.

    Without a rig there is no vehicle and no profile, without a laser angle no profile. `going_on` says when to stop.
    """
    import rerun as rr

    recording.log(style.ABOUT, rr.TextDocument(about_log(log, rig), media_type="text/markdown"), static=True)
    recording.log(style.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    style_stripe(recording)
    for plot in (style.ENCODER, style.STRENGTH, style.ATTITUDE, style.VELOCITY, style.DEPTH):
        name_curves(recording, plot)
    joint = rig.laser.joint if rig is not None else "laser_joint"
    silence = Silence()
    told: set[str] = set()
    for begin_ns, end_ns in _windows(log.begin_ns, log.end_ns):
        navigation = log.navigation(begin_ns - _MARGIN_NS, end_ns + _MARGIN_NS, joint)
        if rig is not None and begin_ns == log.begin_ns:
            draw_vehicle(recording, rig, navigation.mount("rig"))
        _send_sensors(recording, navigation, begin_ns, end_ns, config)
        for _ in _send_stripes(recording, log, rig, navigation, config, (begin_ns, end_ns), silence):
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
        _tell(recording, log.begin_ns, "No gaps, no damage.", level="INFO")


def about_log(log: Log, rig: Rig | None) -> str:
    """Markdown: what the screen shows and what is in the log."""
    seconds = (log.end_ns - log.begin_ns) * 1e-9
    shown = (style.STRIPE, style.PROFILE, style.SHEET)
    legend = "\n".join(f"- **{thing.name}**: {thing.meaning}" for thing in shown)
    topics = "\n".join(f"| `{name}` | {topic.count} | {topic.type} |" for name, topic in sorted(log.topics.items()))
    without = "" if rig is not None else "**No rig file**, so no vehicle and no profiles: give one with `--rig`.\n\n"
    return f"""A recorded dive as it is, {seconds:.0f} s, {log.image_count} images, {log.size / 1e6:.0f} MB. Nothing is
corrected; `garbi map` does that.

{without}{legend}

| topic | messages | type |
| --- | --- | --- |
{topics}
"""


def _windows(begin_ns: int, end_ns: int) -> Iterator[tuple[int, int]]:
    start, length = begin_ns, round(_FIRST_WINDOW * 1e9)
    while start <= end_ns:
        yield start, start + length
        start, length = start + length, round(_WINDOW * 1e9)


def _tell(recording: RecordingStream, stamp_ns: int, line: str, level: str = "WARN") -> None:
    import rerun as rr

    set_time(recording, stamp_ns)
    recording.log(style.LOSSES, rr.TextLog(line, level=level))


def _send_sensors(
    recording: RecordingStream, navigation: Navigation, begin_ns: int, end_ns: int, config: Config
) -> None:
    import rerun as rr

    encoder, imu, pressure, dvl = navigation.encoder, navigation.imu, navigation.pressure, navigation.dvl
    if encoder is not None:
        own = within(encoder.stamp_ns, begin_ns, end_ns)
        send_curves(recording, style.ENCODER, encoder.stamp_ns[own], np.rad2deg(encoder.angle[own]))
    if imu is not None:
        own = within(imu.stamp_ns, begin_ns, end_ns)
        known = np.isfinite(imu.attitude[own]).all(axis=1)
        stamps = imu.stamp_ns[own][known]
        if len(stamps):
            mounting = Rotation.from_quat(navigation.mount("imu_link").quaternion)
            attitude = Rotation.from_quat(imu.attitude[own][known]) * mounting.inv()
            send_curves(recording, style.ATTITUDE, stamps, attitude.as_euler("ZYX", degrees=True)[:, ::-1])
            rows = rr.Transform3D.columns(quaternion=attitude.as_quat().astype(np.float32))
            recording.send_columns(style.VEHICLE, at(stamps), rows)
    if pressure is not None:
        own = within(pressure.stamp_ns, begin_ns, end_ns)
        water = config.navigate
        depth = (pressure.pressure[own] - water.atmosphere) / (water.water_density * water.gravity)
        send_curves(recording, style.DEPTH, pressure.stamp_ns[own], depth)
    if dvl is not None:
        own = within(dvl.stamp_ns, begin_ns, end_ns)
        velocity = Rotation.from_quat(navigation.mount("dvl_link").quaternion).apply(dvl.velocity[own])
        send_curves(recording, style.VELOCITY, dvl.stamp_ns[own], velocity)


def _send_stripes(
    recording: RecordingStream,
    log: Log,
    rig: Rig | None,
    navigation: Navigation,
    config: Config,
    span_ns: tuple[int, int],
    silence: Silence,
) -> Iterator[None]:
    """Images, stripes and profiles of a window, some at a time, so that the caller may stop."""
    from garbi_map.stripe import StripeDetector, detect_all

    def images() -> Iterator[Image]:
        for image in log.images(*span_ns):
            silence.image(image.stamp_ns)
            if (silence.images - 1) % config.view.every:
                continue
            if config.view.images:
                send_image(recording, image)
            yield image

    angle = _angle_of(rig, navigation, config)
    batch: list[Stripe] = []
    for stripe in detect_all(images(), StripeDetector(config.stripe, rig), None if angle is None else angle.alpha):
        batch.append(stripe)
        if len(batch) == _BATCH:
            _send_batch(recording, batch, rig, angle, config)
            batch.clear()
            yield
    if batch:
        _send_batch(recording, batch, rig, angle, config)
        yield


def _angle_of(rig: Rig | None, navigation: Navigation, config: Config) -> Angle | None:
    """The laser's angle where rig and log tell it."""
    from garbi_map.sweep import laser_angle

    try:
        return None if rig is None else laser_angle(navigation.encoder, rig, config.sweep)
    except GarbiError:
        return None


def _send_batch(
    recording: RecordingStream, batch: list[Stripe], rig: Rig | None, angle: Angle | None, config: Config
) -> None:
    stamps = np.array([stripe.stamp_ns for stripe in batch], np.int64)
    counts = np.array([len(stripe.row) for stripe in batch], np.int64)
    u, v = (np.concatenate([getattr(stripe, name) for stripe in batch]) for name in ("u", "row"))
    send_stripes(recording, stamps, np.stack([u, v], axis=1), counts)
    strength = [float(np.median(stripe.intensity)) if len(stripe.row) else 0.0 for stripe in batch]
    rows = np.array(
        [rig.camera.height if rig is not None else max(int(stripe.row.max(initial=0)), 1) for stripe in batch]
    )
    send_curves(recording, style.STRENGTH, stamps, np.stack([strength, 100.0 * counts / rows], axis=1))
    if rig is None or angle is None:
        return
    which = np.repeat(np.arange(len(batch)), counts)
    points = rig.triangulate(u, v, angle.at(stamps)[0][which]).points
    depth = rig.depth(points)
    good = (depth >= config.sweep.min_range) & (depth <= config.sweep.max_range)
    draw_profiles(recording, rig.laser.apex, stamps, points[good], np.bincount(which[good], minlength=len(batch)))
