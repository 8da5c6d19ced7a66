"""A stripe detector that remembers what else it saw, so that it can be shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.rig import Rig
from garbi_map.stripe import Candidates, Stripe, StripeDetector, StripeSettings, path_kernels

_NEAR, _FAR = 12, 60
"""px beside the stripe between which the water's light is measured."""


@dataclass(frozen=True)
class Seen:
    """others: pixels (n, 2) of the candidates that were not chosen; water: mean grey level left and right of the
    stripe, 0..255, NaN where there is no stripe."""

    others: NDArray[np.float32]
    water: tuple[float, float]


class WatchingDetector(StripeDetector):
    """Finds what StripeDetector finds; `take` gives the rest of what it saw in an image, once. Safe in several threads."""

    def __init__(self, settings: StripeSettings, rig: Rig | None = None) -> None:
        super().__init__(settings, rig)
        self._seen: dict[int, Seen] = {}

    def detect(self, image: NDArray[np.uint8], stamp_ns: int, alpha: float | None = None) -> Stripe:
        """See StripeDetector."""
        if self.settings.method == "paper":
            return super().detect(image, stamp_ns, alpha)
        found = self.candidates(image, alpha)
        stripe = Stripe(stamp_ns, *path_kernels.gather(found.u, found.sigma, found.gain, found.saturated, found.chosen))
        self._seen[stamp_ns] = Seen(_others(found), self._water(image, stripe))
        return stripe

    def take(self, stamp_ns: int) -> Seen:
        """What was seen in the image of a stamp."""
        return self._seen.pop(stamp_ns, Seen(np.empty((0, 2), np.float32), (np.nan, np.nan)))

    def _water(self, image: NDArray[np.uint8], stripe: Stripe) -> tuple[float, float]:
        plane = image if image.ndim == 2 else image[:, :, self._channel]
        rows, middle = stripe.row[::8], np.round(stripe.u[::8]).astype(int)
        away = np.arange(_NEAR, _FAR, 4)
        levels = []
        for side in (-1, 1):
            columns = middle[:, None] + side * away
            inside = (columns >= 0) & (columns < plane.shape[1])
            light = plane[np.broadcast_to(rows[:, None], columns.shape)[inside], columns[inside]]
            levels.append(float(np.mean(light)) if len(light) else np.nan)
        return levels[0], levels[1]


def _others(found: Candidates) -> NDArray[np.float32]:
    row, number = np.nonzero(np.isfinite(found.u) & (np.arange(found.u.shape[1]) != found.chosen[:, None]))
    return np.stack([found.u[row, number], row], axis=1).astype(np.float32)
