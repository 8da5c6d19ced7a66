"""Synthetic stripes whose true columns are known: a Gaussian, its halo, one-sided backscatter, white noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

HEIGHT, WIDTH = 576, 768
AMPLITUDE, SPREAD = 190.0, 1.8
CROSSTALK = np.array([0.25, 1.0, 0.08])
"""What of a green laser arrives in blue, green and red."""
BLACK = 20.0
"""Grey level of the dark: high enough that noise is not cut off at zero."""


@dataclass(frozen=True)
class Condition:
    """Noise in grey levels; halo and backscatter as shares of the stripe's peak; edge: what softens the lit water's end
    by 1.5 px, a Gaussian or a logistic step."""

    name: str
    noise: float
    halo: float = 0.0
    backscatter: float = 0.0
    edge: Literal["gaussian", "logistic"] = "gaussian"


CONDITIONS = [
    Condition("noise 2", 2),
    Condition("noise 5", 5),
    Condition("noise 10", 10),
    Condition("noise 20", 20),
    Condition("halo 30 %, noise 5", 5, halo=0.3),
    Condition("backscatter 15 %, noise 5", 5, backscatter=0.15),
    Condition("backscatter 40 %, halo 30 %, noise 10", 10, halo=0.3, backscatter=0.4),
    Condition("backscatter 15 %, noise 5, logistic", 5, backscatter=0.15, edge="logistic"),
    Condition("backscatter 40 %, halo 30 %, noise 10, logistic", 10, halo=0.3, backscatter=0.4, edge="logistic"),
]


def true_columns(seed: int) -> NDArray[np.float64]:
    """A slanted and gently waved stripe, columns (HEIGHT,) px."""
    rng = np.random.default_rng(seed)
    v = np.arange(HEIGHT)
    slant, wave, phase = rng.uniform(-0.15, 0.15), rng.uniform(5, 20), rng.uniform(0, 2 * np.pi)
    return WIDTH / 2 + rng.uniform(-60, 60) + slant * (v - HEIGHT / 2) + wave * np.sin(v / 60 + phase)


def light(
    columns: NDArray[np.float64],
    halo: float = 0.0,
    backscatter: float = 0.0,
    edge: str = "gaussian",
    spread: float = SPREAD,
    width: int = WIDTH,
) -> NDArray[np.float64]:
    """The laser's light, peak 1, (n, width): stripe, halo of sigma 14 px, and lit water that decays over 25 px to the
    left and ends softly at the stripe."""
    t = np.arange(width)[None, :] - columns[:, None]
    step = expit(-t / 1.5) if edge == "logistic" else ndtr(-t / 1.5)
    water = np.exp(-np.abs(t) / 25.0) * step
    return np.exp(-0.5 * (t / spread) ** 2) + halo * np.exp(-0.5 * (t / 14.0) ** 2) + backscatter * water


def expose(
    lit: NDArray[np.float64], noise: float, seed: int, amplitude: float = AMPLITUDE, black: float = BLACK
) -> NDArray[np.uint8]:
    """Image (n, width, 3) BGR of light of peak 1, with white noise per channel, rounded and clipped to 0..255."""
    rng = np.random.default_rng(seed)
    level = black + amplitude * lit[:, :, None] * CROSSTALK
    return np.clip(np.round(level + noise * rng.standard_normal(level.shape)), 0, 255).astype(np.uint8)


def synthetic(condition: Condition, seed: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Image (HEIGHT, WIDTH, 3) and its true columns (HEIGHT,)."""
    columns = true_columns(seed)
    lit = light(columns, condition.halo, condition.backscatter, condition.edge)
    return expose(lit, condition.noise, seed + 1000), columns
