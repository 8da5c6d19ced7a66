"""Where everything lies in one MCAP file, and how its parts are read."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap import records as mcap_records
from mcap.opcode import Opcode

from garbi_map.errors import GarbiError
from garbi_map.log import chunks
from garbi_map.log.chunks import RECORD, Damaged
from garbi_map.log.records import Stamps


@dataclass
class Piece:
    """A part of a file that is read at once: a chunk record, or (raw) records that lie outside of any chunk.

    begin, end  log times, ns
    indexes     channel -> offset of its message index record; empty where there is none
    channels    ids of the channels that have messages here; None: not known
    announced   begin and end that the chunk's own head must repeat, where an index announces them
    """

    offset: int
    length: int
    begin: int
    end: int
    raw: bool = False
    indexes: dict[int, int] = field(default_factory=dict)
    channels: frozenset[int] | None = None
    announced: tuple[int, int] | None = None


@dataclass
class Index:
    """One MCAP file, by content.

    pieces      in file order; counts: channel -> messages; times: channel -> log times (n,), of a walked file only
    attachments name -> (offset, length) of the record
    losses      what was found damaged, one line each
    sampled     only stretches of the file were looked at: `pieces` and `counts` are of these
    stretches   places in `pieces` at which one begins, but for the first
    """

    path: Path
    schemas: dict[int, mcap_records.Schema] = field(default_factory=dict)
    channels: dict[int, mcap_records.Channel] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    times: dict[int, list[Stamps]] | None = None
    attachments: dict[str, tuple[int, int]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)
    sampled: bool = False
    stretches: list[int] = field(default_factory=list)

    @cached_property
    def spans(self) -> Stamps:
        """First and last log time (n, 2) of the pieces, which do not change once a file's index has been read."""
        return np.array([(piece.begin, piece.end) for piece in self.pieces], np.uint64).astype(np.int64).reshape(-1, 2)

    def between(self, first: int | None, last: int | None) -> list[Piece]:
        """The pieces that may hold messages from one log time to another, ns, in file order."""
        here = np.ones(len(self.pieces), bool)
        if first is not None:
            here &= self.spans[:, 1] >= first
        if last is not None:
            here &= self.spans[:, 0] <= last
        return [self.pieces[place] for place in np.flatnonzero(here)]

    @property
    def begin(self) -> int:
        """First log time, ns."""
        return min(piece.begin for piece in self.pieces)

    @property
    def end(self) -> int:
        """Last log time, ns."""
        return max(piece.end for piece in self.pieces)

    def open(self) -> BinaryIO:
        """The file, to read."""
        try:
            return self.path.open("rb")
        except OSError as error:
            raise GarbiError(f"{self.path}: cannot be read: {error.strerror}") from error

    def topic(self, channel: int) -> str:
        """Name of a channel's topic."""
        return self.channels[channel].topic

    def topics_of(self, piece: Piece) -> str:
        """The topics of a piece for a human, '?' where they are not known."""
        named = {self.channels[channel].topic for channel in piece.channels or () if channel in self.channels}
        return ", ".join(sorted(named)) or "unknown topics"


def message_times(file: BinaryIO, piece: Piece) -> dict[int, Stamps]:
    """Log times of a piece's messages by channel, from its message index records; raises one of DAMAGE."""
    times = {}
    for channel, offset in piece.indexes.items():
        opcode, length = RECORD.unpack(chunks.read_at(file, offset, RECORD.size))
        if opcode != Opcode.MESSAGE_INDEX or length > piece.length + (1 << 20):
            raise Damaged("message index overwritten")
        content = chunks.read_at(file, offset + RECORD.size, length)
        stamps = np.frombuffer(content[6:], "<u8")[::2]
        if len(stamps) and not piece.begin <= stamps.min() <= stamps.max() <= piece.end:
            raise Damaged("message index overwritten")
        times[channel] = stamps.astype(np.int64)
    return times


def read_piece(file: BinaryIO, piece: Piece) -> memoryview:
    """The records of a piece, checksum validated; raises Damaged."""
    record = chunks.read_at(file, piece.offset, piece.length)
    if piece.raw:
        return record
    opcode, length = RECORD.unpack_from(record)
    if opcode != Opcode.CHUNK or length != piece.length - RECORD.size:
        raise Damaged("overwritten")
    content = record[RECORD.size :]
    if piece.announced not in (None, chunks.chunk_head(content)[:2]):
        raise Damaged("not the chunk that the index announces")
    return chunks.unpack_chunk(content)


def has_checksum(file: BinaryIO, piece: Piece) -> bool:
    """Whether damage inside a piece would be seen; raises Damaged."""
    if piece.raw:
        return False
    head = chunks.read_at(file, piece.offset + RECORD.size, chunks.CHUNK_HEAD.size)
    return bool(chunks.CHUNK_HEAD.unpack(head)[3])


def read_attachment(index: Index, name: str) -> bytes:
    """The content of an attachment, checksum validated; raises one of DAMAGE."""
    offset, length = index.attachments[name]
    with index.open() as file:
        return chunks.attachment_data(chunks.read_at(file, offset, length)[RECORD.size :])
