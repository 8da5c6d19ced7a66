"""The images of a log, and what is found in them, window by window."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, Log, Navigation
from garbi_map.rig import Rig
from garbi_map.stripe import ImageLosses, Stripe, detect_all
from garbi_map.sweep import laser_angle
from garbi_map.view import style
from garbi_map.view.images import send_candidates, send_image, send_sigma, send_stripes
from garbi_map.view.silence import Silence
from garbi_map.view.stream import send_curves
from garbi_map.view.thin import thinned
from garbi_map.view.vehicle import draw_profiles
from garbi_map.view.watching import WatchingDetector

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.sweep.angle import Angle

_DRAWN = (24, 192)
"""Fewest and most points of a stripe that are drawn."""
_SHARE = 0.006
"""Points of a stripe per byte that the log has for each image: what is drawn of an image is small beside it."""


class CameraSender:
    """Sends images as they come, and at each window's end their stripes, what else was seen, and the profiles.

    rig: None where there is no usable one; losses: images that could not be used; silence is told of every image.
    """

    def __init__(
        self, recording: RecordingStream, log: Log, rig: Rig | None, config: Config, workers: int, silence: Silence
    ) -> None:
        self.losses = ImageLosses()
        self._recording, self._log, self._rig, self._config = recording, log, rig, config
        self._workers, self._silence = workers, silence
        self._detector = WatchingDetector(config.stripe, rig)
        share = _SHARE * log.size / max(log.image_count, 1)
        self._rows = int(np.clip(share, *_DRAWN))

    def send(self, found: Navigation, begin_ns: int, end_ns: int) -> None:
        """A window; `found` is what the other sensors said in it."""
        angle = self._angle(found)
        images = self._images(begin_ns, end_ns)
        stripes = list(detect_all(images, self._detector, angle.alpha if angle else None, self._workers, self.losses))
        self._recording.reset_time()
        if not stripes:
            return
        stamps = np.array([stripe.stamp_ns for stripe in stripes], np.int64)
        picks = [thinned(len(stripe.u), self._rows) for stripe in stripes]
        u, row = (
            np.concatenate([getattr(stripe, name)[pick] for stripe, pick in zip(stripes, picks, strict=True)])
            for name in ("u", "row")
        )
        lengths = np.array([len(pick) for pick in picks])
        self._send_water_and_doubt(stamps, stripes)
        if self._config.view.images:
            send_stripes(self._recording, stamps, np.stack([u, row], axis=1), lengths)
        rows = self._rig.camera.height if self._rig else max(int(row.max(initial=0)) + 1, 1)
        send_curves(self._recording, style.STRENGTH, stamps, [_strength(stripe, rows) for stripe in stripes])
        if self._rig is not None and angle is not None:
            self._send_profiles(self._rig, stamps, np.repeat(angle.at(stamps)[0], lengths), u, row, lengths)

    def _images(self, begin_ns: int, end_ns: int) -> Iterator[Image]:
        view = self._config.view
        for image in self._log.images(begin_ns, end_ns):
            self._silence.image(image.stamp_ns)
            if (self._silence.images - 1) % view.every == 0:
                if view.images:
                    send_image(self._recording, image)
                yield image

    def _angle(self, found: Navigation) -> Angle | None:
        """The laser's angle, where the window tells it."""
        if self._rig is None:
            return None
        try:
            return laser_angle(found.encoder, self._rig, self._config.sweep)
        except GarbiError:
            return None

    def _send_water_and_doubt(self, stamps: NDArray[np.int64], stripes: list[Stripe]) -> None:
        seen = [self._detector.take(stripe.stamp_ns) for stripe in stripes]
        send_curves(self._recording, style.BACKSCATTER, stamps, [one.water for one in seen])
        if self._config.view.images:
            others = [one.others[thinned(len(one.others), self._rows // 2)] for one in seen]
            send_candidates(self._recording, stamps, others)
            send_sigma(self._recording, stripes, self._rows // 4)

    def _send_profiles(
        self, rig: Rig, stamps: NDArray[np.int64], alpha: NDArray, u: NDArray, row: NDArray, lengths: NDArray[np.int64]
    ) -> None:
        points = rig.triangulate(u.astype(float), row.astype(float), alpha).points
        depth = rig.depth(points)
        limits = self._config.stripe
        good = (depth > limits.min_range) & (depth < limits.max_range)  # NaN is no good
        kept = np.bincount(np.repeat(np.arange(len(stamps)), lengths)[good], minlength=len(stamps))
        draw_profiles(self._recording, rig.laser.apex, stamps, points[good], kept)


def _strength(stripe: Stripe, rows: int) -> tuple[float, float]:
    """Median peak above background, 0..255, and the share of the rows that see the laser, %."""
    return (float(np.median(stripe.intensity)) if len(stripe.intensity) else 0.0, 100.0 * len(stripe.u) / rows)
