"""The index of an MCAP file whose summary is missing or damaged: every record is visited, every chunk tried."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from mcap import records as mcap_records
from mcap.opcode import Opcode

from garbi_map.log import chunks, salvage
from garbi_map.log.chunks import DAMAGE, MAGIC, MESSAGE_HEAD, RECORD, Damaged, reason
from garbi_map.log.index import Index, Piece, read_piece
from garbi_map.log.survey import LOST, Frame, next_shape, survey
from garbi_map.words import many

RAW_PIECE = 1 << 20  # bytes of a file without chunks that are read at once
STRETCH = 1 << 22  # bytes of a stretch where a file is sampled
SEEK_BLOCK = 1 << 20  # bytes that are read at once to find its first chunk


def index_by_walking(path: Path, file: BinaryIO, size: int) -> Index:
    """The index of what can be read, with each loss named. Never raises on damage."""
    walk = _Walk(path, file)
    for frame in survey(file, size):
        walk.take_or_lose(frame)
    return walk.finish()


def index_by_seeking(path: Path, file: BinaryIO, size: int, places: int = 64) -> Index:
    """The index of a few stretches of a large file, evenly spread, its begin and its end among them. Never raises on
    damage; what lies between the stretches is neither known nor lost."""
    walk = _Walk(path, file)
    walk.index.sampled = True
    length = min(STRETCH, size // (places + 2))
    for place in range(places + 1):
        start = max(place * (size - length) // places, len(MAGIC))
        if place:
            walk.index.stretches.append(len(walk.index.pieces))
        first = next_shape(file, start, size, SEEK_BLOCK) if place else start
        for frame in survey(file, size, first) if first is not None else ():
            if frame.offset >= start + length:
                break
            walk.take_or_lose(frame)
    return walk.finish()


class _Walk:
    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.index = Index(path, times={})
        self.file = file
        self.chunked = False
        self.loose: list[Piece] = []
        self.nameless: list[Piece] = []  # chunks with topics whose names may still come
        self.whole: tuple[int, int] | None = None  # where the data end, and their checksum

    def take_or_lose(self, frame: Frame) -> None:
        """Take in a record, or name it as lost."""
        try:
            self._take_in(frame)
        except DAMAGE as error:
            self._name_loss(frame.offset, f"{frame.length} bytes lost ({reason(error)})")

    def _take_in(self, frame: Frame) -> None:
        if frame.opcode == LOST:
            raise Damaged(frame.why)
        if frame.opcode == Opcode.CHUNK:
            self._chunk(frame)
        elif frame.opcode == Opcode.MESSAGE:
            self._loose_message(frame)
        elif frame.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._define(frame.opcode, self._content(frame), protected=False)
        elif frame.opcode == Opcode.ATTACHMENT:
            content = self._content(frame)
            chunks.attachment_data(content)
            name = cast(mcap_records.Attachment, chunks.parse(mcap_records.Attachment, content)).name
            self.index.attachments[name] = (frame.offset, frame.length)
        elif frame.opcode == Opcode.METADATA:
            record = cast(mcap_records.Metadata, chunks.parse(mcap_records.Metadata, self._content(frame)))
            self.index.metadata[record.name] = record.metadata
        elif frame.opcode == Opcode.DATA_END:
            self.whole = (frame.offset, struct.unpack("<I", self._content(frame))[0])

    def _content(self, frame: Frame) -> memoryview:
        return chunks.read_at(self.file, frame.offset + RECORD.size, frame.length - RECORD.size)

    def _chunk(self, frame: Frame) -> None:
        content = self._content(frame)
        self.chunked = True
        try:
            if frame.why:
                raise Damaged(frame.why)
            buffer = chunks.unpack_chunk(content)
            for opcode, record in chunks.records(buffer):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._define(opcode, record, protected=True)
            self._take(buffer, Piece(frame.offset, frame.length, 0, 0))
        except DAMAGE as error:
            self._name_loss(frame.offset, f"chunk lost ({reason(error)})")
            self._names_in_damaged(content)

    def _names_in_damaged(self, content: memoryview) -> None:
        """The recorder names a topic once: in a chunk that is lost, perhaps. No checksum proves the name, so it is only
        taken where no other is known, and said."""
        known = set(self.index.channels)
        for opcode, record in salvage.definitions(salvage.decoded_part(content)):
            self._define(opcode, record, protected=False)
        found = [self.index.topic(number) for number in sorted(self.index.channels.keys() - known)]
        if found:
            names = ", ".join(found[:8]) + (" and others" if len(found) > 8 else "")
            self.index.losses.append(f"{self.index.path.name}: names from a damaged chunk, not proven: {names}")

    def _loose_message(self, frame: Frame) -> None:
        """A message outside of any chunk; they are gathered into pieces of about a megabyte."""
        channel = MESSAGE_HEAD.unpack(chunks.read_at(self.file, frame.offset + RECORD.size, MESSAGE_HEAD.size))[0]
        if channel not in self.index.channels:
            raise Damaged("message of an unknown topic")
        last = self.loose[-1] if self.loose else None
        if last and last.offset + last.length == frame.offset and last.length < RAW_PIECE:
            last.length += frame.length
        else:
            self.loose.append(Piece(frame.offset, frame.length, 0, 0, raw=True))

    def finish(self) -> Index:
        """Take in the messages outside of chunks, but where there are chunks: there, they are the debris of one."""
        for piece in self.nameless:
            self._take_late(piece)
        if self.chunked and self.loose:
            size = sum(piece.length for piece in self.loose)
            self._name_loss(
                self.loose[0].offset, f"{size} bytes of messages outside of chunks, without a checksum, lost"
            )
        elif not self.chunked:
            for piece in self.loose:
                self._take_late(piece)
            self._check_whole()
        self.index.pieces.sort(key=lambda piece: piece.offset)
        return self.index

    def _take_late(self, piece: Piece) -> None:
        try:
            self._take(read_piece(self.file, piece), piece, last=True)
        except DAMAGE as error:
            self._name_loss(piece.offset, f"{piece.length} bytes lost ({reason(error)})")

    def _take(self, buffer: memoryview, piece: Piece, last: bool = False) -> None:
        """Count a piece's messages; unless it is the last chance, names that are not known yet are waited for."""
        times: dict[int, list[int]] = {}
        everything = range(1 << 16)
        for message in chunks.messages(buffer, everything):
            times.setdefault(message.channel, []).append(message.log_time)
        unknown = times.keys() - self.index.channels.keys()
        if unknown and not last:
            self.nameless.append(piece)
            return
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

    def _name_loss(self, position: int, what: str) -> None:
        pieces = self.index.pieces
        where = f"after {(pieces[-1].end - pieces[0].begin) * 1e-9:.2f} s" if pieces else "at its begin"
        self.index.losses.append(f"{self.index.path.name}: {where}, byte {position}: {what}")
