"""The bytes of an MCAP file: records, and chunks whose checksum holds.

The layout is that of https://mcap.dev/spec. A buffer that comes out of `unpack_chunk` is what the recorder wrote, or
an error has been raised; what is in it may still be nonsense that a recorder wrote.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Container, Iterator
from io import BytesIO
from typing import BinaryIO, NamedTuple, cast

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK = 1 << 30  # bytes; what a hostile header may make us allocate
AT_ONCE = 1 << 22  # bytes; a larger chunk is decompressed in pieces of these
MAX_RECORD = MAX_CHUNK + (1 << 16)  # bytes, packed
RECORD = struct.Struct("<BQ")
CHUNK_HEAD = struct.Struct("<QQQII")
MESSAGE_HEAD = struct.Struct("<HIQQ")
MESSAGE_START = struct.Struct("<BQH")
MESSAGE = int(Opcode.MESSAGE)
DAMAGE = (struct.error, ValueError, IndexError, EOFError, OverflowError, MemoryError, McapError)

UNPACKABLE = (zstandard.ZstdError, RuntimeError, ValueError, EOFError)


class Damaged(ValueError):
    """A record that cannot be trusted; the text says why in a few words."""


class Unindexed(Damaged):
    """A sound file that has no index, as some recorders write it."""


def reason(error: BaseException) -> str:
    """Why something is damaged, in a few words."""
    return str(error) if isinstance(error, Damaged) else "unreadable"


class RawMessage(NamedTuple):
    """A message as it lies in the log; data is a view into its chunk."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: memoryview

    def arrival(self, stamp_ns: int) -> int:
        """When the recorder had it, ns: ROS 2 puts that into log_time; this project puts the stamp there, and the
        arrival into publish_time."""
        return self.publish_time if self.log_time == stamp_ns else self.log_time


class ChunkHead(NamedTuple):
    """begin, end: log times of the first and last message, ns; data_start: where the data begin in the content."""

    begin: int
    end: int
    size: int
    crc: int
    compression: bytes
    data_start: int


def chunk_head(content: memoryview, whole: bool = True) -> ChunkHead:
    """The head of a chunk record's content; raises Damaged where its lengths contradict each other, which they do in one
    that is not whole."""
    if len(content) < CHUNK_HEAD.size + 8:
        raise Damaged("chunk cut short")
    begin, end, size, crc, name_length = CHUNK_HEAD.unpack_from(content)
    data_start = CHUNK_HEAD.size + name_length + 8
    if data_start > len(content):
        raise Damaged("chunk header overwritten")
    if whole and struct.unpack_from("<Q", content, data_start - 8)[0] != len(content) - data_start:
        raise Damaged("chunk header overwritten")
    return ChunkHead(begin, end, size, crc, bytes(content[CHUNK_HEAD.size : data_start - 8]), data_start)


def unpack_chunk(content: memoryview) -> memoryview:
    """The records of a chunk, decompressed, length and checksum validated; raises Damaged."""
    head = chunk_head(content)
    if head.size > MAX_CHUNK:
        raise Damaged("chunk larger than 1 GiB")
    packed = content[head.data_start :]
    try:
        data = _decompress(packed, head)
    except UNPACKABLE as error:
        raise Damaged("compressed data unreadable") from error
    if len(data) != head.size:
        raise Damaged("chunk of the wrong length")
    if head.crc and zlib.crc32(data) != head.crc:
        raise Damaged("checksum does not match")
    return memoryview(data)


def _decompress(packed: memoryview, head: ChunkHead) -> bytes | memoryview:
    if head.compression == b"":
        return packed
    if head.size > AT_ONCE:
        # what is allocated is what was decoded so far, whatever the head claims
        return b"".join(decoded(packed, head, AT_ONCE))
    if head.compression == b"zstd":
        # the frame states its own size, which is what would be allocated
        if zstandard.frame_content_size(packed) not in (-1, head.size):
            raise Damaged("chunk of the wrong length")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=head.size)
    if head.compression == b"lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=head.size))
    raise Damaged("unknown compression")


def decoded(packed: memoryview, head: ChunkHead, step: int) -> Iterator[bytes | memoryview]:
    """A chunk's data in pieces of up to `step` bytes, not much more than its head states in all; raises what the decoder
    raises where the stream is damaged."""
    left = head.size
    if head.compression == b"zstd":
        with zstandard.ZstdDecompressor().stream_reader(BytesIO(packed)) as stream:
            while left > 0 and (piece := stream.read(step)):
                left -= len(piece)
                yield piece
    elif head.compression == b"lz4":
        decoder = lz4.frame.LZ4FrameDecompressor()
        piece = bytes(decoder.decompress(packed, max_length=step))
        while piece and left > 0:
            left -= len(piece)
            yield piece
            piece = b"" if decoder.eof else bytes(decoder.decompress(b"", max_length=step))
    elif head.compression == b"":
        yield packed[:left]
    else:
        raise Damaged("unknown compression")


def records(buffer: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(opcode, content) of each record in a buffer; raises Damaged where a record does not fit."""
    position, total = 0, len(buffer)
    while position < total:
        if position + RECORD.size > total:
            raise Damaged("record cut short")
        opcode, length = RECORD.unpack_from(buffer, position)
        position += RECORD.size
        if length > total - position:
            raise Damaged("record longer than its chunk")
        yield opcode, buffer[position : position + length]
        position += length


def messages(buffer: memoryview, channels: Container[int]) -> Iterator[RawMessage]:
    """The messages of some channels in a chunk's buffer, in the order of writing; raises Damaged."""
    position, total = 0, len(buffer)
    while position + MESSAGE_START.size <= total:
        opcode, length, channel = MESSAGE_START.unpack_from(buffer, position)
        following = position + RECORD.size + length
        if following > total:
            raise Damaged("record longer than its chunk")
        if opcode == MESSAGE and channel in channels:
            if length < MESSAGE_HEAD.size:
                raise Damaged("message cut short")
            yield raw_message(buffer[position + RECORD.size : following])
        position = following


def raw_message(content: memoryview) -> RawMessage:
    """The message of a record's content."""
    channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
    return RawMessage(channel, sequence, log_time, publish_time, content[MESSAGE_HEAD.size :])


def parse(record_type: type, content: memoryview) -> object:
    """A small record (Schema, Channel, ChunkIndex, ...) as the `mcap` library's class; raises one of DAMAGE."""
    return record_type.read(ReadDataStream(BytesIO(content)))  # type: ignore[attr-defined]


def attachment_data(content: memoryview) -> bytes:
    """The data of an attachment record's content; raises one of DAMAGE where its checksum does not match."""
    crc = struct.unpack("<I", content[-4:])[0]
    if crc and zlib.crc32(content[:-4]) != crc:
        raise Damaged("checksum does not match")
    return cast(Attachment, parse(Attachment, content)).data


def read_at(file: BinaryIO, offset: int, length: int) -> memoryview:
    """Exactly `length` bytes at `offset`; raises Damaged where the file ends before, or the disk does not give them."""
    if length > MAX_RECORD:
        raise Damaged("record larger than 1 GiB")
    try:
        file.seek(offset)
        data = file.read(length)
    except OSError as error:
        raise Damaged(f"cannot be read: {error.strerror or error}") from error
    if len(data) != length:
        raise Damaged("file ends inside a record")
    return memoryview(data)
