"""A log as it was recorded, streamed into a recording window by window."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.log import Log, Mount, Navigation
from garbi_map.rig import Rig
from garbi_map.view import style
from garbi_map.view.about import about_log
from garbi_map.view.images import style_stripe
from garbi_map.view.lanes import Lanes
from garbi_map.view.log_camera import CameraSender
from garbi_map.view.losses import send_losses
from garbi_map.view.silence import Silence
from garbi_map.view.stream import at, name_curves, send_curves
from garbi_map.view.vehicle import draw_vehicle

if TYPE_CHECKING:
    from rerun import RecordingStream

_FIRST_NS, _WINDOW_NS = 500_000_000, 5_000_000_000
_MARGIN_NS = 1_000_000_000
"""More of the encoder than the window: the laser's angle is smoothed."""
_MOST_WINDOWS = 10_000
_PLOTS = (style.ENCODER, style.STRENGTH, style.ATTITUDE, style.DEPTH, style.VELOCITY, style.BACKSCATTER)


def first_depth(log: Log, config: Config) -> float:
    """Depth, m, at which a log begins; 0 where it does not say."""
    pressure = log.navigation(log.begin_ns, log.begin_ns + _MARGIN_NS).pressure
    return 0.0 if pressure is None else float(_depth(pressure.pressure[:1], config)[0])


def stream_log(
    recording: RecordingStream, log: Log, rig: Rig | None, config: Config, workers: int = 2
) -> Iterator[int]:
    """Send a log; yields the stamp, ns, up to which it has been sent, so that the caller can stop. Memory: one window.

    rig: None where the log has no usable one; then there are images and curves, but neither stripe nor profile.
    """
    import rerun as rr

    recording.log(style.ABOUT, rr.TextDocument(about_log(log), media_type="text/markdown"), static=True)
    for plot in _PLOTS:
        name_curves(recording, plot)
    style_stripe(recording)
    silence, lanes = Silence(), Lanes(recording)
    known: list[str] = []
    camera = CameraSender(recording, log, rig, config, workers, silence)
    drawn, damaged, lost_until = False, 0, 0
    for begin, end in _windows(log):
        navigation = log.navigation(
            begin - _MARGIN_NS, end + _MARGIN_NS, joint=rig.laser.joint if rig else "laser_joint"
        )
        if rig is not None and not drawn:
            draw_vehicle(recording, rig, navigation.mount("rig"))
            drawn = True
        _send_navigation(recording, navigation, config, begin, end)
        camera.send(navigation, begin, end)
        for gap in silence.gaps(navigation, begin, end):
            send_losses(recording, [gap.line], gap.begin_ns)
            lanes.span(gap.sensor, style.NOTHING, gap.begin_ns, gap.end_ns)
        for first, last in log.damaged[damaged:]:
            lanes.span("log", style.DAMAGED, max(first, lost_until), last)
            lost_until = last
        damaged = len(log.damaged)
        new = [line for line in log.losses if line not in known]
        known += new
        send_losses(recording, new, begin)
        yield end
    for gap in silence.ends(log.end_ns):
        send_losses(recording, [gap.line], gap.begin_ns)
        lanes.span(gap.sensor, style.NOTHING, gap.begin_ns, gap.end_ns)
    if not lanes.any:
        lanes.span("log", style.WHOLE, log.begin_ns, log.end_ns)
    unusable = camera.losses.lines()
    for line in unusable:
        log.lose(line)
    send_losses(recording, unusable, log.end_ns)


def _windows(log: Log) -> Iterator[tuple[int, int]]:
    """Spans [begin, end) ns: a short one first, so that there is something to see, and never very many."""
    step = max(_WINDOW_NS, (log.end_ns - log.begin_ns) // _MOST_WINDOWS)
    begin, end = log.begin_ns, log.begin_ns + _FIRST_NS
    while begin <= log.end_ns:
        yield begin, end
        begin, end = end, end + step


def _send_navigation(recording: RecordingStream, found: Navigation, config: Config, begin: int, end: int) -> None:
    def within(stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (stamps >= begin) & (stamps < end)

    if found.encoder is not None:
        now = within(found.encoder.stamp_ns)
        send_curves(recording, style.ENCODER, found.encoder.stamp_ns[now], np.rad2deg(found.encoder.angle[now]))
    if found.pressure is not None:
        now = within(found.pressure.stamp_ns)
        send_curves(recording, style.DEPTH, found.pressure.stamp_ns[now], _depth(found.pressure.pressure[now], config))
    if found.dvl is not None:
        now = within(found.dvl.stamp_ns)
        turn = Rotation.from_quat(found.mount("dvl_link").quaternion)
        send_curves(recording, style.VELOCITY, found.dvl.stamp_ns[now], turn.apply(found.dvl.velocity[now]))
    _send_pose(recording, found, config, within)


def _send_pose(recording: RecordingStream, found: Navigation, config: Config, within: Any) -> None:
    """The vehicle turns as its attitude topic says and dives as its pressure says; where it goes is not known yet."""
    import rerun as rr

    stamps, turn = np.empty(0, np.int64), np.empty((0, 4))
    if found.imu is not None:
        known = within(found.imu.stamp_ns) & np.isfinite(found.imu.attitude).all(axis=1)
        stamps, turn = found.imu.stamp_ns[known], found.imu.attitude[known]
        if len(stamps):
            mount = Rotation.from_quat(found.mount("imu_link").quaternion)
            attitude = Rotation.from_quat(turn) * mount.inv()
            turn = attitude.as_quat()
            yaw, pitch, roll = attitude.as_euler("ZYX", degrees=True).T
            send_curves(recording, style.ATTITUDE, stamps, np.stack([roll, pitch, yaw], axis=1))
    if len(stamps) == 0 and found.pressure is not None:
        stamps = found.pressure.stamp_ns[within(found.pressure.stamp_ns)]
        turn = np.tile(Mount().quaternion, (len(stamps), 1))
    if len(stamps) == 0:
        return
    place = np.zeros((len(stamps), 3), np.float32)
    if found.pressure is not None:
        reference = found.pressure.stamp_ns[0]
        place[:, 2] = -np.interp(
            stamps - reference, found.pressure.stamp_ns - reference, _depth(found.pressure.pressure, config)
        )
    rows = rr.Transform3D.columns(translation=place, quaternion=turn.astype(np.float32))
    recording.send_columns(style.VEHICLE, at(stamps), rows)


def _depth(pressure: NDArray[np.float64], config: Config) -> NDArray[np.float64]:
    """Depth (n,) m of absolute pressures (n,) Pa."""
    water = config.navigate
    return (pressure - water.atmosphere) / (water.water_density * water.gravity)
