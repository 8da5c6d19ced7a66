"""A Rerun recording with one timeline, and how things are sent into it in bulk."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from garbi_map.export import written_aside
from garbi_map.view.style import APPLICATION, TIMELINE, Colour

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint


def new_recording(name: str) -> RecordingStream:
    """A recording that nobody listens to yet; only stamps are its time."""
    os.environ.setdefault("RERUN_ANALYTICS", "0")
    import uuid

    import rerun as rr

    recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
    recording.set_log_tick_enabled(False)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    return recording


@contextmanager
def recording_file(path: Path, name: str, blueprint: Blueprint) -> Iterator[RecordingStream]:
    """A recording into a file, complete or absent. Raises GarbiError where the file system refuses."""
    with written_aside(path) as aside:
        aside.touch()
        recording = new_recording(name)
        recording.save(aside, default_blueprint=blueprint)
        try:
            yield recording
        finally:
            recording.flush()
            recording.disconnect()


def at(stamp_ns: ArrayLike) -> list[Any]:
    """The time column of rows at stamps (n,) int64 ns."""
    import rerun as rr

    return [rr.TimeColumn(TIMELINE, timestamp=np.asarray(stamp_ns, np.int64).astype("datetime64[ns]"))]


def send_curves(
    recording: RecordingStream, path: str, stamp_ns: NDArray[np.int64], curves: Sequence[tuple[str, Colour, NDArray]]
) -> None:
    """Curves (name with unit, colour, values (n,)) that share their stamps (n,), in one plot."""
    import rerun as rr

    names, colours, values = zip(*curves, strict=True)
    table = np.stack(values, axis=1).astype(np.float64)
    style = rr.SeriesLines(names=list(names), colors=[list(colour) for colour in colours], widths=[1.5] * len(names))
    recording.log(path, style, static=True)
    rows = rr.Scalars.columns(scalars=table.ravel()).partition([table.shape[1]] * len(table))
    recording.send_columns(path, at(stamp_ns), rows)
