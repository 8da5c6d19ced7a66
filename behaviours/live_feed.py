"""What is being recorded as a feed: the code that replays, fed while it happens."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np

from behaviours.arrivals import Arrivals
from behaviours.feed import Intake, Seen
from behaviours.settings import FeedSettings
from garbi_map.log import Dvl, Encoder, Image, Imu, Navigation, Pressure
from garbi_map.log.records import Mount
from garbi_map.record.lines import Kind
from garbi_map.rig import Rig
from garbi_map.stripe import ImageLosses, StripeDetector, StripeSettings, UnusableImage, decode

MOST_IMAGES = 12  # that are searched at once; where searching is too slow the older ones are left out
WAITING_IMAGES, WAITING_READINGS = 400, 20_000  # that wait at most, where nobody asks any more

NO_ATTITUDE = (np.nan,) * 4
Reading = tuple[int, int, Kind, tuple[float, ...]]  # arrival ns, stamp ns, ...


class LiveFeed:
    """See `behaviours.feed.Feed`. `add_image` and `add_reading` are called as things arrive, from any thread; `until` is
    called by one thread, a moment after the moment that it asks for, and gives what a replay of the log will give.

    begin_ns  of the first thing that became known; None before
    skipped   images that were left out because searching them took too long
    """

    def __init__(self, rig: Rig, mounts: dict[str, Mount], settings: FeedSettings, stripe: StripeSettings) -> None:
        self.rig, self.settings, self.losses = rig, settings, ImageLosses()
        self._intake = Intake(rig, mounts, settings)
        self.mount = self._intake.mount
        self._arrivals = Arrivals(rig.laser.fixed_angle, settings)
        self._detector = StripeDetector(stripe, rig)
        self._lock = threading.Lock()
        self._images: deque[Image] = deque(maxlen=WAITING_IMAGES)
        self._readings: deque[Reading] = deque(maxlen=WAITING_READINGS)
        self.begin_ns: int | None = None
        self.skipped = 0

    def add_image(self, image: Image) -> None:
        """An image that has arrived."""
        self._begin(max(image.arrival_ns, image.stamp_ns) + round(self.settings.processing * 1e9))
        with self._lock:
            self._images.append(image)

    def add_reading(self, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...]) -> None:
        """A reading that has arrived."""
        self._begin(arrival_ns)
        with self._lock:
            self._readings.append((arrival_ns, stamp_ns, kind, values))

    def _begin(self, known_ns: int) -> None:
        with self._lock:
            self.begin_ns = known_ns if self.begin_ns is None else min(self.begin_ns, known_ns)

    def take_in(self, now_ns: int) -> None:
        """Search the images that have arrived by now, in the order of everything's arrival."""
        images, readings = self._arrived(now_ns)
        self._intake.read(_navigation(readings))
        encoder = [(arrival, stamp, values[0]) for arrival, stamp, kind, values in readings if kind == "encoder"]
        for image in images:
            arrival_ns = max(image.arrival_ns, image.stamp_ns)
            while encoder and encoder[0][0] <= arrival_ns:
                _, stamp, angle = encoder.pop(0)
                self._arrivals.encoder(stamp, angle)
            if self._arrivals.image(image):
                self._search(image)
        for _, stamp, angle in encoder:
            self._arrivals.encoder(stamp, angle)

    def until(self, now_ns: int) -> Seen:
        """See `behaviours.feed.Feed`."""
        self.take_in(now_ns)
        return self._intake.until(now_ns)

    def _arrived(self, now_ns: int) -> tuple[list[Image], list[Reading]]:
        with self._lock:
            images: list[Image] = []
            while self._images and max(self._images[0].arrival_ns, self._images[0].stamp_ns) <= now_ns:
                images.append(self._images.popleft())
            later = [reading for reading in self._readings if reading[0] > now_ns]
            readings = [reading for reading in self._readings if reading[0] <= now_ns]
            self._readings.clear()
            self._readings.extend(later)
        self.skipped += max(len(images) - MOST_IMAGES, 0)
        return images[-MOST_IMAGES:], sorted(readings, key=lambda reading: reading[0])

    def _search(self, image: Image) -> None:
        try:
            pixels = decode(image, self._detector.image_size, self._detector.settings.max_pixels)
        except UnusableImage as reason:
            self.losses.reasons[str(reason)] += 1
            return
        stripe = self._detector.detect(pixels, image.stamp_ns, self._arrivals.alpha(image.stamp_ns))
        self._intake.sight(self._arrivals.sighting(stripe))


def _navigation(readings: list[Reading]) -> Navigation:
    """Readings as the arrays that a log gives."""
    rows: dict[Kind, list[Reading]] = {}
    for reading in readings:
        rows.setdefault(reading[2], []).append(reading)
    found: dict[str, Encoder | Imu | Pressure | Dvl] = {}
    for kind, some in rows.items():
        arrivals = np.array([row[0] for row in some], np.int64)
        stamps = np.array([row[1] for row in some], np.int64)
        if kind == "encoder":
            found[kind] = Encoder(stamps, arrivals, np.array([row[3][0] for row in some]))
        elif kind == "pressure":
            found[kind] = Pressure(stamps, arrivals, np.array([row[3][0] for row in some]))
        elif kind == "dvl":
            velocity = np.array([row[3][:3] for row in some])
            found[kind] = Dvl(stamps, arrivals, velocity, np.zeros((len(some), 3, 3)))
        else:
            values = np.array([row[3] if len(row[3]) == 10 else (*row[3][:6], *NO_ATTITUDE) for row in some])
            turn, force, attitude = values[:, :3], values[:, 3:6], values[:, 6:]
            found[kind] = Imu(stamps, arrivals, turn, force, attitude, np.zeros((len(some), 3, 3)))
    return Navigation(**found)  # type: ignore[arg-type]
