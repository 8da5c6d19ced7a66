"""A log as a whole: what is in it, its navigation as arrays, its images as a stream."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mcap.records import Schema

from garbi_map.errors import GarbiError
from garbi_map.log import chunks
from garbi_map.log.chunks import DAMAGE, RawMessage
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, decode_image, stamp_of
from garbi_map.log.index import Index, Piece, message_times, read_attachment, read_piece
from garbi_map.log.navigation import read_navigation
from garbi_map.log.records import Image, Navigation, Stamps
from garbi_map.log.settings import LogSettings
from garbi_map.log.types import log_types

REORDERED = 8  # images that wait for one with an earlier stamp


@dataclass(frozen=True)
class Topic:
    """type: ROS 2 message type; count: messages."""

    type: str
    count: int


class Log:
    """One or more MCAP files, read as one log; made by `open_log`. Nothing is kept in memory but the index.

    topics      name -> (type, count)
    begin_ns, end_ns  first and last header stamp
    losses      one line for everything that could not be read, so far; it grows while reading
    """

    def __init__(self, indexes: list[Index], settings: LogSettings) -> None:
        self.settings = settings
        self._indexes = indexes
        self._losses: dict[str, None] = {}
        self.topics = self._find_topics()
        self.begin_ns, self.end_ns, self._clock_offset = self._find_times()
        self.metadata = {name: record for index in indexes for name, record in index.metadata.items()}

    @property
    def losses(self) -> list[str]:
        """What could not be read so far, one line each."""
        return [*(line for index in self._indexes for line in index.losses), *self._losses]

    def lose(self, line: str) -> None:
        """Name a loss, once."""
        self._losses[line] = None

    @property
    def image_count(self) -> int:
        """Messages on the image topic."""
        topic = self.topics.get(self.settings.topics.image)
        return topic.count if topic else 0

    @property
    def rig_text(self) -> str | None:
        """The attached rig.yaml, None where the log has none or a damaged one."""
        for index in self._indexes:
            data = read_attachment(index, "rig.yaml")
            if data is not None:
                return data.decode(errors="replace")
        return None

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
        topic = self.settings.topics.image
        type_name = self.type_of("image", IMAGE_TYPES)
        if type_name is None:
            return
        types = log_types(())
        waiting: list[tuple[int, int, Image]] = []
        bad = late = 0
        last = -(1 << 63)
        for count, (_, message) in enumerate(self.messages({topic}, begin_ns, end_ns)):
            try:
                stamp = stamp_of(message.data)
                if (begin_ns is not None and stamp < begin_ns) or (end_ns is not None and stamp >= end_ns):
                    continue
                image = decode_image(types, type_name, message.data, max(message.log_time, message.publish_time))
            except BAD_MESSAGE:
                bad += 1
                continue
            if not self._near_arrival(image) or image.stamp_ns <= last:
                late += 1
                continue
            heapq.heappush(waiting, (image.stamp_ns, count, image))
            if len(waiting) > REORDERED:
                last, _, image = heapq.heappop(waiting)
                yield image
        for stamp, _, image in sorted(waiting, key=lambda entry: entry[:2]):
            if stamp > last:
                last = stamp
                yield image
            else:
                late += 1
        if bad:
            self.lose(f"{topic}: {bad} images are not readable messages")
        if late:
            self.lose(f"{topic}: {late} images left out: their stamps repeat, go back or are far from their arrival")

    def _near_arrival(self, image: Image) -> bool:
        offset = image.stamp_ns - image.arrival_ns - self._clock_offset
        return abs(offset) <= self.settings.clock_tolerance * 1e9

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
        for index in self._indexes:
            wanted = {number for number, channel in index.channels.items() if channel.topic in topics}
            pieces = [
                piece
                for piece in index.pieces
                if (piece.channels is None or wanted & piece.channels)
                and (first is None or piece.end >= first)
                and (last is None or piece.begin <= last)
            ]
            names = {number: index.topic(number) for number in wanted}
            for message in self._messages_of(index, pieces, wanted):
                yield names[message.channel], message

    def _messages_of(self, index: Index, pieces: list[Piece], wanted: set[int]) -> Iterator[RawMessage]:
        with index.path.open("rb") as file:
            for piece in pieces:
                try:
                    yield from chunks.messages(read_piece(file, piece), wanted)
                except DAMAGE as error:
                    self._lose_piece(index, piece, chunks.reason(error))

    def _lose_piece(self, index: Index, piece: Piece, why: str) -> None:
        start = self._indexes[0].begin
        begin, end = (piece.begin - start) * 1e-9, (piece.end - start) * 1e-9
        self.lose(f"{index.path.name}: {begin:.2f} s to {end:.2f} s lost ({why}): {index.topics_of(piece)}")

    def schemas(self) -> list[Schema]:
        """The message definitions of all files."""
        return [schema for index in self._indexes for schema in index.schemas.values()]

    def log_times(self) -> dict[str, Stamps]:
        """Log times of every message by topic, ascending, without reading the messages; from the message indexes."""
        times: dict[str, list[Stamps]] = {}
        for index in self._indexes:
            if index.times is not None:
                for channel, parts in index.times.items():
                    times.setdefault(index.topic(channel), []).extend(parts)
                continue
            with index.path.open("rb") as file:
                for piece in index.pieces:
                    try:
                        found = message_times(file, piece)
                    except DAMAGE as error:
                        self.lose(f"{index.path.name}: a message index is damaged ({chunks.reason(error)})")
                        continue
                    for channel, part in found.items():
                        if channel in index.channels:
                            times.setdefault(index.topic(channel), []).append(part)
        return {topic: np.sort(np.concatenate(parts)) for topic, parts in times.items()}

    def _find_topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for index in self._indexes:
            for number, channel in sorted(index.channels.items()):
                schema = index.schemas.get(channel.schema_id)
                known = topics.get(channel.topic)
                topics[channel.topic] = Topic(
                    schema.name if schema else (known.type if known else ""),
                    index.counts[number] + (known.count if known else 0),
                )
        return topics

    def _find_times(self) -> tuple[int, int, int]:
        """First and last header stamp, and the usual offset of the stamps' clock to that of the log."""
        self._clock_offset = 0
        stamped = set(self.settings.topics.model_dump().values()) - {self.settings.topics.tf_static, ""}
        first = self._stamps_of(self._indexes[0], stamped, forward=True)
        last = self._stamps_of(self._indexes[-1], stamped, forward=False)
        if not first or not last:
            begin = min(index.begin for index in self._indexes)
            return begin, max(piece.end for index in self._indexes for piece in index.pieces), 0
        offset = int(np.median([stamp - log_time for stamp, log_time in first]))
        near = self.settings.clock_tolerance * 1e9
        stamps = [stamp for stamp, log_time in [*first, *last] if abs(stamp - log_time - offset) <= near]
        return min(stamps), max(stamps), offset

    def _stamps_of(self, index: Index, topics: set[str], forward: bool) -> list[tuple[int, int]]:
        """(header stamp, log time) of the messages in the first or last piece that has any."""
        wanted = {number for number, channel in index.channels.items() if channel.topic in topics}
        for piece in sorted(index.pieces, key=lambda piece: piece.begin, reverse=not forward):
            found = []
            for message in self._messages_of(index, [piece], wanted):
                try:
                    found.append((stamp_of(message.data), message.log_time))
                except BAD_MESSAGE:
                    continue
            if found:
                return found
        return []
