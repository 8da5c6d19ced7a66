"""A recorded log as a feed: the same images and readings, each at the moment it arrived."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from behaviours.arrivals import Arrivals
from behaviours.feed import Intake, Seen, Sighting
from behaviours.settings import FeedSettings
from garbi_map.errors import GarbiError
from garbi_map.log import Image, Log, Navigation
from garbi_map.rig import Rig, parse_rig
from garbi_map.stripe import ImageLosses, StripeDetector, StripeSettings, detect_all

STRETCH_NS = 2_000_000_000  # of readings that are taken in at once


class LogFeed:
    """See `behaviours.feed.Feed`. begin_ns, end_ns: arrivals of the first and the last thing in the log.

    The laser's angle of an image is the one that the encoder's readings gave when the image arrived. Raises GarbiError
    where there is no rig file, no image, or neither an encoder nor a fixed angle.
    """

    def __init__(
        self, log: Log, settings: FeedSettings, stripe: StripeSettings, rig: Rig | None = None, workers: int = 2
    ) -> None:
        if rig is None:
            if log.rig_text is None:
                raise GarbiError("no rig file is attached to the log; give one with --rig")
            rig = parse_rig(log.rig_text, "attached rig.yaml")
        if log.image_count == 0:
            raise GarbiError(f"no images on {log.settings.topics.image}; name their topic in the configuration")
        self.rig, self.losses = rig, ImageLosses()
        readings = log.navigation(joint=rig.laser.joint)
        if readings.encoder is None and rig.laser.fixed_angle is None:
            raise GarbiError("the log has no encoder, and the rig file gives no laser.fixed_angle")
        self._readings = {
            item.name: _by_arrival(getattr(readings, item.name))
            for item in fields(readings)
            if getattr(readings, item.name) is not None and item.name not in ("mounts", "fixes")
        }
        self._taken = dict.fromkeys(self._readings, 0)
        self._intake = Intake(rig, readings.mounts, settings)
        self.mount = self._intake.mount
        self._arrivals = Arrivals(rig.laser.fixed_angle, settings)
        self._encoder_next = 0
        detector = StripeDetector(stripe, rig)
        images = self._images(log)
        self._sightings = self._found(images, detector, workers)
        self._next = next(self._sightings, None)
        arrivals = [record.arrival_ns[[0, -1]] for record in self._readings.values() if len(record.arrival_ns)]
        first = [self._next.known_ns] if self._next else []
        self.begin_ns = int(min([*first, *(int(pair[0]) for pair in arrivals)], default=log.begin_ns))
        self._end_ns = int(max((int(pair[1]) for pair in arrivals), default=self.begin_ns))

    def over(self, now_ns: int) -> bool:
        """Whether nothing comes after now."""
        return self._next is None and now_ns >= self._end_ns

    def until(self, now_ns: int) -> Seen:
        """See `Feed`."""
        for kind, record in self._readings.items():
            start = self._taken[kind]
            if start < len(record.arrival_ns) and record.arrival_ns[start] <= now_ns:
                stop = int(np.searchsorted(record.arrival_ns, now_ns + STRETCH_NS, side="right"))
                self._intake.read(Navigation(**{kind: _rows(record, slice(start, stop))}))
                self._taken[kind] = stop
        while self._next is not None and self._next.known_ns <= now_ns:
            self._intake.sight(self._next)
            self._next = next(self._sightings, None)
        return self._intake.until(now_ns)

    def _images(self, log: Log) -> Iterator[Image]:
        """The images, each with what was known of the laser's angle when it arrived noted under its stamp."""
        for image in log.images():
            arrival = max(image.arrival_ns, image.stamp_ns)
            encoder = self._readings.get("encoder")
            if encoder is not None:
                stop = int(np.searchsorted(encoder.arrival_ns, arrival, side="right"))
                for row in range(self._encoder_next, stop):
                    self._arrivals.encoder(int(encoder.stamp_ns[row]), float(encoder.angle[row]))
                self._encoder_next = max(stop, self._encoder_next)
            if self._arrivals.image(image):
                yield image

    def _found(self, images: Iterator[Image], detector: StripeDetector, workers: int) -> Iterator[Sighting]:
        for stripe in detect_all(images, detector, self._arrivals.alpha, workers, self.losses):
            yield self._arrivals.sighting(stripe)


def _rows(record: Any, rows: Any) -> Any:
    arrays = {
        item.name: getattr(record, item.name)[rows]
        for item in fields(record)
        if isinstance(getattr(record, item.name), np.ndarray)
    }
    return replace(record, **arrays)


def _by_arrival(record: Any) -> Any:
    order = np.argsort(record.arrival_ns, kind="stable")
    return _rows(record, order)
