"""A Rerun recording with one timeline, and how things are sent into it in bulk."""

from __future__ import annotations

import os
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from garbi_map.aside import written_aside
from garbi_map.errors import GarbiError
from garbi_map.view.style import APPLICATION, TIMELINE, Plot

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

    from garbi_map.view.viewer import Viewer

STALLED = 5.0  # s without a byte after which the file system is taken to refuse
_PATIENCE = 0.5  # s between looks whether the viewer is still there


def new_recording(kind: str, name: str) -> RecordingStream:
    """A recording that nobody listens to yet; stamps are its only time.

    kind: what it is of, "map" or the like. Viewers keep one layout for an application: each kind and name is one, or what is
    looked at next would look like the last.
    """
    os.environ.setdefault("RERUN_ANALYTICS", "0")
    os.environ.setdefault("RUST_LOG", "off")  # what goes wrong is told in our words
    import rerun as rr

    recording = rr.RecordingStream(f"{APPLICATION} {kind} {name}", recording_id=uuid.uuid4())
    recording.set_log_tick_enabled(False)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    return recording


class _NoPandas:
    """A finder of modules that says that there is no pandas."""

    def find_spec(self, name: str, *_: Any) -> None:
        """None for everything else: let others look."""
        if name == "pandas":
            raise ModuleNotFoundError(name)


def spare_pandas() -> None:
    """Arrow does without pandas in this process.

    At the first array it looks whether pandas is installed, and imports it: a quarter of the time to the first picture.
    """
    import pyarrow as pa

    absent = _NoPandas()
    sys.meta_path.insert(0, absent)
    try:
        pa.array(np.zeros(1))
    finally:
        sys.meta_path.remove(absent)


@contextmanager
def recording_file(path: Path, kind: str, name: str, blueprint: Blueprint) -> Iterator[RecordingStream]:
    """A recording into a file, complete or absent. Raises GarbiError where the file system refuses."""
    with written_aside(path) as aside:
        aside.touch()
        recording = new_recording(kind, name)
        recording.save(aside, default_blueprint=blueprint)
        try:
            yield recording
        finally:
            try:
                _finish(recording, aside)
            except RuntimeError as error:
                abandon(recording)
                raise GarbiError(f"{path}: cannot be written: is the disk full? ({error})") from error
            recording.disconnect()


@contextmanager
def recording_for(
    opened: Viewer, kind: str, name: str, blueprint: Blueprint | None = None
) -> Iterator[RecordingStream]:
    """A recording into a viewer; whatever it has not taken when the viewer goes is dropped."""
    recording = new_recording(kind, name)
    if opened.started():
        recording.connect_grpc(opened.proxy, default_blueprint=blueprint)
    try:
        yield recording
    finally:
        if taken(recording, opened):
            recording.disconnect()  # before the viewer goes, or it complains
        else:
            abandon(recording)


def taken(recording: RecordingStream, opened: Viewer) -> bool:
    """Wait until a viewer has all that was sent; False as soon as it has gone."""
    while opened.open:
        try:
            recording.flush(timeout_sec=_PATIENCE)
            return True
        except RuntimeError:  # it is slow to start, or to draw
            continue
    return False


def abandon(recording: RecordingStream) -> None:
    """Leave a recording alone to which nobody listens any more: disconnecting, forgetting and shutting it down all hang."""
    import atexit
    import ctypes

    import rerun as rr

    ctypes.pythonapi.Py_IncRef(ctypes.py_object(recording))  # never freed
    atexit.unregister(rr.rerun_shutdown)


def _finish(recording: RecordingStream, file: Path) -> None:
    """Wait for Rerun's writing thread as long as the file grows.

    Where the disk refuses, that thread ends with a message of its own, and a flush without a time limit waits for ever.
    Raises RuntimeError.
    """
    size = -1
    while True:
        try:
            return recording.flush(timeout_sec=STALLED)
        except RuntimeError:
            grown = file.stat().st_size
            if grown == size:
                raise
            size = grown


def at(stamp_ns: ArrayLike) -> list[Any]:
    """The time column of rows at stamps (n,) int64 ns."""
    import rerun as rr

    return [rr.TimeColumn(TIMELINE, timestamp=np.asarray(stamp_ns, np.int64).astype("datetime64[ns]"))]


def set_time(recording: RecordingStream, stamp_ns: int) -> None:
    """What is logged from now on happened then."""
    recording.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))


def name_curves(recording: RecordingStream, plot: Plot) -> None:
    """Names and colours of a plot's curves."""
    import rerun as rr

    names, colours = zip(*plot.curves, strict=True)
    lines = rr.SeriesLines(names=list(names), colors=[list(colour) for colour in colours], widths=[1.5] * len(names))
    recording.log(plot.path, lines, static=True)


def send_curves(recording: RecordingStream, plot: Plot, stamp_ns: NDArray[np.int64], values: ArrayLike) -> None:
    """The values (n,) or (n, curves) of a plot at stamps (n,)."""
    import rerun as rr

    table = np.asarray(values, np.float64).reshape(len(stamp_ns), len(plot.curves))
    if len(table):
        rows = rr.Scalars.columns(scalars=table.ravel()).partition([table.shape[1]] * len(table))
        recording.send_columns(plot.path, at(stamp_ns), rows)
