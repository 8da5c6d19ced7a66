"""The laser's colour, learnt from a few images that show the stripe."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import yaml
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.log.records import Image
from garbi_map.stripe.decode import ImageLosses, UnusableImage, decode
from garbi_map.stripe.detector import StripeDetector
from garbi_map.stripe.gate import learn_gate
from garbi_map.stripe.settings import GateSettings, StripeSettings

LEAST_PIXELS = 200
_CHANNELS = ("blue", "green", "red")


def learn_settings(images: Iterable[Image], settings: StripeSettings, losses: ImageLosses) -> StripeSettings:
    """The settings with the channel and the colour gate of the laser that the images show; a mono camera needs none.

    The stripe is looked for in each channel without any gate; that in which it stands out most carries the laser.
    Raises GarbiError where no stripe is to be seen.
    """
    open_gate = settings.model_copy(update={"gate": GateSettings(hue=(0, 360), lightness=0, saturation=0)})
    detectors = [StripeDetector(open_gate.model_copy(update={"laser": laser})) for laser in _CHANNELS]
    contrast = np.zeros(3)
    pixels: list[list[NDArray[np.uint8]]] = [[], [], []]
    for image in images:
        try:
            decoded = decode(image, most_pixels=settings.max_pixels)
        except UnusableImage as reason:
            losses.reasons[str(reason)] += 1
            continue
        if decoded.ndim == 2:
            return settings.model_copy(update={"laser": "mono"})
        for channel, detector in enumerate(detectors):
            stripe = detector.detect(decoded, image.stamp_ns)
            contrast[channel] += float(stripe.intensity.sum())
            pixels[channel].append(decoded[stripe.row, np.round(stripe.u).astype(int)])
    best = int(contrast.argmax())
    seen = np.concatenate(pixels[best]) if pixels[best] else np.empty((0, 3), np.uint8)
    if len(seen) < LEAST_PIXELS:
        raise GarbiError("no stripe to learn from: give images in which the laser line is seen on a dark ground")
    return settings.model_copy(update={"laser": _CHANNELS[best], "gate": learn_gate(seen)})


def settings_yaml(settings: StripeSettings) -> str:
    """A configuration file that holds nothing but the laser's channel and gate."""
    section = settings.model_dump(mode="json", include={"laser", "gate"})
    return yaml.safe_dump({"stripe": section}, sort_keys=False)
