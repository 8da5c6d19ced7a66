"""A log into a viewer that runs, or into a file."""

from __future__ import annotations

from pathlib import Path

from garbi_map.config import Config, load_config
from garbi_map.log import Log, open_log
from garbi_map.rig import Rig, load_rig, parse_rig
from garbi_map.view.log_blueprint import log_blueprint
from garbi_map.view.log_view import stream_log
from garbi_map.view.stream import new_recording, recording_file
from garbi_map.view.viewer import Viewer


def watch_log(
    path: Path, viewer: Viewer, rig: Path | None, config: Path | None, every: int | None, images: bool
) -> None:
    """Stream a log into a viewer until its end, or until the viewer is closed.

    Raises GarbiError where the log cannot be read, or the viewer has nothing to draw with.
    """
    log, calibration, settings = _opened(path, rig, config, every, images)
    recording = new_recording(path.stem)
    recording.connect_grpc(viewer.url, default_blueprint=log_blueprint())
    try:
        stream_log(recording, log, calibration, settings, viewer.check)
    finally:
        recording.disconnect()


def save_log(path: Path, out: Path, rig: Path | None, config: Path | None, every: int | None, images: bool) -> None:
    """The same into a file, complete or absent. Raises GarbiError where log or file system refuse."""
    log, calibration, settings = _opened(path, rig, config, every, images)
    with recording_file(out, path.stem, log_blueprint()) as recording:
        stream_log(recording, log, calibration, settings)


def _opened(
    path: Path, rig: Path | None, config: Path | None, every: int | None, images: bool
) -> tuple[Log, Rig | None, Config]:
    settings = load_config(config)
    wanted = {"images": settings.view.images and images, "every": every or settings.view.every}
    settings = settings.model_copy(update={"view": settings.view.model_copy(update=wanted)})
    log = open_log([path], settings.log)
    if rig is not None:
        return log, load_rig(rig), settings
    if log.rig_text is None:
        return log, None, settings
    return log, parse_rig(log.rig_text, f"{path}: attachment rig.yaml"), settings
