"""Whether what is recorded is worth recording: stripe, sharpness, saturation of an image now and then."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from garbi_map.log import Image
from garbi_map.record.faults import Faults
from garbi_map.rig import Rig
from garbi_map.stripe import StripeDetector, StripeSettings, UnusableImage, decode

SEEN = 0.05  # of the rows: less is no stripe
SATURATED = 0.2  # of the stripe
CLIPPED = 250  # grey levels


@dataclass(frozen=True)
class Look:
    """One image.

    stripe     share of the rows in which the laser is found
    saturated  share of them in which it is clipped
    clipped    share of all pixels that are
    sharpness  standard deviation of the image's Laplacian, grey levels: compare it with itself while focusing
    brightness mean grey level
    """

    stripe: float
    saturated: float
    clipped: float
    sharpness: float
    brightness: float

    def words(self) -> str:
        """For the screen."""
        stripe = f"stripe in {100 * self.stripe:.0f} % of the rows" if self.stripe > SEEN else "no stripe"
        return (
            f"{stripe}, {100 * self.saturated:.0f} % of it saturated; sharpness {self.sharpness:.1f}, "
            f"brightness {self.brightness:.0f}, {100 * self.clipped:.1f} % of the image clipped"
        )


def look_at(image: Image, detector: StripeDetector) -> Look:
    """Raises UnusableImage."""
    import cv2

    pixels = decode(image, detector.image_size, detector.settings.max_pixels)
    stripe = detector.detect(pixels, image.stamp_ns)
    grey = pixels if pixels.ndim == 2 else pixels[:, :, 1]
    step = max(grey.shape[0] // 480, 1)
    few = np.ascontiguousarray(grey[::step, ::step])
    middle = few[len(few) // 4 : -len(few) // 4 or None]
    found = len(stripe.row)
    return Look(
        found / len(pixels),
        float(stripe.saturated.mean()) if found else 0.0,
        float((few >= CLIPPED).mean()),
        float(cv2.Laplacian(middle, cv2.CV_16S).std()),
        float(few.mean()),
    )


class Looker(threading.Thread):
    """Looks at the newest image every so many seconds; `last` is what it saw."""

    def __init__(self, settings: StripeSettings, rig: Rig | None, every: float, faults: Faults) -> None:
        super().__init__(name="garbi look", daemon=True)
        self._detector = StripeDetector(settings, rig)
        self._every, self._faults = every, faults
        self._newest: Image | None = None
        self._stopping = threading.Event()
        self.last: Look | None = None

    def warm_up(self) -> None:
        """Look at a black image: what is compiled or loaded at first use is, before anything is recorded."""
        import simplejpeg

        width, height = self._detector.image_size or (64, 48)
        black = simplejpeg.encode_jpeg(np.zeros((height, width, 3), np.uint8))
        look_at(Image(0, 0, "jpeg", black), self._detector)

    def see(self, image: Image) -> None:
        """The newest image."""
        self._newest = image

    def run(self) -> None:
        """Until `stop`."""
        while not self._stopping.wait(self._every):
            image, self._newest = self._newest, None
            if image is None:
                continue
            try:
                self.last = look_at(image, self._detector)
            except UnusableImage as reason:
                self._faults.tell("camera", f"an image cannot be used: {reason}")
            except Exception as error:  # what is only looked at must not harm what is recorded
                self._faults.tell("look", f"an image could not be looked at ({type(error).__name__}: {error})")

    def stop(self) -> None:
        """And wait until it has."""
        self._stopping.set()
        if self.is_alive():
            self.join()
