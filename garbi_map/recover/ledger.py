"""The account of a recovery: what was written, what was damaged, and what is therefore missing, by topic and time."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode

from garbi_map.log.chunks import DAMAGE
from garbi_map.log.index import Index, Piece, message_times
from garbi_map.log.survey import Frame
from garbi_map.recover.report import Recovery, Stretch, TopicTally
from garbi_map.words import many


@dataclass
class _Damage:
    """A damaged stretch; begin, end: log times, ns; expected: messages by topic that it held; None: nothing tells."""

    frame: Frame
    why: str
    begin: int | None
    end: int | None
    kept: Counter[str]
    expected: Counter[str] | None
    indexed_to: int  # where the chunk's next message index record would begin


@dataclass
class Ledger:
    """Filled by a Source while it reads.

    index       the log's own, where it can be trusted: it says what there should be
    bare        chunks without a checksum; loose: messages outside of chunks
    moved       chunks stood in each other's place
    ended       the data are there to their end
    whole_holds whether the checksum of all data holds; None where there is none, or other damage makes it useless
    """

    index: Index | None
    proven: Counter[str] = field(default_factory=Counter)
    unproven: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    attachments: list[str] = field(default_factory=list)
    metadata: list[str] = field(default_factory=list)
    records_lost: list[str] = field(default_factory=list)
    repaired: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    damages: list[_Damage] = field(default_factory=list)
    bare: int = 0
    loose: int = 0
    moved: bool = False
    ended: bool = False
    whole_holds: bool | None = None
    _begun: int | None = None  # first log time of the last sound chunk, ns
    _first: int | None = None
    _last: int | None = None

    def wrote(self, topic: str, type_name: str, log_time: int, proven: bool) -> None:
        """A message was written."""
        (self.proven if proven else self.unproven)[topic] += 1
        self.types[topic] = type_name
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = log_time if self._last is None else max(self._last, log_time)

    def damaged(
        self,
        frame: Frame,
        why: str,
        times: tuple[int, int] | None = None,
        kept: Counter[str] | None = None,
        expected: Counter[str] | None = None,
    ) -> None:
        """A part of the file could not be read or trusted. times: log times, ns, of its first and last message."""
        begin, end = times if times else (self._last, None)
        self.damages.append(_Damage(frame, why, begin, end, kept or Counter(), expected, frame.end))

    def times_in(self, frame: Frame) -> tuple[int, int] | None:
        """First and last log time, ns, of the chunks that the index has in a stretch, None where it has none."""
        inside = self._inside(frame)
        return (min(piece.begin for piece in inside), max(piece.end for piece in inside)) if inside else None

    def _inside(self, frame: Frame) -> list[Piece]:
        pieces = self.index.pieces if self.index else ()
        return [piece for piece in pieces if frame.offset <= piece.offset < frame.end]

    def sound_from(self, log_time: int) -> None:
        """A sound chunk begins: damage before it, of unknown times, was before that."""
        if self._begun is not None and log_time < self._begun:
            back = (self._begun - log_time) * 1e-9
            self.notes.append(f"a chunk begins {back:.2f} s before the one in front of it; it stays where it was")
        self._begun = log_time
        for damage in reversed(self.damages):
            if damage.end is not None:
                break
            damage.end = max(log_time, damage.begin or log_time)

    def announce(self, frame: Frame, content: memoryview, topic: Callable[[int], str]) -> None:
        """A message index record tells what the damaged chunk before it held."""
        damage = self.damages[-1] if self.damages else None
        if damage is not None and damage.frame.opcode == Opcode.CHUNK and damage.indexed_to == frame.offset:
            channel, size = struct.unpack_from("<HI", content)
            damage.expected = (damage.expected or Counter()) + Counter({topic(channel): size // 16})
            damage.indexed_to = frame.end

    def repair(self, frame: Frame, place: int | None, size: int) -> None:
        """One bit of a chunk was turned, and its checksum holds again."""
        where = "of its checksum" if place is None else f"in byte {place:,} of its data"
        chance = f"by chance in 1 of {2**32 // (8 * size):,} damages that are more than a bit"
        self.repaired.append(f"byte {frame.offset:,}: one bit {where} was wrong and was turned; right, but {chance}")

    def close(self, size: int) -> None:
        """Nothing more comes: what the log's own index says is missing is looked up. size: bytes of the file."""
        if self.index is not None:
            for damage in self.damages:
                self._look_up(damage, self.index)
            for name in sorted(self.index.attachments.keys() - set(self.attachments)):
                self.records_lost.append(f"attachment {name!r}")
            for name in sorted(self.index.metadata.keys() - set(self.metadata)):
                self.records_lost.append(f"metadata {name!r}")
        elif not self.ended and not any(damage.frame.end == size for damage in self.damages):
            self.damaged(Frame(0, size, 0), "the file ends before the log does")
        if self.whole_holds is False:
            self.records_lost.append(
                "the checksum of the whole does not match: metadata, or messages outside of chunks, may be wrong"
            )

    def _look_up(self, damage: _Damage, index: Index) -> None:
        """Times and messages of the chunks that lay in a damaged stretch, from the index."""
        times = self.times_in(damage.frame)
        damage.begin, damage.end = times if times else (damage.begin, damage.end)
        if damage.expected is None:
            damage.expected = _indexed(index, self._inside(damage.frame))

    def report(self, source: Path, output: Path, size: int, index_damage: str) -> Recovery:
        """What became of the log. index_damage: why its own index was not to be trusted, "" where it was."""
        assert self._first is not None and self._last is not None
        lossy = [damage for damage in self.damages if damage.kept or damage.expected is None or damage.expected]
        return Recovery(
            source=str(source),
            output=str(output),
            bytes=size,
            begin_ns=self._first,
            end_ns=self._last,
            topics={topic: self._tally(topic, lossy) for topic in sorted(self._all_topics(lossy))},
            attachments=tuple(self.attachments),
            metadata=tuple(self.metadata),
            stretches=tuple(self._stretch(damage, self._first) for damage in lossy),
            records_lost=tuple(self.records_lost),
            repaired=tuple(self.repaired),
            notes=tuple(self._all_notes(index_damage)),
        )

    def _announced(self) -> Counter[str]:
        """Messages by topic as the log's own index counts them."""
        counts: Counter[str] = Counter()
        for channel, count in self.index.counts.items() if self.index else ():
            if self.index and channel in self.index.channels:
                counts[self.index.topic(channel)] += count
        return counts

    def _all_topics(self, lossy: Iterable[_Damage]) -> set[str]:
        expected = {topic for damage in lossy for topic in damage.expected or ()}
        return {*self.proven, *self.unproven, *expected, *self._announced()}

    def _tally(self, topic: str, lossy: list[_Damage]) -> TopicTally:
        kept = self.proven[topic] + self.unproven[topic]
        if self.index is not None:
            at_least = max(self._announced()[topic] - kept, 0)
        else:
            at_least = sum(max((damage.expected or Counter())[topic] - damage.kept[topic], 0) for damage in lossy)
        known = self.index is not None or all(damage.expected is not None for damage in lossy)
        return TopicTally(
            self.types.get(topic, ""),
            self.proven[topic],
            self.unproven[topic],
            at_least if known else None,
            at_least,
        )

    def _stretch(self, damage: _Damage, zero: int) -> Stretch:
        return Stretch(
            damage.frame.offset,
            damage.frame.length,
            damage.why,
            None if damage.begin is None else (damage.begin - zero) * 1e-9,
            None if damage.end is None else (damage.end - zero) * 1e-9,
            None if damage.expected is None else dict(damage.expected - damage.kept),
            dict(damage.kept),
        )

    def _all_notes(self, index_damage: str) -> Iterable[str]:
        if index_damage:
            yield f"its own index could not be used ({index_damage}); a new one was made"
        if self.moved:
            yield "chunks stood in each other's place; they are in their own again"
        yield from self.notes
        for damage in self.damages:
            if damage.expected is not None and not damage.expected and not damage.kept:
                where = f"byte {damage.frame.offset:,}, {damage.frame.length:,} bytes"
                yield f"{where}: damaged ({damage.why}), but no message was in them"
        if self.bare:
            yield f"{many(self.bare, 'chunk')} without a checksum: damage in them cannot be seen"
        if self.loose and not self.whole_holds:
            yield f"{many(self.loose, 'message')} outside of chunks, without a checksum: damage in them cannot be seen"
        if self.metadata and self.whole_holds is None:
            yield "metadata has no checksum of its own: damage in it cannot be seen"


def _indexed(index: Index, pieces: list[Piece]) -> Counter[str] | None:
    """Messages by topic in some pieces, from their message index records; None where those are damaged too."""
    counts: Counter[str] = Counter()
    try:
        with index.open() as file:
            for piece in pieces:
                if not piece.indexes:
                    return None
                for channel, times in message_times(file, piece).items():
                    counts[index.topic(channel)] += len(times)
    except (*DAMAGE, KeyError):
        return None
    return counts
