"""Where the records of an MCAP file lie: from one to the next, and past what is none. Only heads are read."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode

from garbi_map.log.chunks import DAMAGE, MAGIC, MAX_RECORD, RECORD, Damaged, read_at, reason

LOST = 0  # the opcode of bytes that are no record
PRIVATE = 0x80  # opcodes from here on belong to other programs
BLOCK, OVERLAP, SECTOR = 1 << 24, 128, 4096  # bytes: searched at once; longest shape; smallest read of a failing disk
FIXED: dict[int, int] = {Opcode.FOOTER: 20, Opcode.SUMMARY_OFFSET: 17, Opcode.DATA_END: 4}  # bytes of their content
# bytes before, widths of the lengths of the parts, bytes after them
LAYOUT: dict[int, tuple[int, tuple[str, ...], int]] = {
    Opcode.HEADER: (0, ("<I", "<I"), 0),
    Opcode.SCHEMA: (2, ("<I", "<I", "<I"), 0),
    Opcode.CHANNEL: (4, ("<I", "<I", "<I"), 0),
    Opcode.CHUNK: (28, ("<I", "<Q"), 0),
    Opcode.MESSAGE_INDEX: (2, ("<I",), 0),
    Opcode.ATTACHMENT: (16, ("<I", "<I", "<Q"), 4),
    Opcode.METADATA: (0, ("<I", "<I"), 0),
}
# a chunk or an attachment: its length below 2^40, then what must be zero in either, or a compression's name
SHAPES = re.compile(
    rb"\x06(?=.{5}\0{3}.{28}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd).{8})|\x09(?=.{5}\0{3}.{16}.{2}\0{2})", re.DOTALL
)


class Frame(NamedTuple):
    """A record, or bytes that are none (opcode LOST).

    length  bytes, of the whole, head included; where the file ends inside a chunk, what is there of it
    why     what is wrong, in a few words; "" for a record
    """

    opcode: int
    offset: int
    length: int
    why: str = ""

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.offset + self.length


def survey(file: BinaryIO, size: int, start: int = len(MAGIC)) -> Iterator[Frame]:
    """The records of the data section in the order of the file, and what lies between them. Never raises on damage.

    start: of a record.
    """
    position: int | None = start
    while position is not None and position < size:
        try:
            frame = _frame_at(file, position, size)
            if frame.opcode == Opcode.FOOTER:
                return
            # behind the end comes the index; but where blocks changed places, there are chunks
            following = frame.end if frame.opcode != Opcode.DATA_END else next_shape(file, frame.end, size)
        except DAMAGE as error:
            following = next_shape(file, position + 1, size)
            frame = Frame(LOST, position, (following or size) - position, reason(error))
        yield frame
        position = following


def _frame_at(file: BinaryIO, position: int, size: int) -> Frame:
    """The record at a place; raises one of DAMAGE."""
    opcode, length = RECORD.unpack(read_at(file, position, RECORD.size))
    frame = Frame(opcode, position, RECORD.size + length)
    if opcode == LOST or PRIVATE > opcode > Opcode.DATA_END:
        raise Damaged("overwritten")
    if frame.end > size and opcode != Opcode.CHUNK:
        raise Damaged("cut short")
    if length > MAX_RECORD or _stated_length(file, frame, size) != length:
        raise Damaged("overwritten")
    if frame.end > size:
        return frame._replace(length=size - position, why="cut short")
    return frame


def _stated_length(file: BinaryIO, frame: Frame, size: int) -> int:
    """Bytes of a record's content as its parts state it: a garbled length would swallow the chunks behind it unseen, and
    so would the garbled opcode of a chunk."""
    start, length = frame.offset + RECORD.size, frame.length - RECORD.size
    if frame.opcode >= PRIVATE:
        shape = b"\x06" + bytes(read_at(file, frame.offset + 1, min(OVERLAP, frame.length) - 1))
        return -1 if SHAPES.match(shape) else length
    if frame.opcode == Opcode.FOOTER and frame.end != size - len(MAGIC):
        return -1
    if frame.opcode not in LAYOUT:
        return FIXED.get(frame.opcode, length)
    before, parts, after = LAYOUT[frame.opcode]
    place = start + before
    for width in parts:
        if place > frame.end:
            return -1
        part = read_at(file, place, struct.calcsize(width))
        place += len(part) + struct.unpack(width, part)[0]
    return place + after - start


def next_shape(file: BinaryIO, start: int, size: int, block: int = BLOCK) -> int | None:
    """Offset of the first thing at or after `start` that has the shape of a chunk or an attachment, None where there is
    none; block: bytes that are searched at once."""
    while start < size:
        data = _readable(file, start, min(block + OVERLAP, size - start))
        for found in SHAPES.finditer(data):
            try:
                if not _frame_at(file, start + found.start(), size).why:
                    return start + found.start()
            except DAMAGE:
                continue
        start += block
    return None


def _readable(file: BinaryIO, start: int, length: int) -> bytes:
    """The bytes there, zeros where the disk does not give them."""
    try:
        file.seek(start)
        return file.read(length)
    except OSError:
        if length <= SECTOR:
            return bytes(length)
        half = length // 2
        return _readable(file, start, half) + _readable(file, start + half, length - half)
