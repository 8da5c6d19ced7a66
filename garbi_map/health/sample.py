"""A few short stretches of a log, evenly spread, with everything that was recorded in them."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from garbi_map.log import Image, Log
from garbi_map.log.chunks import RawMessage
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, WIDTHS, Decoder, decode_image, decoders, stamp_of
from garbi_map.log.records import Floats, Stamps
from garbi_map.log.types import log_types

STRETCHES = 48
LONGEST, SHORTEST = 1.0, 0.2  # s
SLOWEST = 5.0  # s of a stretch in which there shall be two images
BYTES = 256 << 20  # of the log that all stretches together may cover, whatever its rate
IMAGES = 2  # of a stretch that are kept


@dataclass
class Said:
    """What a role's topic said in a stretch, in the order of recording: stamps and arrivals (n,) ns, values (n, width);
    of images no values."""

    stamps: array[int] = field(default_factory=lambda: array("q"))
    arrivals: array[int] = field(default_factory=lambda: array("q"))
    rows: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def stamp_ns(self) -> Stamps:
        """(n,) ns."""
        return np.array(self.stamps, np.int64)

    @property
    def arrival_ns(self) -> Stamps:
        """(n,) ns."""
        return np.array(self.arrivals, np.int64)

    @property
    def values(self) -> Floats:
        """(n, width)."""
        return np.array(self.rows, float)


@dataclass
class Stretch:
    """time: of its middle, s since the log's begin; said: by role; images: the first few."""

    time: float
    said: dict[str, Said] = field(default_factory=dict)
    images: list[Image] = field(default_factory=list)


def stretches(log: Log, joint: str, count: int = STRETCHES) -> tuple[list[Stretch], float]:
    """Up to `count` stretches and their length, s; a log that is shorter than all of them is covered whole.

    joint: the encoder's name among the joints.
    """
    begin, end = log.recorded_span()
    duration = max((end - begin) * 1e-9, 1e-3)
    rate = log.size / duration
    two_images = min(2.2 * duration / max(log.image_count, 1), SLOWEST)
    length = max(float(np.clip(BYTES / (count * rate), SHORTEST, LONGEST)), two_images)
    count = max(min(count, int(duration / length)), 1)
    length = min(length, duration / count)
    readers, pictures = _readers(log, joint)
    found = []
    for first in _starts(log, begin, duration - length, count):
        last = int(first + length * 1e9)
        one = Stretch((int(first) + last - 2 * begin) * 0.5e-9)
        for topic, message in log.recorded({*readers, *pictures}, int(first), last):
            if not first <= message.log_time <= last:
                continue
            if topic in pictures:
                _take_image(one, pictures[topic], message)
            for role, decode in readers.get(topic, ()):
                _take(one, role, decode, message, log)
        found.append(one)
    return found, length


def _starts(log: Log, begin: int, duration: float, count: int) -> Floats:
    """Log times, ns, at which stretches begin: evenly spread over what is known of the log."""
    if not any(index.sampled for index in log.indexes):
        return begin + np.linspace(0, max(duration, 0), count) * 1e9
    known = []
    for index in log.indexes:
        firsts = [0, *(place for place in index.stretches if place < len(index.pieces))]
        known.append(index.spans[firsts, 0])
    starts = np.unique(np.concatenate(known))
    return starts[np.linspace(0, len(starts) - 1, min(count, len(starts))).astype(int)].astype(float)


def _readers(log: Log, joint: str) -> tuple[dict[str, list[tuple[str, Decoder]]], dict[str, str]]:
    """topic -> its roles and their decoders; topic -> type of images."""
    types = log_types(log.schemas())
    readers: dict[str, list[tuple[str, Decoder]]] = {}
    for role, usable in decoders(types, joint, set()).items():
        topic = getattr(log.settings.topics, role)
        if topic in log.topics and log.topics[topic].type in usable:
            readers.setdefault(topic, []).append((role, usable[log.topics[topic].type]))
    image = log.topics.get(log.settings.topics.image)
    pictures = {log.settings.topics.image: image.type} if image and image.type in IMAGE_TYPES else {}
    return readers, pictures


def _take(one: Stretch, role: str, decode: Decoder, message: RawMessage, log: Log) -> None:
    try:
        row = decode(message.data)
    except BAD_MESSAGE:
        return
    if row is None or len(row[1]) != WIDTHS[role]:
        return
    stamp = log.stamp_of_recording(message.log_time) if row[0] is None else row[0]
    said = one.said.setdefault(role, Said())
    scale = getattr(log.settings.scale, role, 1.0)
    said.stamps.append(stamp)
    said.arrivals.append(message.arrival(stamp))
    said.rows.append(tuple(scale * value for value in row[1]))


def _take_image(one: Stretch, type_name: str, message: RawMessage) -> None:
    try:
        stamp = stamp_of(message.data)
        said = one.said.setdefault("image", Said())
        said.stamps.append(stamp)
        said.arrivals.append(message.arrival(stamp))
        if len(one.images) < IMAGES:
            one.images.append(decode_image(log_types(()), type_name, message.data, said.arrivals[-1]))
    except BAD_MESSAGE:
        return


def of_role(found: list[Stretch], role: str, least: int = 1) -> Iterator[tuple[Stretch, Said]]:
    """The stretches in which a role said at least so much."""
    for one in found:
        if role in one.said and len(one.said[role].stamps) >= least:
            yield one, one.said[role]
