"""The kernels that a row is correlated with, for stripes of one width."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

PHASES = 32
"""Positions between two pixels that the kernels are tabulated at; Newton's last step bridges the rest."""
WINGS = 24
"""px on either side beyond the core in which the background shows itself."""
_RIDGE = 2e-3
"""What a unit of noise costs against a unit of background that is not told apart."""


@dataclass(frozen=True)
class Templates:
    """Tables (PHASES, taps) float32 around a stripe at phase / PHASES px right of the middle tap.

    slope      d exp(-d^2/2), d = distance / spread: its zero crossing is the maximum-likelihood column in white noise
               (Canny 1986); 2 core + 2 taps
    curvature  (1 - d^2) exp(-d^2/2), what the slope changes by; 2 core + 2 taps
    water      2 (core + WINGS) + 2 taps: what the background alone adds to the slope
    rest       2 core + 2 taps: blind to stripe and background, unit gain for white noise: measures the noise in place
    slope_gain, water_gain   noise of `slope` and `water` for unit white noise
    """

    spread: float
    core: int
    slope: NDArray[np.float32]
    curvature: NDArray[np.float32]
    water: NDArray[np.float32]
    rest: NDArray[np.float32]
    slope_gain: float
    water_gain: float

    @property
    def tables(self) -> tuple[NDArray[np.float32], ...]:
        """slope, curvature, water, rest: as the compiled loops take them."""
        return self.slope, self.curvature, self.water, self.rest

    @property
    def gains(self) -> tuple[float, float]:
        """Those of slope and water."""
        return self.slope_gain, self.water_gain


@lru_cache(maxsize=256)
def templates(spread: float) -> Templates:
    """The kernels for a Gaussian stripe of 1 sigma `spread` px.

    The lit water ends at the stripe, so that it is one-sided, and pulls the zero crossing to its side. It is as soft
    there as the stripe is wide, as both are the laser's thickness and the lens's blur. `water` is the kernel of least
    noise that responds to every member of such a family (several softnesses and decays, either side, a sloping
    background) as `slope` does, and not at all to the stripe, wherever it is, nor to its halo.
    """
    core = int(np.ceil(4.0 * spread))
    reach = core + WINGS
    near, wide = np.arange(-core, core + 2), np.arange(-reach, reach + 2)
    inner = slice(WINGS, WINGS + 2 * core + 2)
    tables = [np.empty((PHASES, len(taps)), np.float32) for taps in (near, near, wide, near)]
    gains = np.zeros(2)
    for phase in range(PHASES):
        d = (near - phase / PHASES) / spread
        bell = np.exp(-0.5 * d * d)
        slope, curvature = d * bell, (1.0 - d * d) * bell
        t = wide - phase / PHASES
        lit, blind = _background(t, spread), _stripe(t, spread)
        padded = np.zeros(len(wide))
        padded[inner] = slope
        seen = np.concatenate([lit, blind])
        asked = np.concatenate([lit @ padded, np.zeros(len(blind))])
        cost = np.concatenate([np.ones(len(lit)), np.full(len(blind), 30.0)])
        weighted = seen * cost[:, None]
        weights = np.linalg.solve(weighted @ weighted.T + _RIDGE * len(lit) * np.eye(len(weighted)), asked * cost)
        water = weighted.T @ weights
        third = (d**3 - 3.0 * d) * bell
        stripe = _basis(blind[:, inner], 1e-4)
        beyond = lit[:, inner] - lit[:, inner] @ stripe @ stripe.T
        known = np.hstack([stripe, _basis(beyond, 0.03)])
        rest = third - known @ (known.T @ third)
        for table, kernel in zip(tables, (slope, curvature, water, rest / np.linalg.norm(rest)), strict=True):
            table[phase] = kernel
        gains += np.linalg.norm(slope) / PHASES, np.linalg.norm(water) / PHASES
    slope_table, curvature_table, water_table, rest_table = tables
    return Templates(
        spread, core, slope_table, curvature_table, water_table, rest_table, float(gains[0]), float(gains[1])
    )


def _basis(profiles: NDArray, worth: float) -> NDArray[np.float64]:
    """Orthonormal (n, k) of what profiles (m, n) hold, without what is less than the share `worth` of the strongest."""
    basis, values, _ = np.linalg.svd(profiles.T, full_matrices=False)
    return basis[:, values > worth * values[0]]


def _background(t: NDArray, spread: float) -> NDArray[np.float64]:
    """What the water can look like at distances t (n,) px from the stripe: (m, n)."""
    edges = [ndtr(-t / (spread * softness)) for softness in (0.7, 0.85, 1.0, 1.2)]
    edges += [expit(-t / (spread * softness)) for softness in (0.6, 0.75, 0.9, 1.05)]
    decays = [np.exp(-np.abs(t) / length) for length in (12.0, 25.0, 60.0)]
    left = [edge * decay for edge in edges for decay in decays]
    right = [(1.0 - edge) * decay for edge in edges for decay in decays]
    return np.array([*left, *right, t / 10.0])


def _stripe(t: NDArray, spread: float) -> NDArray[np.float64]:
    """Stripe, halo and dark, and how the stripe changes as it moves: (m, n)."""
    widths = (0.85 * spread, spread, 1.18 * spread)
    bells = [np.exp(-0.5 * (t / width) ** 2) for width in (*widths, 8.0 + spread, 14.0, 25.0)]
    moves = [t / width * np.exp(-0.5 * (t / width) ** 2) for width in widths]
    return np.array([np.ones(len(t)), *bells, *moves])
