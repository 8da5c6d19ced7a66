"""An MCAP file that is written: whole or not at all, or, for a recording, as far as it got."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Literal, Self, TypedDict

from mcap.writer import CompressionType, Writer

from garbi_map.errors import GarbiError
from garbi_map.log.types import standard_types

COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "": CompressionType.NONE}
# what ros2 bag play needs to offer a static transform to late subscribers, as rosbag2 writes it
LATCHED = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false"""


Compression = Literal["zstd", "lz4", ""]


class FileOptions(TypedDict, total=False):
    """What a McapFile can be told besides its path."""

    compression: Compression
    chunk_size: int
    in_place: bool
    open_file: Callable[[Path], BinaryIO]


class McapFile:
    """A context manager that writes one MCAP file of the `ros2` profile, in chunks with checksums.

    The file has its name only once it is complete; where the block ends with an exception, nothing is left. Every write
    takes the header stamp (it becomes log_time) and the arrival (publish_time; the stamp where it is not given), both
    ns. Write /tf_static first: viewers apply it from there on. Raises GarbiError where the file cannot be written.

    in_place: the file has its name from the beginning and stays however the block ends: a recording. What `flush` has
    brought to it is readable without the index that `close` writes.
    open_file: makes the file; a place for tests and benches to put a disk that stalls or is full.
    """

    def __init__(
        self,
        path: Path,
        compression: Compression = "zstd",
        chunk_size: int = 1 << 20,
        in_place: bool = False,
        open_file: Callable[[Path], BinaryIO] = lambda path: path.open("wb"),
    ) -> None:
        self.path = Path(path)
        self.types = standard_types()
        self._in_place = in_place
        self._aside = self.path if in_place else self.path.with_name(f".{self.path.name}.part")
        self._channels: dict[str, tuple[str, int]] = {}
        self._schemas: dict[str, int] = {}
        self._sequence: dict[int, int] = {}
        self._flushed = 0
        with self._refusals():
            self._file = open_file(self._aside)
        # the checksum of all data protects what lies outside of chunks: metadata
        self._writer = Writer(
            self._file, chunk_size=chunk_size, compression=COMPRESSION[compression], enable_data_crcs=True
        )
        self._writer.start("ros2", "garbi")

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """What the file system refuses, as one line."""
        try:
            yield
        except OSError as error:
            raise GarbiError(f"{self.path}: cannot be written: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def close(self) -> None:
        """Write the index and give the file its name."""
        with self._refusals():
            self._writer.finish()
            self._file.flush()
            self.sync()
            self._file.close()
            self._aside.replace(self.path)

    def abandon(self) -> None:
        """Close the file without an index, as after a write that failed. What was written in place is cut back to the last
        flush, any other file is removed."""
        with suppress(OSError):
            self._file.close()
        if self._in_place:
            with suppress(OSError):
                os.truncate(self._aside, self._flushed)
        else:
            self._aside.unlink(missing_ok=True)

    def flush(self) -> None:
        """Close the chunk and hand it to the operating system: what was written so far survives the end of the process,
        and with `sync` a loss of power."""
        with self._refusals():
            self._writer.flush()
            self._file.flush()
            self._flushed = self._file.tell()

    def sync(self) -> None:
        """Bring everything flushed to the disk; from any thread."""
        with self._refusals():
            os.fsync(self._file.fileno())

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._file.tell()

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int = 0) -> None:
        """Attach a file, such as rig.yaml."""
        with self._refusals():
            self._writer.add_attachment(stamp_ns, stamp_ns, name, media_type, data)

    def write_metadata(self, name: str, record: dict[str, str]) -> None:
        """Write a record of names and texts."""
        with self._refusals():
            self._writer.add_metadata(name, record)

    def write(self, topic: str, type_name: str, message: object, stamp_ns: int, arrival_ns: int | None = None) -> None:
        """Write a message of a standard type: CDR bytes, or a `self.types.types[type_name]` with arrays as numpy's."""
        if not isinstance(message, bytes):
            message = bytes(self.types.serialize_cdr(message, type_name, little_endian=True))
        channel = self._channel(topic, type_name)
        number = self._sequence[channel] = self._sequence.get(channel, -1) + 1
        arrival = stamp_ns if arrival_ns is None else arrival_ns
        with self._refusals():
            self._writer.add_message(channel, int(stamp_ns), message, int(arrival), number)

    def _channel(self, topic: str, type_name: str) -> int:
        if topic in self._channels:
            known, channel = self._channels[topic]
            if known != type_name:
                raise GarbiError(f"topic {topic}: holds {known}, not {type_name}")
            return channel
        if type_name not in self._schemas:
            definition, _ = self.types.generate_msgdef(type_name, ros_version=2)
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition.encode())
        latched = type_name == "tf2_msgs/msg/TFMessage" and topic.endswith("_static")
        metadata = {"offered_qos_profiles": LATCHED} if latched else {}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[type_name], metadata)
        self._channels[topic] = (type_name, channel)
        return channel
