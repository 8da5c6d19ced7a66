"""The first seconds of a log, decoded in every way that its topics could be meant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from garbi_map.log import Log
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, Decoder, decode_image, decoders, frame_of
from garbi_map.log.foreign import HEADERLESS
from garbi_map.log.types import log_types

MOST_ROWS = 3000
SECONDS = 20.0


@dataclass
class Probe:
    """What a topic's first messages say, read as one role.

    values   (n, width) rows as the role's decoder gives them
    frame    of the last header, "" where there is none
    picture  "bgr8 768 x 576" of the first image
    joints   names that were met
    """

    role: str
    topic: str
    type: str
    rows: list[tuple[float, ...]] = field(default_factory=list)
    frame: str = ""
    picture: str = ""
    joints: set[str] = field(default_factory=set)

    @property
    def values(self) -> NDArray[np.float64]:
        """(n, width); (0, 0) where no message could be read."""
        return np.array(self.rows, float) if self.rows else np.empty((0, 0))


def probe(log: Log, seconds: float = SECONDS) -> list[Probe]:
    """Every topic in every role that its type allows, with the messages of the log's first seconds."""
    types = log_types(log.schemas())
    found: list[Probe] = []
    readers: dict[str, list[tuple[Probe, Decoder]]] = {}
    for topic, about in log.topics.items():
        joints: set[str] = set()
        for role, usable in decoders(types, "", joints).items():
            if about.count and about.type in usable and about.type in types.fielddefs:
                one = Probe(role, topic, about.type, joints=joints)
                found.append(one)
                readers.setdefault(topic, []).append((one, usable[about.type]))
        if about.count and about.type in IMAGE_TYPES:
            found.append(Probe("image", topic, about.type))
    pictures = {one.topic: one for one in found if one.role == "image"}
    for topic, message in log.messages(readers.keys() | pictures.keys(), None, log.begin_ns + round(seconds * 1e9)):
        if topic in pictures:
            _take_picture(pictures.pop(topic), types, message.data)
        for one, decode in readers.get(topic, ()):
            if len(one.rows) < MOST_ROWS:
                _take(one, decode, message.data)
    return found


def _take(one: Probe, decode: Decoder, data: memoryview) -> None:
    try:
        if one.type not in HEADERLESS:
            one.frame = frame_of(data)
        row = decode(data)
    except BAD_MESSAGE:
        return
    if row is not None:
        one.rows.append(tuple(row[1]))


def _take_picture(one: Probe, types: Typestore, data: memoryview) -> None:
    try:
        image = decode_image(types, one.type, data, 0)
    except BAD_MESSAGE:
        return
    one.picture = f"{image.encoding} {image.width} x {image.height}" if image.height else image.encoding
