"""What `garbi view` does: a finished map, a recording or a log, in a window, a browser or a file."""

from __future__ import annotations

from contextlib import nullcontext, suppress
from pathlib import Path

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Log, open_log
from garbi_map.rig import Rig, load_rig, parse_rig
from garbi_map.view.blueprint import log_blueprint
from garbi_map.view.log_view import first_depth, stream_log
from garbi_map.view.report_server import REPORT, report_server
from garbi_map.view.stream import new_recording, recording_file
from garbi_map.view.viewer import Viewer, check_recording, viewer

MAP_RECORDING = "map.rrd"


def recording_of(path: Path) -> Path | None:
    """The recording that is meant by a path: the file itself, or that of a finished map; None for a log.

    Raises GarbiError for a folder that is neither a finished map nor a log.
    """
    if path.is_dir() and not (path / "metadata.yaml").exists():
        if not (path / MAP_RECORDING).exists():
            raise GarbiError(f"{path}: holds no {MAP_RECORDING}: finish the map with garbi map LOG -o {path}")
        return check_recording(path / MAP_RECORDING)
    return check_recording(path) if path.suffix == ".rrd" else None


def show_recording(file: Path, web: bool, port: int) -> None:
    """Returns when the viewer is closed; in a browser the map's report is served beside it.

    Raises GarbiError where it cannot be opened.
    """
    with viewer(file, web, port) as opened:
        beside = opened.page is not None and (file.parent / REPORT).is_file()
        with report_server(file.parent, opened.page or "") if beside else nullcontext() as report:
            _announce(opened, report)
            _wait(opened)


def show_log(path: Path, config: Config, rig_path: Path | None, web: bool, port: int) -> list[str]:
    """Stream a log into a viewer; returns what could not be read when the viewer is closed."""
    log, rig, lost = _open(path, config, rig_path)
    with viewer(None, web, port) as opened:
        recording = new_recording(path.stem)
        recording.connect_grpc(opened.proxy, default_blueprint=log_blueprint(first_depth(log, config)))
        _announce(opened)
        try:
            for _ in stream_log(recording, log, rig, config):
                if not opened.open:
                    break
            _wait(opened)
        finally:
            recording.disconnect()  # before the viewer goes, or it complains
    return [*lost, *log.losses]


def save_log(path: Path, config: Config, rig_path: Path | None, out: Path) -> list[str]:
    """A log as a recording; returns what could not be read."""
    log, rig, lost = _open(path, config, rig_path)
    with recording_file(out, path.stem, log_blueprint(first_depth(log, config))) as recording:
        for _ in stream_log(recording, log, rig, config):
            pass
    return [*lost, *log.losses]


def _open(path: Path, config: Config, rig_path: Path | None) -> tuple[Log, Rig | None, list[str]]:
    """The log, its rig and why it has none: what can be shown without one is shown."""
    log = open_log([path], config.log)
    if rig_path is not None:
        return log, load_rig(rig_path), []
    if log.rig_text is None:
        return log, None, [f"{path}: no rig.yaml, so that there are no profiles; give one with --rig rig.yaml"]
    try:
        return log, parse_rig(log.rig_text, f"{path}: attachment rig.yaml"), []
    except GarbiError as error:
        return log, None, [str(error)]


def _announce(opened: Viewer, report: str | None = None) -> None:
    if opened.page:
        beside = f"or the report, which leads there: {report}\n" if report else ""
        print(f"open {opened.page}\n{beside}and end with Ctrl-C", flush=True)


def _wait(opened: Viewer) -> None:
    with suppress(KeyboardInterrupt):
        opened.process.wait()
