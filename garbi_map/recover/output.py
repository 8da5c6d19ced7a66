"""The recovered log while it is written, and its proof: it is read back by another reader and compared."""

from __future__ import annotations

import struct
from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from garbi_map.errors import GarbiError
from garbi_map.log.chunks import DAMAGE, RawMessage

COMPRESSION = {b"zstd": CompressionType.ZSTD, b"lz4": CompressionType.LZ4, b"": CompressionType.NONE}
_FACTS = struct.Struct("<IQQQ")


class Content:
    """What a log holds, as counts and hashes that are equal where the content is: all messages of a channel with their
    times in the order of writing, what the channel is, attachments, metadata."""

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self.first: int | None = None
        self.last: int | None = None
        self._channels: dict[int, bytes] = {}
        self._messages: dict[int, blake2b] = {}
        self._records: list[bytes] = []

    def channel(self, number: int, channel: Channel, schema: Schema | None) -> None:
        """A channel, before its messages."""
        type_of = (schema.name, schema.encoding, schema.data) if schema else None
        described = (channel.topic, channel.message_encoding, sorted(channel.metadata.items()), type_of)
        self._channels[number] = repr(described).encode()
        self._messages[number] = blake2b(digest_size=16)
        self.counts[number] = 0

    def message(self, number: int, sequence: int, log_time: int, publish_time: int, data: bytes | memoryview) -> None:
        """A message of a channel."""
        found = self._messages[number]
        found.update(_FACTS.pack(sequence, log_time, publish_time, len(data)))
        found.update(data)
        self.counts[number] += 1
        self.first = log_time if self.first is None else min(self.first, log_time)
        self.last = log_time if self.last is None else max(self.last, log_time)

    def attachment(self, record: Attachment) -> None:
        """An attachment."""
        facts = (record.name, record.media_type, record.create_time, record.log_time)
        self._records.append(repr(facts).encode() + blake2b(record.data, digest_size=16).digest())

    def metadata(self, record: Metadata) -> None:
        """A record of names and texts."""
        self._records.append(repr((record.name, sorted(record.metadata.items()))).encode())

    def digest(self) -> tuple[object, ...]:
        """Equal for equal content."""
        channels = {
            number: (described, self.counts[number], self._messages[number].digest())
            for number, described in self._channels.items()
        }
        return channels, sorted(self._records)


class Output:
    """Writes a log record by record, in the order it is told."""

    def __init__(self, file: BinaryIO, profile: str, compression: bytes) -> None:
        self.content = Content()
        self._writer = Writer(
            file, compression=COMPRESSION.get(compression, CompressionType.ZSTD), enable_data_crcs=True
        )
        self._writer.start(profile, "garbi recover")
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[object, ...], int] = {}

    def channel(self, channel: Channel, schema: Schema | None, prefix: str = "") -> int:
        """The number of a channel in the output; its topic gets a prefix."""
        topic = prefix + ("/" if prefix and not channel.topic.startswith("/") else "") + channel.topic
        type_key = (schema.name, schema.encoding, schema.data) if schema else None
        key = (topic, channel.message_encoding, tuple(sorted(channel.metadata.items())), type_key)
        if key not in self._channels:
            number = 0
            if type_key is not None:
                if type_key not in self._schemas:
                    self._schemas[type_key] = self._writer.register_schema(*type_key)
                number = self._schemas[type_key]
            named = Channel(0, topic, channel.message_encoding, channel.metadata, number)
            self._channels[key] = self._writer.register_channel(
                topic, channel.message_encoding, number, dict(channel.metadata)
            )
            self.content.channel(self._channels[key], named, schema)
        return self._channels[key]

    def message(self, number: int, message: RawMessage) -> None:
        """A message with its times, as it was."""
        data = bytes(message.data)
        self._writer.add_message(number, message.log_time, data, message.publish_time, message.sequence)
        self.content.message(number, message.sequence, message.log_time, message.publish_time, data)

    def attachment(self, record: Attachment) -> None:
        """An attachment, as it was."""
        self._writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        self.content.attachment(record)

    def metadata(self, record: Metadata) -> None:
        """A metadata record, as it was."""
        self._writer.add_metadata(record.name, record.metadata)
        self.content.metadata(record)

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()


def verify(path: Path, expected: Content, advance: Callable[[int], None]) -> None:
    """Read a log back with the `mcap` library, checksums validated, and compare; advance is told each chunk's bytes.

    Raises GarbiError where it is not what was written.
    """
    found = Content()
    chunks = 0
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
            if summary is None or summary.statistics is None:
                raise ValueError("no index")
            for number, channel in summary.channels.items():
                found.channel(number, channel, summary.schemas.get(channel.schema_id))
            file.seek(0)
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Attachment):
                    found.attachment(record)
                elif isinstance(record, Metadata):
                    found.metadata(record)
                elif isinstance(record, Chunk):
                    chunks += 1
                    for inner in breakup_chunk(record, validate_crc=True):
                        if isinstance(inner, Message):
                            times = (inner.sequence, inner.log_time, inner.publish_time)
                            found.message(inner.channel_id, *times, inner.data)
                    advance(len(record.data))
            counted = summary.statistics.channel_message_counts
    except (*DAMAGE, OSError, KeyError) as error:
        raise GarbiError(f"{path}: what was written cannot be read back ({error}); check the disk") from error
    indexed = {number: count for number, count in found.counts.items() if count} == dict(counted)
    if not indexed or chunks != len(summary.chunk_indexes) or found.digest() != expected.digest():
        raise GarbiError(f"{path}: what was read back is not what was written; check the disk and the memory")
