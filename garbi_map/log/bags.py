"""ROS 1 bags and rosbag2 databases, read through rosbags as if they were our own logs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Schema

from garbi_map.errors import GarbiError
from garbi_map.log.chunks import RawMessage
from garbi_map.log.decode import BAD_MESSAGE
from garbi_map.log.reader import Log, Stamped, Topic, with_stamps
from garbi_map.log.records import Stamps
from garbi_map.log.settings import LogSettings
from garbi_map.log.types import standard_types

ROS1_MAGIC, SQLITE_MAGIC = b"#ROSBAG V", b"SQLite format 3\0"
EDGE_NS = 5_000_000_000  # of the log's begin and end, in which its first and last stamps are looked for
MOST = 5000  # messages looked at there


def is_ros1(path: Path) -> bool:
    """Whether a file is a ROS 1 bag."""
    return _start(path).startswith(ROS1_MAGIC)


def is_database(path: Path) -> bool:
    """Whether a file is a rosbag2 database."""
    return _start(path) == SQLITE_MAGIC


def _start(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(len(SQLITE_MAGIC))
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error


class Bag(Log):
    """A ROS 1 bag, a rosbag2 database, or a rosbag2 directory of databases. It carries no rig file, and its messages
    have one time besides their stamps: that of the recording. Raises GarbiError where it cannot be read."""

    def __init__(self, path: Path, settings: LogSettings) -> None:
        self.path = path
        self._ros1 = path.is_file() and is_ros1(path)
        with self._sound():
            self._reader = self._open()
            if not any(connection.msgcount for connection in self._reader.connections):
                raise GarbiError(f"{path}: the log holds no message")
        super().__init__([], settings)

    def _open(self) -> Any:
        from rosbags import rosbag1, rosbag2

        reader = rosbag1.Reader(self.path) if self._ros1 else rosbag2.Reader(self.path)
        reader.open()
        return reader

    @contextmanager
    def _sound(self) -> Iterator[None]:
        """What rosbags makes of a damaged file is an error of any kind."""
        try:
            yield
        except GarbiError:
            raise
        except Exception as error:
            why = " ".join(str(error).split())[:120] or type(error).__name__
            raise GarbiError(f"{self.path}: cannot be read as a ROS bag: {why}") from error

    @property
    def name(self) -> str:
        """The name of the file or directory."""
        return self.path.name

    @property
    def size(self) -> int:
        """Bytes of all files."""
        files = self.path.iterdir() if self.path.is_dir() else [self.path]
        return sum(file.stat().st_size for file in files)

    def messages(
        self, topics: set[str], begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[str, RawMessage]]:
        """See Log.messages. Where the bag ends in damage, the rest of it is lost and named."""
        margin = int(self.settings.clock_tolerance * 1e9)
        begin, end = (None if edge is None else edge - self._clock_offset for edge in (begin_ns, end_ns))
        return self.recorded(
            topics, None if begin is None else max(begin - margin, 0), None if end is None else end + margin
        )

    def recorded(self, topics: set[str], first: int | None, last: int | None) -> Iterator[tuple[str, RawMessage]]:
        """See Log.recorded."""
        types = standard_types()
        connections = [one for one in self._reader.connections if one.topic in topics]
        at = first
        try:
            for connection, at, data in self._reader.messages(connections, first, last) if connections else ():
                if self._ros1:
                    try:
                        data = types.ros1_to_cdr(data, connection.msgtype)
                    except BAD_MESSAGE:
                        self.lose(f"{connection.topic}: some messages are not readable as {connection.msgtype}")
                        continue
                yield connection.topic, RawMessage(connection.id, 0, at, at, memoryview(data))
        except GarbiError:
            raise
        except Exception as error:
            after = max((at or 0) - self.recorded_span()[0], 0) * 1e-9
            self.lose(f"{self.path.name}: damaged after {after:.1f} s ({type(error).__name__}), the rest is lost")

    def verify(self) -> bool:
        """Read every message; there are no checksums."""
        for _ in self.messages(set(self.topics)):
            pass
        return False

    def schemas(self) -> list[Schema]:
        """The message definitions, where the bag carries them as ROS 2 does."""
        if self._ros1:
            return []
        return [
            Schema(id=number + 1, name=one.msgtype, encoding="ros2msg", data=one.msgdef.data.encode())
            for number, one in enumerate(self._reader.connections)
        ]

    def log_times(self) -> dict[str, Stamps]:
        """Log times of every message by topic, ascending; of a database by reading it, which takes long for a long one."""
        times: dict[str, list[int]] = {}
        if self._ros1:
            for one in self._reader.connections:
                times.setdefault(one.topic, []).extend(entry.time for entry in self._reader.indexes[one.id])
            return {topic: np.sort(np.array(found, np.int64)) for topic, found in times.items() if found}
        for topic, message in self.messages(set(self.topics)):
            times.setdefault(topic, []).append(message.log_time)
        return {topic: np.sort(np.array(found, np.int64)) for topic, found in times.items()}

    def _find_topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for one in self._reader.connections:
            known = topics.get(one.topic)
            topics[one.topic] = Topic(one.msgtype, one.msgcount + (known.count if known else 0))
        return topics

    def _find_rig(self) -> str | None:
        return None

    def recorded_span(self) -> tuple[int, int]:
        """First and last log time."""
        return int(self._reader.start_time), int(self._reader.end_time)

    def _first_and_last(self, topics: set[str]) -> tuple[Stamped, Stamped]:
        begin, end = self.recorded_span()
        first = islice(self.recorded(topics, None, begin + EDGE_NS), MOST)
        return (
            with_stamps(message for _, message in first),
            with_stamps(message for _, message in self.recorded(topics, max(end - EDGE_NS, 0), None)),
        )
