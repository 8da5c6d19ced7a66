"""The images of a log as a stream in the order of their stamps."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import TYPE_CHECKING

from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, decode_image, stamp_of
from garbi_map.log.records import Image
from garbi_map.log.types import log_types
from garbi_map.words import many

if TYPE_CHECKING:
    from garbi_map.log.reader import Log

WAITING = 8  # images that wait for one with an earlier stamp
UNREADABLE = "left out: not a readable message"
UNBELIEVED = "left out: a stamp repeats, goes back or is far from the arrival"


def read_images(log: Log, begin_ns: int | None, end_ns: int | None) -> Iterator[Image]:
    """See Log.images."""
    type_name = log.type_of("image", IMAGE_TYPES)
    if type_name is None:
        return
    left_out: Counter[str] = Counter()
    yield from _ascending(_decoded(log, type_name, begin_ns, end_ns, left_out), log.settings.reorder * 1e9, left_out)
    for why, number in left_out.items():
        log.lose(f"{log.settings.topics.image}: {many(number, 'image')} {why}")


def _decoded(
    log: Log, type_name: str, begin_ns: int | None, end_ns: int | None, left_out: Counter[str]
) -> Iterator[Image]:
    types = log_types(())
    for _, message in log.messages({log.settings.topics.image}, begin_ns, end_ns):
        try:
            stamp = stamp_of(message.data)
            if (begin_ns is not None and stamp < begin_ns) or (end_ns is not None and stamp >= end_ns):
                continue
            image = decode_image(types, type_name, message.data, message.arrival(stamp))
        except BAD_MESSAGE:
            left_out[UNREADABLE] += 1
            continue
        if log.near_arrival(image.stamp_ns, image.arrival_ns):
            yield image
        else:
            left_out[UNBELIEVED] += 1


def _ascending(images: Iterator[Image], reorder_ns: float, left_out: Counter[str]) -> Iterator[Image]:
    """Sort neighbours; leave out what repeats a stamp or goes back farther, judged by the median of those that wait, as
    the newest may itself be the wild one."""
    waiting: list[tuple[int, int, Image]] = []
    order = count()
    last = -(1 << 63)

    def release() -> Iterator[Image]:
        nonlocal last
        stamp, _, image = heapq.heappop(waiting)
        if stamp > last:
            last = stamp
            yield image
        else:
            left_out[UNBELIEVED] += 1

    for image in images:
        usual = sorted(entry[0] for entry in waiting)[len(waiting) // 2] if waiting else image.stamp_ns
        if image.stamp_ns <= last or image.stamp_ns < usual - reorder_ns:
            left_out[UNBELIEVED] += 1
            continue
        heapq.heappush(waiting, (image.stamp_ns, next(order), image))
        if len(waiting) > WAITING:
            yield from release()
    while waiting:
        yield from release()
