"""A damaged log while it is read: what is sound goes to the output as it is, what is only plausible under /unproven."""

from __future__ import annotations

import zlib
from collections import Counter
from itertools import islice
from typing import BinaryIO, cast

from mcap import records as mcap_records
from mcap.opcode import Opcode

from garbi_map.log import chunks, salvage
from garbi_map.log.chunks import DAMAGE, RECORD, ChunkHead, Damaged, RawMessage, reason
from garbi_map.log.index import Index
from garbi_map.log.survey import LOST, Frame, survey
from garbi_map.recover.ledger import Ledger
from garbi_map.recover.output import Output

UNPROVEN = "/unproven"
PROFILES = ("ros1", "ros2")
NEAR_BEGIN = 100  # records among which the first chunk is looked for
BLOCK, LOST_BLOCK = 1 << 20, 1 << 26  # bytes that are read at once
DAY = 86_400_000_000_000  # ns; a chunk does not hold more


class Source:
    """Takes the records of a log one by one and passes on what can be read.

    index: the log's own, where it can be trusted; else None.
    """

    def __init__(self, file: BinaryIO, size: int, index: Index | None, out: BinaryIO) -> None:
        self.file, self.size, self.index = file, size, index
        self.ledger = Ledger(index)
        self.output = Output(out, *self._made_as())
        self._schemas = dict(index.schemas) if index else {}
        self._channels = dict(index.channels) if index else {}
        self._numbers: dict[tuple[int, bool], tuple[mcap_records.Channel, int]] = {}
        self._chunked = bool(index and any(not piece.raw for piece in index.pieces))
        self._checksums = False
        self._seen: set[tuple[int, int, int, int]] = set()
        self._waiting: list[Frame] = []  # chunks with topics whose names may still come

    def _made_as(self) -> tuple[str, bytes]:
        """Profile and compression of the log."""
        profile, compression = "", b"zstd"
        for frame in islice(survey(self.file, self.size), NEAR_BEGIN):
            try:
                if frame.opcode == Opcode.HEADER:
                    header = cast(mcap_records.Header, chunks.parse(mcap_records.Header, self._content(frame)))
                    profile = header.profile if header.profile in PROFILES else ""
                elif frame.opcode == Opcode.CHUNK:
                    return profile, chunks.chunk_head(self._content(frame), whole=False).compression
            except DAMAGE:
                continue
        return profile, compression

    def take(self, frame: Frame) -> None:
        """Take in a record, or what is none."""
        try:
            if frame.opcode == LOST:
                self._lost(frame)
            elif frame.opcode == Opcode.CHUNK:
                self._chunk(frame)
            elif frame.opcode == Opcode.MESSAGE_INDEX:
                self.ledger.announce(frame, self._content(frame), self._topic)
            elif frame.opcode == Opcode.MESSAGE:
                self._loose(chunks.raw_message(self._content(frame)))
            elif frame.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(frame.opcode, self._content(frame), protected=False)
            elif frame.opcode == Opcode.ATTACHMENT:
                self._attachment(frame)
            elif frame.opcode == Opcode.METADATA:
                record = cast(mcap_records.Metadata, chunks.parse(mcap_records.Metadata, self._content(frame)))
                self.output.metadata(record)
                self.ledger.metadata.append(record.name)
            elif frame.opcode == Opcode.DATA_END:
                self._end(frame)
        except DAMAGE as error:
            self.ledger.damaged(frame, reason(error))

    def finish(self) -> None:
        """Nothing more comes."""
        for frame in self._waiting:
            try:
                self._chunk(frame, last=True)
            except DAMAGE as error:
                self.ledger.damaged(frame, reason(error))
        self.ledger.close(self.size)
        self.output.finish()

    def _content(self, frame: Frame) -> memoryview:
        return chunks.read_at(self.file, frame.offset + RECORD.size, frame.length - RECORD.size)

    def _topic(self, channel: int) -> str:
        return self._channels[channel].topic if channel in self._channels else "a topic whose name was lost"

    def _chunk(self, frame: Frame, last: bool = False) -> None:
        """Take in a chunk; unless it is the last chance, topics whose names are not known yet are waited for."""
        self._chunked = True
        content = self._content(frame)
        head = chunks.chunk_head(content, whole=False)
        try:
            if frame.why:
                raise Damaged("the file ends inside a chunk; what came after is not known")
            if self._checksums and not head.crc:
                raise Damaged("checksum overwritten")
            if self._pass_on(frame, chunks.unpack_chunk(content), last):
                self.ledger.bare += not head.crc
            self._checksums |= bool(head.crc)
        except DAMAGE as error:
            if not self._turned_bit(frame, head, content, last):
                self._damaged_chunk(frame, head, content, reason(error))

    def _turned_bit(self, frame: Frame, head: ChunkHead, content: memoryview, last: bool) -> bool:
        """Whether one wrong bit was all, and the chunk is dealt with."""
        data = salvage.decoded_part(content)
        if not head.crc or len(data) != head.size or frame.why:
            return False
        found = salvage.repaired(data, head.crc)
        try:
            if found is not None and self._pass_on(frame, found.data, last):
                self.ledger.repair(frame, found.place, len(data))
        except DAMAGE:
            return False
        return found is not None

    def _damaged_chunk(self, frame: Frame, head: ChunkHead, content: memoryview, why: str) -> None:
        data = salvage.decoded_part(content)
        known = set(self._channels)
        for opcode, record in salvage.definitions(data):
            self._define(opcode, record, protected=False)
        for number in sorted(self._channels.keys() - known):
            self.ledger.notes.append(f"the name of {self._topic(number)} is from a damaged chunk, nothing proves it")
        times = (head.begin, head.end) if head.begin <= head.end < head.begin + DAY else None
        self.ledger.damaged(frame, why, times, self._plausible(data, times))

    def _lost(self, frame: Frame) -> None:
        """Bytes that are no record: the inside of a chunk that lost its head, which is readable where it was not packed."""
        times = self.ledger.times_in(frame)
        kept: Counter[str] = Counter()
        for start in range(frame.offset, frame.end if times else frame.offset, LOST_BLOCK):
            block = chunks.read_at(self.file, start, min(LOST_BLOCK, frame.end - start))
            kept += self._plausible(block, times)
        self.ledger.damaged(frame, frame.why, times, kept)

    def _plausible(self, data: memoryview, times: tuple[int, int] | None) -> Counter[str]:
        """Write what looks like messages of these times as unproven; how many of each topic."""
        kept: Counter[str] = Counter()
        for message in salvage.messages(data, self._channels, *times) if times else ():
            self._write(message, proven=False)
            kept[self._topic(message.channel)] += 1
        return kept

    def _pass_on(self, frame: Frame, buffer: memoryview, last: bool) -> bool:
        """Write a sound chunk's messages; False where it waits.

        Raises Damaged, before anything is written, where its records do not fit.
        """
        for opcode, content in chunks.records(buffer):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content, protected=True)
        messages = list(chunks.messages(buffer, range(1 << 16)))
        nameless = Counter(message.channel for message in messages if not self._named(message.channel))
        if nameless and not last:
            self._waiting.append(frame)
            return False
        stamp = (zlib.crc32(buffer), len(buffer), messages[0].log_time, messages[-1].log_time) if messages else None
        if stamp in self._seen:
            self.ledger.notes.append(f"byte {frame.offset:,}: a chunk that stands elsewhere too, written once")
            return True
        if stamp is not None:
            self._seen.add(stamp)
            self.ledger.sound_from(messages[0].log_time)
        for message in messages:
            if message.channel in self._channels:
                self._write(message, proven=True)
        lost = Counter({self._topic(number): n for number, n in nameless.items() if number not in self._channels})
        if lost:
            self.ledger.damaged(frame, "the name of a topic was lost", expected=lost)
        return True

    def _loose(self, message: RawMessage) -> None:
        """A message outside of chunks is proven by nothing; where there are chunks, it is the debris of one."""
        if message.channel not in self._channels:
            raise Damaged("message of an unknown topic")
        self._write(message, proven=not self._chunked)
        self.ledger.loose += 1

    def _write(self, message: RawMessage, proven: bool) -> None:
        channel = self._channels[message.channel]
        known, number = self._numbers.get((message.channel, proven), (None, 0))
        if known is not channel:
            prefix = "" if proven else UNPROVEN
            number = self.output.channel(channel, self._schemas.get(channel.schema_id), prefix)
            self._numbers[message.channel, proven] = channel, number
        self.output.message(number, message)
        self.ledger.wrote(channel.topic, self._type(channel), message.log_time, proven)

    def _named(self, channel: int) -> bool:
        """Whether both the topic and its type are known by now."""
        known = self._channels.get(channel)
        return known is not None and (known.schema_id == 0 or known.schema_id in self._schemas)

    def _type(self, channel: mcap_records.Channel) -> str:
        return self._schemas[channel.schema_id].name if channel.schema_id in self._schemas else ""

    def _define(self, opcode: int, content: memoryview, protected: bool) -> None:
        """Take in a schema or a channel; one that a checksum protects wins."""
        if opcode == Opcode.SCHEMA:
            schema = cast(mcap_records.Schema, chunks.parse(mcap_records.Schema, content))
            if schema.id not in self._schemas or (protected and schema != self._schemas[schema.id]):
                self._schemas[schema.id] = schema
        else:
            channel = cast(mcap_records.Channel, chunks.parse(mcap_records.Channel, content))
            if channel.id not in self._channels or (protected and channel != self._channels[channel.id]):
                self._channels[channel.id] = channel

    def _attachment(self, frame: Frame) -> None:
        content = self._content(frame)
        record = cast(mcap_records.Attachment, chunks.parse(mcap_records.Attachment, content))
        try:
            chunks.attachment_data(content)
        except DAMAGE as error:
            self.ledger.records_lost.append(f"attachment {record.name!r}: {reason(error)}")
            return
        if record.name not in self.ledger.attachments:
            self.output.attachment(record)
            self.ledger.attachments.append(record.name)

    def _end(self, frame: Frame) -> None:
        """All data before the end may have a checksum; it is what protects metadata and messages outside of chunks."""
        crc = int.from_bytes(self._content(frame), "little")
        self.ledger.ended = True
        spoiled = self.ledger.damages or self.ledger.repaired or self.ledger.moved
        if not crc or spoiled or not (self.ledger.metadata or self.ledger.loose):
            return
        found = 0
        for start in range(0, frame.offset, BLOCK):
            found = zlib.crc32(chunks.read_at(self.file, start, min(BLOCK, frame.offset - start)), found)
        self.ledger.whole_holds = found == crc
