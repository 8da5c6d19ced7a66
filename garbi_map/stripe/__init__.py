"""The laser line in images: decoded, gated by colour, found to a fraction of a pixel, with its sigma."""

from garbi_map.stripe.decode import ImageLosses, UnusableImage, decode
from garbi_map.stripe.detector import Candidates, StripeDetector
from garbi_map.stripe.settings import GateSettings, StripeSettings
from garbi_map.stripe.stream import detect_all
from garbi_map.stripe.types import Stripe

__all__ = [
    "Candidates",
    "GateSettings",
    "ImageLosses",
    "Stripe",
    "StripeDetector",
    "StripeSettings",
    "UnusableImage",
    "decode",
    "detect_all",
]
