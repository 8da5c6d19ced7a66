"""Which of the log files that were given belong together: the parts of one recording are one dive."""

from __future__ import annotations

from pathlib import Path

from garbi_map.log import Log, LogSettings, open_log

_SHARED = 1_000_000_000
"""ns that two parts of one recording may overlap while both hold images."""


def split_recordings(paths: list[Path], settings: LogSettings, gap: float) -> list[list[Path]]:
    """The paths of each recording, in the order of the first of its paths.

    A recorder splits its files without a pause, so files belong together where no more than `gap` seconds lie between them,
    they carry the same rig (or one of them none), and not two of them hold images at the same time.
    Raises GarbiError where a path is no log.
    """
    if len(paths) < 2:
        return [paths]
    logs = {path: open_log([path], settings) for path in dict.fromkeys(paths)}
    recordings: list[list[Path]] = []
    for path in sorted(logs, key=lambda path: logs[path].begin_ns):
        home = next(
            (r for r in recordings if all(_fit(logs[own], logs[path]) for own in r) and _near(r, path, logs, gap)), None
        )
        if home is None:
            recordings.append([path])
        else:
            home.append(path)
    place = {path: k for k, path in enumerate(logs)}
    return sorted((sorted(r, key=place.__getitem__) for r in recordings), key=lambda r: place[r[0]])


def _near(recording: list[Path], path: Path, logs: dict[Path, Log], gap: float) -> bool:
    return logs[path].begin_ns - max(logs[own].end_ns for own in recording) <= gap * 1e9


def _fit(one: Log, other: Log) -> bool:
    """Whether two files may be parts of one recording, as far as rig and images go."""
    if one.rig_text and other.rig_text and one.rig_text != other.rig_text:
        return False
    both = min(one.end_ns, other.end_ns) - max(one.begin_ns, other.begin_ns)
    return both <= _SHARED or not (one.image_count and other.image_count)
