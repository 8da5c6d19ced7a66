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
from garbi_map.words import many

RAW_PIECE = 1 << 20  # bytes of a file without chunks that are read at once
STRETCH = 1 << 22  # bytes of a stretch where a file is sampled
SEEK_BLOCK = 1 << 20  # bytes that are read at once to find a chunk
SMALL = 1 << 28  # bytes; no record but a chunk or an attachment is larger
PLAIN = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}


def index_by_walking(path: Path, file: BinaryIO, size: int) -> Index:
    """The index of what can be read, with each loss named. Never raises on damage."""
    walk = _Walk(path, file, size)
    position: int | None = len(MAGIC)
    while position is not None and position < size:
        position = walk.step(position)
    return walk.finish()


def index_by_seeking(path: Path, file: BinaryIO, size: int, places: int = 64) -> Index:
    """The index of a few stretches of a large file, evenly spread, its begin and its end among them. Never raises on
    damage; what lies between the stretches is neither known nor lost."""
    walk = _Walk(path, file, size)
    walk.index.sampled = True
    length = min(STRETCH, size // (places + 2))
    for start in [len(MAGIC), *range(size // places, size - length, size // places), max(size - length, len(MAGIC))]:
        position: int | None = start
        if start > len(MAGIC):
            walk.index.stretches.append(len(walk.index.pieces))
            position = chunks.next_chunk(file, start, size, SEEK_BLOCK)
        while position is not None and position < min(start + length, size):
            position = walk.step(position)
    return walk.finish()


class _Walk:
    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self.index = Index(path, times={})
        self.file, self.size = file, size
        self.chunked = False
        self.loose: list[Piece] = []
        self.whole: tuple[int, int] | None = None  # where the data end, and their checksum

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
                self._end(position, length)
                return None
        except DAMAGE as error:
            return self._lose(position, reason(error))
        return following

    def _chunk(self, position: int, length: int) -> None:
        content = chunks.read_at(self.file, position + RECORD.size, length)
        head = chunks.chunk_head(content)
        self.chunked = True
        try:
            self._take(chunks.unpack_chunk(content), Piece(position, RECORD.size + length, head.begin, head.end))
        except DAMAGE as error:
            # its frame is sound, so the walk goes on behind it
            self._name_loss(position, f"chunk lost ({reason(error)})")

    def _plain(self, opcode: int, position: int, length: int) -> None:
        """A record outside of any chunk; messages are gathered into pieces of about a megabyte."""
        if length > SMALL:
            raise Damaged("overwritten")
        content = chunks.read_at(self.file, position + RECORD.size, length)
        if opcode != Opcode.MESSAGE:
            self._define(opcode, content, protected=False)
            return
        if MESSAGE_HEAD.unpack_from(content)[0] not in self.index.channels:
            raise Damaged("message of an unknown topic")
        last = self.loose[-1] if self.loose else None
        if last and last.offset + last.length == position and last.length < RAW_PIECE:
            last.length += RECORD.size + length
        else:
            self.loose.append(Piece(position, RECORD.size + length, 0, 0, raw=True))

    def finish(self) -> Index:
        """Take in the messages outside of chunks, but where there are chunks: there, they are the debris of one."""
        if self.chunked and self.loose:
            size = sum(piece.length for piece in self.loose)
            self._name_loss(
                self.loose[0].offset, f"{size} bytes of messages outside of chunks, without a checksum, lost"
            )
        elif not self.chunked:
            for piece in self.loose:
                self._take(chunks.read_at(self.file, piece.offset, piece.length), piece)
            self._check_whole()
        return self.index

    def _take(self, buffer: memoryview, piece: Piece) -> None:
        for opcode, content in chunks.records(buffer):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content, protected=True)
        times: dict[int, list[int]] = {}
        everything = range(1 << 16)
        for message in chunks.messages(buffer, everything):
            times.setdefault(message.channel, []).append(message.log_time)
        unknown = times.keys() - self.index.channels.keys()
        for channel in unknown:
            count = len(times.pop(channel))
            self._name_loss(piece.offset, f"{many(count, 'message')} of a topic whose name was lost")
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

    def _define(self, opcode: int, content: memoryview, protected: bool) -> None:
        """Take in a schema or a channel; one that a checksum protects wins."""
        if opcode == Opcode.SCHEMA:
            schema = cast(mcap_records.Schema, chunks.parse(mcap_records.Schema, content))
            if protected or schema.id not in self.index.schemas:
                self.index.schemas[schema.id] = schema
        else:
            channel = cast(mcap_records.Channel, chunks.parse(mcap_records.Channel, content))
            if protected or channel.id not in self.index.channels:
                self.index.channels[channel.id] = channel

    def _metadata(self, position: int, length: int) -> None:
        if length > SMALL:
            raise Damaged("overwritten")
        content = chunks.read_at(self.file, position + RECORD.size, length)
        record = cast(mcap_records.Metadata, chunks.parse(mcap_records.Metadata, content))
        self.index.metadata[record.name] = record.metadata

    def _end(self, position: int, length: int) -> None:
        if length != 4:
            raise Damaged("overwritten")
        self.whole = (position, struct.unpack("<I", chunks.read_at(self.file, position + RECORD.size, 4))[0])

    def _check_message_index(self, position: int, length: int) -> None:
        """A garbled length here would swallow the chunks behind it unseen."""
        entries = struct.unpack_from("<I", chunks.read_at(self.file, position + RECORD.size, 6), 2)[0]
        if length != 6 + entries:
            raise Damaged("overwritten")

    def _check_whole(self) -> None:
        """Records outside of chunks have no checksum of their own, but all data before the end of the data may."""
        if self.whole is None or not self.whole[1]:
            return
        end, crc = self.whole
        found = 0
        for start in range(0, end, RAW_PIECE):
            found = zlib.crc32(chunks.read_at(self.file, start, min(RAW_PIECE, end - start)), found)
        if found != crc:
            self._name_loss(end, "the checksum of the whole does not match: some messages are wrong")

    def _lose(self, position: int, why: str) -> int | None:
        following = chunks.next_chunk(self.file, position + 1, self.size)
        lost = (following or self.size) - position
        self._name_loss(position, f"{lost} bytes lost ({why})")
        return following

    def _name_loss(self, position: int, what: str) -> None:
        pieces = self.index.pieces
        where = f"after {(pieces[-1].end - pieces[0].begin) * 1e-9:.2f} s" if pieces else "at its begin"
        self.index.losses.append(f"{self.index.path.name}: {where}, byte {position}: {what}")
