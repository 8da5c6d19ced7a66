"""What was known of the laser's angle at the moment an image arrived; the same for a log and for the live feed."""

from __future__ import annotations

from dataclasses import dataclass

from behaviours.angle import LiveAngle
from behaviours.feed import Sighting
from behaviours.settings import FeedSettings
from garbi_map.log import Image
from garbi_map.stripe import Stripe

KEPT = 500  # images that are remembered


@dataclass(frozen=True)
class Known:
    """Of one image: when its profile is known, ns, and the laser's angle, rad, its pass, and whether it is stuck."""

    known_ns: int
    alpha: float
    sweep: int
    stuck: bool


class Arrivals:
    """Encoder readings and images in the order of their arrival; sightings out."""

    def __init__(self, fixed: float | None, settings: FeedSettings) -> None:
        self._angle = LiveAngle(fixed, settings.encoder_reach, settings.encoder_stuck)
        self._late_ns = round(settings.processing * 1e9)
        self._known: dict[int, Known] = {}
        self._latest_ns = 0

    def encoder(self, stamp_ns: int, angle: float) -> None:
        """A reading that has arrived."""
        self._angle.add(stamp_ns, angle)

    def image(self, image: Image) -> bool:
        """Note what is known now that an image arrives. False where there was one of the same moment: it tells nothing."""
        if image.stamp_ns in self._known:
            return False
        arrival_ns = max(image.arrival_ns, image.stamp_ns)
        self._known[image.stamp_ns] = Known(
            arrival_ns + self._late_ns,
            self._angle.at(image.stamp_ns),
            self._angle.sweep,
            self._angle.stuck(image.stamp_ns),
        )
        while len(self._known) > KEPT:
            del self._known[next(iter(self._known))]
        return True

    def alpha(self, stamp_ns: int) -> float:
        """The laser's angle, rad, as it was known when the image of that moment arrived."""
        return self._known[stamp_ns].alpha

    def sighting(self, stripe: Stripe) -> Sighting:
        """The stripe with what was known of its image; images are worked on one after the other."""
        known = self._known[stripe.stamp_ns]
        self._latest_ns = max(self._latest_ns, known.known_ns)
        return Sighting(stripe, self._latest_ns, known.alpha, known.sweep, known.stuck)
