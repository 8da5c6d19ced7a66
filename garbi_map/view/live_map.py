"""A map while it is built: sweeps as they are found, then the path, then the points that are taken into the map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from garbi_map.navigate import Trajectory
from garbi_map.seabed import AcceptedPoints
from garbi_map.sweep import Sweep
from garbi_map.view import style
from garbi_map.view.stream import at, set_time
from garbi_map.view.thin import thinned

if TYPE_CHECKING:
    from rerun import RecordingStream

_POINTS = 15_000
"""Points of a sweep that are shown."""


_WORDS: dict[type, str] = {
    Sweep: "**The log is read.** Green is one sweep of the laser as seen from the vehicle: where that was is not known yet.",
    Trajectory: f"**The path is found**, as one on which all sweeps agree. {style.ROUTE.name}: {style.ROUTE.meaning}.",
    AcceptedPoints: "**The map grows**, sweep by sweep; in each of them dark blue is deep. The finished map opens here.",
}


class WorkSender:
    """Sends sweeps, the path and points of the map, and says in words what is being done."""

    def __init__(self) -> None:
        self._doing: str | None = None

    def __call__(self, recording: RecordingStream, thing: Any) -> None:
        """See `Live`."""
        import rerun as rr

        words = _WORDS.get(type(thing))
        if words != self._doing and words is not None:
            self._doing = words
            recording.log(style.ABOUT, rr.TextDocument(words, media_type="text/markdown"), static=True)
        if isinstance(thing, Sweep):
            _send_sweep(recording, thing)
        elif isinstance(thing, Trajectory):
            _send_path(recording, thing)
        elif isinstance(thing, AcceptedPoints):
            _send_points(recording, thing)


def _send_sweep(recording: RecordingStream, sweep: Sweep) -> None:
    """In the rig's frame: where the vehicle is, is not known yet."""
    import rerun as rr

    shown = sweep.points[thinned(len(sweep.points), _POINTS)].astype(np.float32)
    set_time(recording, int(sweep.stamp_ns[-1]))
    recording.log(style.PROFILE.path, rr.Points3D(shown, radii=0.003, colors=[style.PROFILE.colour]))
    recording.reset_time()


def _send_path(recording: RecordingStream, path: Trajectory) -> None:
    import rerun as rr

    line = path.position[thinned(len(path.position), _POINTS)].astype(np.float32)
    recording.log(style.ROUTE.path, rr.LineStrips3D([line], radii=0.006, colors=[style.ROUTE.colour]), static=True)
    recording.log(style.PROFILE.path, rr.Clear(recursive=False), static=True)
    rows = rr.Transform3D.columns(
        translation=path.position.astype(np.float32), quaternion=path.quaternion.astype(np.float32)
    )
    recording.send_columns(style.VEHICLE, at(path.stamp_ns), rows)


def _send_points(recording: RecordingStream, accepted: AcceptedPoints) -> None:
    """Each sweep under its own name, so that nothing replaces it."""
    import rerun as rr

    from garbi_map.export.palette import depth_colours, height_range

    if len(accepted.points) == 0:
        return
    shown = accepted.points[thinned(len(accepted.points), _POINTS)]
    colours = depth_colours(shown[:, 2], *height_range(shown[:, 2]))
    cloud = rr.Points3D(shown.astype(np.float32), radii=0.003, colors=colours)
    recording.log(f"{style.POINTS.path}/{int(accepted.stamp_ns[0])}", cloud, static=True)
