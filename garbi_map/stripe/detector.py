"""The laser line in one image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from garbi_map.rig import Rig
from garbi_map.stripe import kernels, path_kernels
from garbi_map.stripe.gate import BITS, gate_table
from garbi_map.stripe.settings import StripeSettings
from garbi_map.stripe.templates import templates
from garbi_map.stripe.types import Stripe

_CHANNELS = {"blue": 0, "green": 1, "red": 2, "mono": 0}
_DOUBT = 0.1
"""Share of the water's pull that stays unknown, as its end at the stripe may be softer or sharper than assumed."""
_SPREADS = (0.7, 12.0)
"""Narrowest and widest stripe, 1 sigma, px."""
_FINENESS = math.log(1.03)
"""Templates are made for widths in steps of 3 %, so that there are few."""
_STEP = math.radians(0.1)
"""Windows are kept for ranges of the laser's angle this wide, as it comes by the same angles in every sweep."""
_ROUNDING = 0.2887
"""1 sigma of rounding to whole grey levels."""


@dataclass(frozen=True)
class Candidates:
    """All peaks of an image, up to three a row.

    u (h, 3) px, NaN where there is none; sigma (h, 3) px, of the chosen ones; gain (h, 3): HEIGHT times it is the
    height; saturated (h, 3); chosen (h,): which of the three, or -1; spread: 1 sigma of the stripe's profile, px;
    noise: 1 sigma of a dark pixel, grey levels.
    """

    u: NDArray[np.float64]
    sigma: NDArray[np.float64]
    gain: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    chosen: NDArray[np.int64]
    spread: float
    noise: float


class StripeDetector:
    """Finds the stripe in decoded images of one rig; safe to use from several threads.

    rig: bounds where the stripe can be; None to look everywhere.
    """

    def __init__(self, settings: StripeSettings, rig: Rig | None = None) -> None:
        self.settings, self.rig = settings, rig
        self._table = gate_table(settings)
        self._channel = _CHANNELS[settings.laser]
        self._whole = lru_cache(8)(lambda rows, columns: (np.zeros(rows), np.full(rows, columns - 1.0)))
        self._between = lru_cache(1024)(self._between_steps)

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) px that the rig was calibrated for; None without a rig."""
        return None if self.rig is None else (self.rig.camera.width, self.rig.camera.height)

    def detect(self, image: NDArray[np.uint8], stamp_ns: int, alpha: float | None = None) -> Stripe:
        """The stripe in an image (h, w) or (h, w, 3) BGR, uint8; alpha: the laser's angle, rad, where it is known."""
        if self.settings.method == "paper":
            return self._by_paper(_planes(image), stamp_ns)
        found = self.candidates(image, alpha)
        return Stripe(stamp_ns, *path_kernels.gather(found.u, found.sigma, found.gain, found.saturated, found.chosen))

    def candidates(self, image: NDArray[np.uint8], alpha: float | None = None) -> Candidates:
        """Everything that may be the stripe, and which of it was chosen."""
        settings = self.settings
        image = _planes(image)
        rows, columns = image.shape[:2]
        channel = self._channel if image.shape[2] == 3 else 0
        first, last = self._window(rows, columns, alpha)
        place, least, noise, spread = kernels.search(
            image, channel, self._table, BITS, first, last, settings.least_contrast, settings.significance, *_SPREADS
        )
        kernel = templates(settings.width or 1.03 ** round(math.log(spread) / _FINENESS))
        u, sigma, gain, saturated, chosen = path_kernels.measure(
            image,
            channel,
            place,
            kernel.tables,
            kernel.gains,
            kernel.spread,
            least,
            max(noise, _ROUNDING),
            settings.largest_step,
            settings.least_run,
            _DOUBT,
        )
        return Candidates(u, sigma, gain, saturated, chosen, kernel.spread, noise)

    def _window(self, rows: int, columns: int, alpha: float | None) -> tuple[NDArray, NDArray]:
        """First and last column (h,) in which the stripe may be."""
        if self.rig is None or alpha is None or not self.settings.window or not math.isfinite(alpha):
            return self._whole(rows, columns)
        return self._between(math.floor(alpha / _STEP))

    def _between_steps(self, number: int) -> tuple[NDArray, NDArray]:
        """The window of all angles from `number` to the next, in steps."""
        settings = self.settings
        assert self.rig is not None
        edges = [
            self.rig.column_window(_STEP * n, settings.min_range, settings.max_range) for n in (number, number + 1)
        ]
        first, last = np.minimum(edges[0][0], edges[1][0]), np.maximum(edges[0][1], edges[1][1])
        return first - settings.window_margin, last + settings.window_margin

    def _by_paper(self, image: NDArray[np.uint8], stamp_ns: int) -> Stripe:
        rows = len(image)
        u, amplitude = np.empty(rows), np.empty(rows)
        if image.shape[2] == 1:
            image = np.repeat(image, 3, axis=2)
        kernels.paper_rows(image, self._table, 8 - BITS, u, amplitude)
        row = np.flatnonzero(np.isfinite(u))
        return Stripe(
            stamp_ns,
            row.astype(np.int32),
            u[row].astype(np.float32),
            np.full(len(row), 0.5, np.float32),
            amplitude[row].astype(np.float32),
            amplitude[row] >= 254,
        )


def _planes(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(image if image.ndim == 3 else image[:, :, None])
