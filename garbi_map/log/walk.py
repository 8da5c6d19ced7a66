"""The index of an MCAP file whose summary is missing or damaged: every record is visited, every chunk tried."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from mcap import records as mcap_records
from mcap.opcode import Opcode

from garbi_map.log import chunks
from garbi_map.log.chunks import DAMAGE, MAGIC, MESSAGE_HEAD, RECORD, Damaged, reason
from garbi_map.log.index import Index, Piece

RAW_PIECE = 1 << 20  # bytes of a file without chunks that are read at once
SMALL = 1 << 28  # bytes; no record but a chunk or an attachment is larger
PLAIN = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}


def index_by_walking(path: Path, file: BinaryIO, size: int) -> Index:
    """The index of what can be read, with each loss named. Never raises on damage."""
    walk = _Walk(path, file, size)
    position: int | None = len(MAGIC)
    while position is not None and position < size:
        position = walk.step(position)
    walk.close_raw()
    return walk.index


class _Walk:
    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self.index = Index(path, times={})
        self.file, self.size = file, size
        self.raw: Piece | None = None

    def step(self, position: int) -> int | None:
        """Take in the record at `position`; the position of the next one, None at the end of the data."""
        try:
            opcode, length = RECORD.unpack(chunks.read_at(self.file, position, RECORD.size))
            following = position + RECORD.size + length
            if opcode == 0 or opcode == Opcode.FOOTER or following > self.size:
                raise Damaged("cut short" if following > self.size else "overwritten")
            if opcode == Opcode.CHUNK:
                self._chunk(position, length)
            elif opcode in PLAIN:
                self._plain(opcode, position, length)
            elif opcode == Opcode.ATTACHMENT:
                content = chunks.read_at(self.file, position + RECORD.size, length)
                chunks.attachment_data(content)
                record = cast(mcap_records.Attachment, chunks.parse(mcap_records.Attachment, content))
                self.index.attachments[record.name] = (position, RECORD.size + length)
            elif opcode == Opcode.METADATA:
                self._metadata(position, length)
            elif opcode == Opcode.MESSAGE_INDEX:
                self._check_message_index(position, length)
            elif opcode == Opcode.DATA_END:
                self._check_all(position, length)
                return None
        except DAMAGE as error:
            return self._lose(position, reason(error))
        return following

    def _chunk(self, position: int, length: int) -> None:
        content = chunks.read_at(self.file, position + RECORD.size, length)
        head = chunks.chunk_head(content)
        try:
            self._take(chunks.unpack_chunk(content), Piece(position, RECORD.size + length, head.begin, head.end))
        except DAMAGE as error:
            # its frame is sound, so the walk goes on behind it
            self._name_loss(position, f"chunk lost ({reason(error)})")

    def _plain(self, opcode: int, position: int, length: int) -> None:
        """Records outside of chunks are gathered into pieces of about a megabyte."""
        if length > SMALL:
            raise Damaged("overwritten")
        content = chunks.read_at(self.file, position + RECORD.size, length)
        if opcode == Opcode.MESSAGE and MESSAGE_HEAD.unpack_from(content)[0] not in self.index.channels:
            raise Damaged("message of an unknown topic")
        if self.raw is None or self.raw.offset + self.raw.length != position or self.raw.length > RAW_PIECE:
            self.close_raw()
            self.raw = Piece(position, 0, 0, 0, raw=True)
        if opcode != Opcode.MESSAGE:
            self._define(opcode, content)
        self.raw.length += RECORD.size + length

    def close_raw(self) -> None:
        """Take in the records gathered outside of chunks."""
        if self.raw is not None:
            raw, self.raw = self.raw, None
            self._take(chunks.read_at(self.file, raw.offset, raw.length), raw)

    def _take(self, buffer: memoryview, piece: Piece) -> None:
        for opcode, content in chunks.records(buffer):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content)
        times: dict[int, list[int]] = {}
        everything = range(1 << 16)
        for message in chunks.messages(buffer, everything):
            times.setdefault(message.channel, []).append(message.log_time)
        unknown = times.keys() - self.index.channels.keys()
        for channel in unknown:
            count = len(times.pop(channel))
            self._name_loss(piece.offset, f"{count} messages of a topic whose name was lost")
        if not times:
            return
        piece.channels = frozenset(times)
        piece.begin = min(min(stamps) for stamps in times.values())
        piece.end = max(max(stamps) for stamps in times.values())
        self.index.pieces.append(piece)
        assert self.index.times is not None
        for channel, stamps in times.items():
            self.index.counts[channel] += len(stamps)
            self.index.times.setdefault(channel, []).append(np.array(stamps, np.uint64).astype(np.int64))

    def _define(self, opcode: int, content: memoryview) -> None:
        if opcode == Opcode.SCHEMA:
            schema = cast(mcap_records.Schema, chunks.parse(mcap_records.Schema, content))
            self.index.schemas[schema.id] = schema
        else:
            channel = cast(mcap_records.Channel, chunks.parse(mcap_records.Channel, content))
            self.index.channels[channel.id] = channel

    def _metadata(self, position: int, length: int) -> None:
        if length > SMALL:
            raise Damaged("overwritten")
        content = chunks.read_at(self.file, position + RECORD.size, length)
        record = cast(mcap_records.Metadata, chunks.parse(mcap_records.Metadata, content))
        self.index.metadata[record.name] = record.metadata

    def _check_message_index(self, position: int, length: int) -> None:
        """A garbled length here would swallow the chunks behind it unseen."""
        entries = struct.unpack_from("<I", chunks.read_at(self.file, position + RECORD.size, 6), 2)[0]
        if length != 6 + entries:
            raise Damaged("overwritten")

    def _check_all(self, position: int, length: int) -> None:
        """Records outside of chunks have no checksum of their own, but the whole before the end of the data may."""
        crc = struct.unpack("<I", chunks.read_at(self.file, position + RECORD.size, length))[0]
        self.close_raw()
        if not crc or not any(piece.raw for piece in self.index.pieces):
            return
        found = 0
        for start in range(0, position, RAW_PIECE):
            found = zlib.crc32(chunks.read_at(self.file, start, min(RAW_PIECE, position - start)), found)
        if found != crc:
            self._name_loss(position, "the checksum of the whole does not match: some messages are wrong")

    def _lose(self, position: int, why: str) -> int | None:
        self.close_raw()
        following = chunks.next_chunk(self.file, position + 1, self.size)
        lost = (following or self.size) - position
        self._name_loss(position, f"{lost} bytes lost ({why})")
        return following

    def _name_loss(self, position: int, what: str) -> None:
        pieces = self.index.pieces
        where = f"after {(pieces[-1].end - pieces[0].begin) * 1e-9:.2f} s" if pieces else "at its begin"
        self.index.losses.append(f"{self.index.path.name}: {where}, byte {position}: {what}")
