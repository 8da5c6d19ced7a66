"""A log of another program, read by its topic map, written in the project's own topics and types."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path

from garbi_map.importing.write import Entry, image_entries, navigation_entries, write_log
from garbi_map.log import Log, LogWriter
from garbi_map.log.decode import BAD_MESSAGE, stamp_of
from garbi_map.log.navigation import find_mounts
from garbi_map.rig import Rig

WINDOW_NS = 300_000_000_000
"""Navigation is held in memory for this long, whatever the length of the log."""
COPIED = {"camera_info": "sensor_msgs/msg/CameraInfo", "navsat": "sensor_msgs/msg/NavSatFix"}
"""Role -> type of what is written as it was read."""


def import_log(log: Log, out: Path, rig: Rig | None = None) -> list[str]:
    """Write what the log's topic map names as a log of our own; returns what that leaves behind, one line each.

    rig: attached to the new log, and names the encoder's joint; else the log's own rig file is kept.
    Raises GarbiError where the log cannot be used or the file cannot be written.
    """
    joint = rig.laser.joint if rig else "laser_joint"
    streams = [_windows(log, joint), *(_copied(log, role, name) for role, name in COPIED.items())]
    about = {"source": log.name, "topics": log.settings.model_dump_json(include={"topics", "scale", "frames"})}
    write_log(out, streams, find_mounts(log), rig.to_yaml() if rig else log.rig_text, about)
    used = set(log.settings.topics.model_dump().values())
    left = [f"{name} ({topic.type})" for name, topic in sorted(log.topics.items()) if topic.count and name not in used]
    return [f"not taken over: {', '.join(left)}"] if left else []


def _windows(log: Log, joint: str) -> Iterator[Entry]:
    for begin in range(log.begin_ns, log.end_ns + 1, WINDOW_NS):
        end = begin + WINDOW_NS
        streams = navigation_entries(log.navigation(begin, end, joint), joint)
        yield from heapq.merge(*streams, image_entries(log.images(begin, end)), key=lambda entry: entry[0])


def _copied(log: Log, role: str, type_name: str) -> Iterator[Entry]:
    topic: str = getattr(log.settings.topics, role)
    target: str = getattr(type(log.settings.topics)(), role)
    if topic not in log.topics or log.topics[topic].type != type_name:
        return
    last = 0
    for _, message in log.messages({topic}):
        try:
            stamp = stamp_of(message.data)
        except BAD_MESSAGE:
            log.lose(f"{topic}: some messages are not readable")
            continue
        if stamp < last:
            continue
        last, arrival, data = stamp, message.arrival(stamp), bytes(message.data)

        def write(log: LogWriter, stamp: int = stamp, arrival: int = arrival, data: bytes = data) -> None:
            log.write(target, type_name, data, stamp, arrival)

        yield stamp, write
