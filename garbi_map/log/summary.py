"""The index of an MCAP file from the summary section at its end, which is all that an intact log needs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, cast

from mcap import records as mcap_records
from mcap.opcode import Opcode

from garbi_map.log import chunks
from garbi_map.log.chunks import DAMAGE, MAGIC, RECORD, Damaged, Unindexed
from garbi_map.log.index import Index, Piece, message_times

FOOTER = struct.Struct("<BQQQI")
CHUNK_INDEX = struct.Struct("<QQQQI")
MESSAGE_INDEX_OFFSET = struct.Struct("<HQ")


def index_from_summary(path: Path, file: BinaryIO, size: int) -> Index:
    """The index from the summary section; raises one of DAMAGE where there is none that can be trusted."""
    tail = chunks.read_at(file, max(size - FOOTER.size - len(MAGIC), 0), FOOTER.size + len(MAGIC))
    opcode, length, summary_start, _, crc = FOOTER.unpack_from(tail)
    if tail[FOOTER.size :] != MAGIC or opcode != Opcode.FOOTER or length != 20:
        raise Damaged("cut short")
    footer_start = size - FOOTER.size - len(MAGIC)
    if summary_start > footer_start:
        raise Damaged("it points outside the file")
    summary = chunks.read_at(file, summary_start, footer_start - summary_start) if summary_start else memoryview(b"")
    if crc and zlib.crc32(tail[: FOOTER.size - 4], zlib.crc32(summary)) != crc:
        raise Damaged("its checksum does not match")
    if not summary:
        raise Unindexed("no summary")
    index = Index(path)
    for opcode, content in chunks.records(summary):
        if opcode == Opcode.SCHEMA:
            schema = cast(mcap_records.Schema, chunks.parse(mcap_records.Schema, content))
            index.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = cast(mcap_records.Channel, chunks.parse(mcap_records.Channel, content))
            index.channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            statistics = cast(mcap_records.Statistics, chunks.parse(mcap_records.Statistics, content))
            index.counts.update(statistics.channel_message_counts)
        elif opcode == Opcode.CHUNK_INDEX:
            index.pieces.append(_piece(content, summary_start))
        elif opcode == Opcode.ATTACHMENT_INDEX:
            attachment = cast(mcap_records.AttachmentIndex, chunks.parse(mcap_records.AttachmentIndex, content))
            index.attachments[attachment.name] = (attachment.offset, attachment.length)
        elif opcode == Opcode.METADATA_INDEX:
            _read_metadata(
                index, file, cast(mcap_records.MetadataIndex, chunks.parse(mcap_records.MetadataIndex, content))
            )
    index.pieces.sort(key=lambda piece: piece.offset)
    if not index.pieces and index.counts.total():
        raise Unindexed("no chunk index")
    if not index.channels and index.pieces:
        raise Unindexed("it names no topics")
    if not index.counts:
        for piece in index.pieces:
            for number, times in message_times(file, piece).items():
                index.counts[number] += len(times)
    return index


def _piece(content: memoryview, data_end: int) -> Piece:
    """The piece of a ChunkIndex record, read by hand: a log of hours has tens of thousands of them."""
    begin, end, offset, length, size = CHUNK_INDEX.unpack_from(content)
    if offset + length > data_end:
        raise Damaged("it points outside the file")
    entries = content[CHUNK_INDEX.size : CHUNK_INDEX.size + size]
    if len(entries) != size:
        raise Damaged("a chunk index is cut short")
    indexes = dict(MESSAGE_INDEX_OFFSET.iter_unpack(entries))
    channels = frozenset(indexes) if indexes else None
    return Piece(offset, length, begin, end, indexes=indexes, channels=channels, announced=(begin, end))


def _read_metadata(index: Index, file: BinaryIO, entry: mcap_records.MetadataIndex) -> None:
    try:
        content = chunks.read_at(file, entry.offset, entry.length)[RECORD.size :]
        record = cast(mcap_records.Metadata, chunks.parse(mcap_records.Metadata, content))
        index.metadata[record.name] = record.metadata
    except DAMAGE:
        index.losses.append(f"{index.path.name}: metadata record {entry.name!r} is damaged")
