"""What `garbi view` does: a finished map, a recording, a log or decisions, in a window, a browser or a file.

Nothing heavy is imported before the viewer has been started, and the first image is sent before anything else is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from garbi_map.errors import GarbiError
from garbi_map.view.viewer import Viewer, check_recording, viewer

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

    from garbi_map.config import Config
    from garbi_map.log import Log, LogSettings
    from garbi_map.rig import Rig

MAP_RECORDING = "map.rrd"
CHANGE_RECORDING = "compare.rrd"
DECISIONS = "decisions"


@dataclass(frozen=True)
class Wishes:
    """What the command line asks for: configuration and rig.yaml, where given; of so many images one; no images."""

    config: Path | None = None
    rig: Path | None = None
    every: int | None = None
    no_images: bool = False

    def settings(self) -> Config:
        """The configuration. Raises GarbiError where it is not valid."""
        from garbi_map.config import load_config

        config = load_config(self.config)
        changes = {"every": self.every or config.view.every, "images": config.view.images and not self.no_images}
        return config.model_copy(update={"view": config.view.model_copy(update=changes)})

    def log_settings(self) -> LogSettings:
        """Only what opening the log needs."""
        from garbi_map.log import LogSettings

        return LogSettings() if self.config is None else self.settings().log


def recording_of(path: Path) -> Path | None:
    """The recording that is meant by a path: the file itself, or that of a finished map or comparison; None for a log.

    Raises GarbiError for what does not exist and for a folder that is neither a finished map nor a log.
    """
    if not path.exists() and path.suffix != ".rrd":
        raise GarbiError(f"{path}: no such file or directory")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        if (path / CHANGE_RECORDING).exists():
            return check_recording(path / CHANGE_RECORDING)
        if not (path / MAP_RECORDING).exists():
            raise GarbiError(f"{path}: holds no {MAP_RECORDING}: finish the map with garbi map LOG -o {path}")
        return check_recording(path / MAP_RECORDING)
    return check_recording(path) if path.suffix == ".rrd" else None


def show_recording(file: Path, web: bool, port: int) -> None:
    """Returns when the viewer is closed; in a browser the map's report is served beside it.

    Raises GarbiError where it cannot be opened.
    """
    from garbi_map.view.report_server import REPORT, report_server

    with viewer(file, web, port) as opened:
        beside = opened.page is not None and (file.parent / REPORT).is_file()
        with report_server(file.parent, opened.page or "") if beside else nullcontext() as report:
            _announce(opened, report)
            _wait(opened)


def show_log(path: Path, wishes: Wishes, web: bool, port: int) -> list[str]:
    """Stream a log or decisions into a viewer; returns what could not be read when the viewer is closed."""
    with viewer(None, web, port) as opened:
        _announce(opened)
        log = _log(path, wishes)
        from garbi_map.view.stream import recording_for, spare_pandas, taken

        spare_pandas()
        with recording_for(opened, _kind(log), path.stem) as recording:
            if not wishes.no_images:
                send_first_image(recording, log)
            if not taken(recording, opened):
                return []
            source = _source(path, log, wishes)
            recording.send_blueprint(source.layout)
            for _ in source.stream(recording):
                if not taken(recording, opened):
                    break
            _wait(opened)
    return source.left_out()


def save_log(path: Path, wishes: Wishes, out: Path) -> list[str]:
    """A log or decisions as a recording; returns what could not be read."""
    from garbi_map.view.stream import recording_file

    source = _source(path, _log(path, wishes), wishes)
    with recording_file(out, _kind(source.log), path.stem, source.layout) as recording:
        for _ in source.stream(recording):
            pass
    return source.left_out()


def send_first_image(recording: RecordingStream, log: Log) -> None:
    """The first image of a log, if it has any. Reads no more of the log than the part that holds it."""
    from garbi_map.view.images import send_image

    with suppress(GarbiError):  # a topic that is no image is named when the whole log is read
        for image in log.images():
            send_image(recording, image)
            recording.reset_time()
            return


@dataclass(frozen=True)
class _Source:
    """Something to stream: a log, or what behaviours decided on one. lost: what was amiss before reading."""

    log: Log
    config: Config
    rig: Rig | None
    lost: list[str]

    @property
    def decisions(self) -> bool:
        return _kind(self.log) == DECISIONS

    @property
    def layout(self) -> Blueprint:
        from garbi_map.view import blueprint, log_view

        if self.decisions:
            return blueprint.decision_blueprint()
        return blueprint.log_blueprint(log_view.first_depth(self.log, self.config))

    def stream(self, recording: RecordingStream) -> Iterator[int]:
        from garbi_map.view.decision_view import stream_decisions
        from garbi_map.view.log_view import stream_log

        if self.decisions:
            return stream_decisions(recording, self.log)
        return stream_log(recording, self.log, self.rig, self.config)

    def left_out(self) -> list[str]:
        return [*([] if self.decisions else self.lost), *self.log.losses]


def _kind(log: Log) -> str:
    from garbi_map.view.decisions import TOPIC

    return DECISIONS if TOPIC in log.topics else "log"


def _log(path: Path, wishes: Wishes) -> Log:
    from garbi_map.log import open_log

    return open_log([path], wishes.log_settings())


def _source(path: Path, log: Log, wishes: Wishes) -> _Source:
    """The log, its rig and why it has none: what can be shown without one is shown."""
    from garbi_map.rig import load_rig, parse_rig

    config = wishes.settings()
    if wishes.rig is not None:
        return _Source(log, config, load_rig(wishes.rig), [])
    if log.rig_text is None:
        why = f"{path}: no rig.yaml, so that there are no profiles; give one with --rig rig.yaml"
        return _Source(log, config, None, [why])
    try:
        return _Source(log, config, parse_rig(log.rig_text, f"{path}: attachment rig.yaml"), [])
    except GarbiError as error:
        return _Source(log, config, None, [str(error)])


def _announce(opened: Viewer, report: str | None = None) -> None:
    if opened.page:
        beside = f"or the report, which leads there: {report}\n" if report else ""
        print(f"open {opened.page}\n{beside}and end with Ctrl-C", flush=True)


def _wait(opened: Viewer) -> None:
    with suppress(KeyboardInterrupt):
        opened.process.wait()
