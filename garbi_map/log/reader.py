"""A log as a whole: what is in it, its navigation as arrays, its images as a stream."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from mcap.records import Schema

from garbi_map.errors import GarbiError
from garbi_map.log import chunks
from garbi_map.log.chunks import DAMAGE, RawMessage
from garbi_map.log.decode import BAD_MESSAGE, stamp_of
from garbi_map.log.foreign import HEADERLESS
from garbi_map.log.images import read_images
from garbi_map.log.index import Index, Piece, has_checksum, message_times, read_attachment, read_piece
from garbi_map.log.navigation import read_navigation
from garbi_map.log.records import Image, Navigation, Stamps
from garbi_map.log.settings import LogSettings
from garbi_map.words import printable

Stamped = list[tuple[int, RawMessage]]
OTHER_CLOCK = 1_000_000_000  # ns between stamps and log times, more than which no recorder is late


@dataclass(frozen=True)
class Topic:
    """type: ROS 2 message type; count: messages."""

    type: str
    count: int


class Log:
    """One or more MCAP files, read as one log; made by `open_log`. Nothing is kept in memory but the index.

    topics      name -> (type, count)
    begin_ns, end_ns  first and last header stamp
    rig_text    the attached rig.yaml, None where the log has none or a damaged one
    metadata    the records of names and texts, by name
    damaged     begin and end, ns, of the stretches that could not be read, so far; it grows while reading
    losses      one line for everything that could not be read, so far; it grows while reading
    remarks     one line for everything that was read but not taken as it is, so far; it grows while reading
    """

    def __init__(self, indexes: list[Index], settings: LogSettings) -> None:
        self.settings = settings
        self.indexes = indexes
        self._losses: dict[str, None] = {}
        self._remarks: dict[str, None] = {}
        self.damaged: list[tuple[int, int]] = []
        self.topics = self._find_topics()
        self._clock_offset = self._arrival_offset = 0
        self.begin_ns, self.end_ns = self._find_times()
        self.rig_text = self._find_rig()
        self.metadata = {name: record for index in indexes for name, record in index.metadata.items()}

    @property
    def losses(self) -> list[str]:
        """What could not be read so far, one line each."""
        return [printable(line) for line in (*(line for index in self.indexes for line in index.losses), *self._losses)]

    def lose(self, line: str) -> None:
        """Name a loss, once."""
        self._losses[line] = None

    @property
    def remarks(self) -> list[str]:
        """What was read but not taken as it is, so far, one line each."""
        return list(self._remarks)

    def remark(self, line: str) -> None:
        """Say how something was read, once."""
        self._remarks[line] = None

    @property
    def name(self) -> str:
        """The names of the files."""
        return ", ".join(index.path.name for index in self.indexes)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(index.path.stat().st_size for index in self.indexes)

    @property
    def image_count(self) -> int:
        """Messages on the image topic."""
        topic = self.topics.get(self.settings.topics.image)
        return topic.count if topic else 0

    def navigation(
        self, begin_ns: int | None = None, end_ns: int | None = None, joint: str = "laser_joint"
    ) -> Navigation:
        """Everything but the images, by ascending stamps, from begin_ns to before end_ns.

        joint is the encoder's name among the joints; where the log has only one, that one is taken. Both /usbl/pose and
        /navsat/fix may be there: the former wins. Raises GarbiError on a topic whose type cannot be used.
        """
        return read_navigation(self, begin_ns, end_ns, joint)

    def images(self, begin_ns: int | None = None, end_ns: int | None = None) -> Iterator[Image]:
        """The images from begin_ns to before end_ns as a stream, in the order of their stamps.

        Raises GarbiError where the image topic has a type that is no image; where there are no images, nothing comes.
        """
        return read_images(self, begin_ns, end_ns)

    def near_arrival(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Whether a stamp is believable: its distance from its arrival is about the usual one."""
        return abs(stamp_ns - arrival_ns - self._arrival_offset) <= self.settings.clock_tolerance * 1e9

    def stamp_of_recording(self, log_time: int) -> int:
        """The header stamp that stands for a log time: itself, unless the stamps come from another clock."""
        return log_time + (self._clock_offset if abs(self._clock_offset) > OTHER_CLOCK else 0)

    def type_of(self, role: str, usable: tuple[str, ...]) -> str | None:
        """The type of the topic that plays a role, None where the log has none; GarbiError where it is not usable."""
        name: str = getattr(self.settings.topics, role)
        topic = self.topics.get(name)
        if topic is None or topic.count == 0:
            return None
        if topic.type not in usable:
            raise GarbiError(
                f"topic {name}: type {topic.type} cannot be used as {role}; wanted is {' or '.join(usable)}"
            )
        return topic.type

    def messages(
        self, topics: set[str], begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[str, RawMessage]]:
        """(topic, message) of some topics in the order of recording, checksums validated; damage goes into `losses`.

        begin_ns, end_ns (header stamps) save reading: what is clearly outside is left out, the caller selects.
        """
        margin = int(self.settings.clock_tolerance * 1e9)
        first = None if begin_ns is None else begin_ns - self._clock_offset - margin
        last = None if end_ns is None else end_ns - self._clock_offset + margin
        return self.recorded(topics, first, last)

    def recorded(self, topics: set[str], first: int | None, last: int | None) -> Iterator[tuple[str, RawMessage]]:
        """(topic, message) of some topics in the order of recording, from every piece of the log that reaches into the
        time from `first` to `last`, log times, ns."""
        for index in self.indexes:
            wanted = {number for number, channel in index.channels.items() if channel.topic in topics}
            pieces = [
                piece for piece in index.between(first, last) if piece.channels is None or wanted & piece.channels
            ]
            names = {number: index.topic(number) for number in wanted}
            for message in self._messages_of(index, pieces, wanted):
                yield names[message.channel], message

    def verify(self) -> bool:
        """Read every byte that holds a message; what fails its checksum goes into `losses`. False where some part of
        the log carries no checksum, so that damage there cannot be seen."""
        protected = True
        for index in self.indexes:
            with index.open() as file:
                for piece in index.pieces:
                    try:
                        protected &= has_checksum(file, piece)
                        read_piece(file, piece)
                    except (*DAMAGE, OSError) as error:
                        self._lose_piece(index, piece, chunks.reason(error))
        return protected

    def _messages_of(self, index: Index, pieces: list[Piece], wanted: set[int]) -> Iterator[RawMessage]:
        with index.open() as file:
            for piece in pieces:
                try:
                    yield from chunks.messages(read_piece(file, piece), wanted)
                except (*DAMAGE, OSError) as error:
                    self._lose_piece(index, piece, chunks.reason(error))

    def _lose_piece(self, index: Index, piece: Piece, why: str) -> None:
        start = self.indexes[0].begin
        begin, end = (piece.begin - start) * 1e-9, (piece.end - start) * 1e-9
        if (piece.begin, piece.end) not in self.damaged:
            self.damaged.append((piece.begin, piece.end))
        self.lose(f"{index.path.name}: {begin:.2f} s to {end:.2f} s lost ({why}): {index.topics_of(piece)}")

    def schemas(self) -> list[Schema]:
        """The message definitions of all files."""
        return [schema for index in self.indexes for schema in index.schemas.values()]

    def log_times(self) -> dict[str, Stamps]:
        """Log times of every message by topic, ascending, without reading the messages; from the message indexes."""
        times: dict[str, list[Stamps]] = {}
        for index in self.indexes:
            if index.times is not None:
                for channel, parts in index.times.items():
                    times.setdefault(index.topic(channel), []).extend(parts)
                continue
            with index.open() as file:
                for piece in index.pieces:
                    try:
                        found = message_times(file, piece)
                    except (*DAMAGE, OSError) as error:
                        self.lose(f"{index.path.name}: a message index is damaged ({chunks.reason(error)})")
                        continue
                    for channel, part in found.items():
                        if channel in index.channels:
                            times.setdefault(index.topic(channel), []).append(part)
        return {topic: np.sort(np.concatenate(parts)) for topic, parts in times.items()}

    def _find_rig(self) -> str | None:
        for index in self.indexes:
            if "rig.yaml" in index.attachments:
                try:
                    return read_attachment(index, "rig.yaml").decode()
                except DAMAGE:
                    self.lose(f"{index.path.name}: the attached rig.yaml is damaged")
        return None

    def _find_topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for index in self.indexes:
            for number, channel in sorted(index.channels.items()):
                schema = index.schemas.get(channel.schema_id)
                known = topics.get(channel.topic)
                name = schema.name if schema else (known.type if known else "")
                if channel.message_encoding not in ("cdr", ""):
                    name = f"{name} as {channel.message_encoding}"  # which no role can use, and says so
                topics[channel.topic] = Topic(name, index.counts[number] + (known.count if known else 0))
        return topics

    def _find_times(self) -> tuple[int, int]:
        """First and last header stamp; learns the usual offsets of the stamps' clock to log times and arrivals."""
        topics = set(self.settings.topics.model_dump().values()) - {self.settings.topics.tf_static, ""}
        stamped = {topic for topic in topics & self.topics.keys() if self.topics[topic].type not in HEADERLESS}
        first, last = self._first_and_last(stamped)
        if first:
            self._clock_offset = int(np.median([stamp - message.log_time for stamp, message in first]))
            self._arrival_offset = int(np.median([stamp - message.arrival(stamp) for stamp, message in first]))
        stamps = [stamp for stamp, message in first + last if self.near_arrival(stamp, message.arrival(stamp))]
        return (min(stamps), max(stamps)) if stamps else self.recorded_span()

    def recorded_span(self) -> tuple[int, int]:
        """First and last log time."""
        return self.indexes[0].begin, max(index.end for index in self.indexes)

    def _first_and_last(self, topics: set[str]) -> tuple[Stamped, Stamped]:
        """Messages of some topics near the begin and near the end of the log."""
        first = self._stamped(self.indexes[0], topics, forward=True)
        return first, self._stamped(max(self.indexes, key=lambda index: index.end), topics, forward=False)

    def _stamped(self, index: Index, topics: set[str], forward: bool) -> Stamped:
        """(header stamp, message) of some topics in the first or last piece that has any."""
        wanted = {number for number, channel in index.channels.items() if channel.topic in topics}
        for piece in sorted(index.pieces, key=lambda piece: piece.begin, reverse=not forward):
            found = with_stamps(self._messages_of(index, [piece], wanted))
            if found:
                return found
        return []


def with_stamps(messages: Iterable[RawMessage]) -> Stamped:
    """(header stamp, message) of those that have a header."""
    found = []
    for message in messages:
        try:
            found.append((stamp_of(message.data), message))
        except BAD_MESSAGE:
            continue
    return found
