"""The laser line in one image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.rig import Rig
from garbi_map.stripe import kernels, path_kernels
from garbi_map.stripe.gate import BITS, gate_table
from garbi_map.stripe.settings import StripeSettings
from garbi_map.stripe.templates import templates
from garbi_map.stripe.types import Stripe

_CHANNELS = {"blue": 0, "green": 1, "red": 2, "mono": 0}
_DOUBT = 0.12
"""Share of the water's pull that stays unknown, as its end at the stripe may be softer or sharper than assumed."""
_SPREADS = (0.7, 12.0)
"""Narrowest and widest stripe, 1 sigma, px."""
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
        noise = float(kernels.noise_of(image, channel, max(rows // 64, 1)))
        least = max(settings.least_contrast, settings.significance * noise)
        shape = (rows, kernels.CANDIDATES)
        place, width = np.empty(shape), np.empty(shape)
        blocks = _blocks(image)
        kernels.find_candidates(image, blocks, channel, self._table, BITS, first, last, 0.4 * least, place, width)
        kernel = templates(settings.width or self._spread(image, channel, place, width))
        u, gain, pull, rest, sigma = (np.zeros(shape) for _ in range(5))
        saturated = np.zeros(shape, np.bool_)
        kernels.refine(
            image,
            channel,
            place,
            kernel.slope,
            kernel.curvature,
            kernel.water,
            kernel.rest,
            kernel.spread,
            least,
            u,
            gain,
            pull,
            rest,
            saturated,
        )
        chosen = np.empty(rows, np.int64)
        path_kernels.choose(u, gain, settings.largest_step, settings.least_run, chosen)
        path_kernels.correct(
            u, gain, pull, rest, chosen, max(noise, _ROUNDING), kernel.slope_gain, kernel.water_gain, _DOUBT, sigma
        )
        return Candidates(u, sigma, gain, saturated, chosen, kernel.spread, noise)

    def _spread(self, image: NDArray[np.uint8], channel: int, place: NDArray, width: NDArray) -> float:
        """1 sigma of the stripe's profile, px, in steps of 3 %, so that few templates are ever made."""
        spread = kernels.spread_of(image, channel, place, width, len(image) // 32 + 1, *_SPREADS)
        return float(1.03 ** round(math.log(spread) / math.log(1.03)))

    def _window(self, rows: int, columns: int, alpha: float | None) -> tuple[NDArray, NDArray]:
        settings = self.settings
        if self.rig is None or alpha is None or not settings.window or not math.isfinite(alpha):
            return np.zeros(rows), np.full(rows, columns - 1.0)
        first, last = self.rig.column_window(alpha, settings.min_range, settings.max_range)
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


def _blocks(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The same pixels as (h, w // BLOCK, BLOCK c): what the search reads. Copied for odd widths only."""
    rows, columns, depth = image.shape
    count = columns // kernels.BLOCK
    return np.ascontiguousarray(image[:, : count * kernels.BLOCK]).reshape(rows, count, kernels.BLOCK * depth)
