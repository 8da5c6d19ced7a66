"""What stands at the begin and at the end of every file of a recording, and the recorder's own word once a second."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from garbi_map.log import LogWriter
from garbi_map.record.settings import RecordSettings
from garbi_map.record.status import SourceStatus, Status
from garbi_map.rig import Rig

DIAGNOSTICS = "/diagnostics"
OK, WARN, ERROR = 0, 1, 2


def begin_file(
    log: LogWriter,
    now_ns: int,
    settings: RecordSettings,
    sources: dict[str, str],
    rig: Rig | None,
    rig_text: str | None,
    metadata: dict[str, dict[str, str]],
) -> None:
    """Mounts, rig and how it is recorded: each file is complete by itself. sources: name -> what the user called it."""
    if settings.mounts:
        log.write_mounts(now_ns, {frame: pose.mount() for frame, pose in settings.mounts.items()})
    if rig is not None and rig_text is not None:
        log.attach("rig.yaml", "application/yaml", rig_text.encode(), now_ns)
        camera = rig.camera
        matrix = np.array([[camera.alpha_u, 0, camera.u0], [0, camera.alpha_v, camera.v0], [0, 0, 1]])
        log.write_camera_info(
            now_ns, camera.width, camera.height, matrix, list(camera.distortion), frame=camera.frame_id
        )
    log.write_metadata("garbi.record", {"version": _version(), "settings": settings.model_dump_json(), **sources})
    for name, record in metadata.items():
        log.write_metadata(name, record)
    write_diagnostics(log, now_ns, [("recorder", OK, "recording begins", {})])


def end_file(log: LogWriter, clocks: dict[str, str], faults: list[str]) -> None:
    """How the stamps came about, and what went wrong."""
    log.write_metadata("garbi.clocks", clocks)
    log.write_metadata("garbi.faults", {"json": json.dumps(faults)})


def write_status(log: LogWriter, now_ns: int, status: Status, clocks: dict[str, str]) -> None:
    """The state of the recording as a diagnostic message; the clocks too, as a log that is cut off has no end."""
    parts = [_source(source, clocks) for source in status.sources]
    figures = {
        "waiting_bytes": str(status.waiting_bytes),
        "written_bytes": str(status.written_bytes),
        "free_bytes": str(status.free_bytes),
    }
    parts.append(
        ("disk", WARN if status.stalled > 1.0 else OK, f"{status.written_bytes / 1e6:.1f} MB written", figures)
    )
    write_diagnostics(log, now_ns, parts)


def _source(source: SourceStatus, clocks: dict[str, str]) -> tuple[str, int, str, dict[str, str]]:
    values = {"rate": f"{source.rate:.2f}", "count": str(source.count), "dropped": str(source.dropped)}
    if source.name in clocks:
        values["clock"] = clocks[source.name]
    level = ERROR if source.trouble else WARN if source.dropped else OK
    return source.name, level, source.trouble or f"{source.rate:.1f} Hz", values


def write_diagnostics(log: LogWriter, now_ns: int, parts: list[tuple[str, int, str, dict[str, str]]]) -> None:
    """name, level, words, figures of each part."""
    make: dict[str, Any] = log.types.types
    statuses = [
        make["diagnostic_msgs/msg/DiagnosticStatus"](
            level=level,
            name=f"garbi record: {name}",
            message=words,
            hardware_id="",
            values=[make["diagnostic_msgs/msg/KeyValue"](key=key, value=value) for key, value in values.items()],
        )
        for name, level, words, values in parts
    ]
    message = make["diagnostic_msgs/msg/DiagnosticArray"](header=log.header(now_ns, ""), status=statuses)
    log.write(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", message, now_ns)


def _version() -> str:
    try:
        return version("garbi")
    except PackageNotFoundError:
        return "unknown"
