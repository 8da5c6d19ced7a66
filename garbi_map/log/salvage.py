"""What can still be had from a chunk whose checksum does not hold.

Nothing that comes from here is proven, but for a chunk whose one wrong bit was found: then its checksum holds again.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Container, Iterator
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from garbi_map.log import chunks
from garbi_map.log.chunks import DAMAGE, MESSAGE_HEAD, RECORD, RawMessage

STEP = 1 << 14  # bytes that a damaged stream is asked for at once: so many are lost at its break
MOST_REPAIRED = 1 << 23  # bytes; in a larger chunk a wrong bit would be found by chance in 1 of 64
RECORD_START = re.compile(rb"[\x03\x04\x05](?=.{4}\0{4})", re.DOTALL)


class Repaired(NamedTuple):
    """A chunk's data after one bit was turned: at byte `place` of it, or (None) in the checksum itself."""

    data: memoryview
    place: int | None


def repaired(data: memoryview, crc: int) -> Repaired | None:
    """The data with the one bit turned that makes their checksum hold; None where no single bit does.

    Damage that is more than a bit is taken for one with a chance of (bits of the chunk) in 2^32.
    """
    if len(data) > MOST_REPAIRED:
        return None
    syndrome = zlib.crc32(data) ^ crc
    if syndrome.bit_count() == 1:
        return Repaired(data, None)
    from garbi_map.log.kernels import flipped_bit

    place, bit = flipped_bit(syndrome, len(data))
    if place < 0:
        return None
    turned = bytearray(data)
    turned[place] ^= bit
    return Repaired(memoryview(turned), place) if zlib.crc32(turned) == crc else None


def decoded_part(content: memoryview) -> memoryview:
    """The data of a chunk record's content as far as its stream can be read; never raises on damage."""
    pieces: list[bytes | memoryview] = []
    size = 0
    try:
        head = chunks.chunk_head(content, whole=False)
        size = min(head.size, chunks.MAX_CHUNK)
        pieces.extend(chunks.decoded(content[head.data_start :], head._replace(size=size), STEP))
    except (*DAMAGE, *chunks.UNPACKABLE):
        pass
    return memoryview(b"".join(pieces))[:size]


def definitions(buffer: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(opcode, content) of the schemas and channels in a damaged buffer whose parts add up."""
    for opcode, content in _plausible(buffer, range(1 << 16), 0, 1 << 64):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield opcode, content


def messages(buffer: memoryview, channels: Container[int], begin: int, end: int) -> Iterator[RawMessage]:
    """The messages of known channels in a damaged buffer, in the order of writing: those whose log times lie from begin to
    end, ns, and inside of which no other begins."""
    for opcode, content in _plausible(buffer, channels, begin, end):
        if opcode == Opcode.MESSAGE:
            yield chunks.raw_message(content)


def _plausible(buffer: memoryview, channels: Container[int], begin: int, end: int) -> Iterator[tuple[int, memoryview]]:
    position = _next_record(buffer, 0, channels, begin, end)
    while position is not None:
        following = _record_end(buffer, position, channels, begin, end)
        assert following is not None
        if following == len(buffer) or _record_end(buffer, following, channels, begin, end) is not None:
            next_one: int | None = following
        else:
            next_one = _next_record(buffer, position + 1, channels, begin, end)
        # a record inside of which another begins has a garbled length
        if following <= len(buffer) and (next_one is None or next_one >= following):
            yield buffer[position], buffer[position + RECORD.size : following]
        position = next_one if next_one is not None and next_one < len(buffer) else None


def _next_record(buffer: memoryview, position: int, channels: Container[int], begin: int, end: int) -> int | None:
    """Where the first record that may well stand there begins, at or after a position; None where there is none."""
    for found in RECORD_START.finditer(buffer, position):
        if _record_end(buffer, found.start(), channels, begin, end) is not None:
            return found.start()
    return None


def _record_end(buffer: memoryview, position: int, channels: Container[int], begin: int, end: int) -> int | None:
    """Where a record ends that may well stand there, even behind the end of the buffer; None where none does."""
    here = buffer[position:]
    if len(here) < RECORD.size + MESSAGE_HEAD.size:
        return None
    opcode, length = RECORD.unpack_from(here)
    content = here[RECORD.size : RECORD.size + length]
    if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD.size:
        channel, _, log_time, _ = MESSAGE_HEAD.unpack_from(content)
        if channel not in channels or not begin <= log_time <= end:
            return None
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        try:
            if not _adds_up(opcode, content):
                return None
        except DAMAGE:
            return None
    elif opcode != Opcode.MESSAGE_INDEX or length != 6 + int.from_bytes(content[2:6], "little"):
        return None
    return int(position + RECORD.size + length)


def _adds_up(opcode: int, content: memoryview) -> bool:
    """Whether a schema or a channel can be read, and ends where its record does."""
    place = 2 if opcode == Opcode.SCHEMA else 4
    for _ in range(3):
        place += 4 + int.from_bytes(content[place : place + 4], "little")
        if place > len(content):
            return False
    if place != len(content):
        return False
    chunks.parse(Schema if opcode == Opcode.SCHEMA else Channel, content)
    return True
