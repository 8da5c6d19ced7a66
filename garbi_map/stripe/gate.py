"""The colour gate: a look-up table from RGB to 'may be the laser', as the paper's video card held it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.stripe.settings import GateSettings, StripeSettings

BITS = 5
"""Bits of each channel that index the table: 32 kB, which stays in the processor's first cache."""

HUES = {"red": (-50.0, 35.0), "green": (90.0, 180.0), "blue": (200.0, 280.0)}


def gate_table(settings: StripeSettings) -> NDArray[np.uint8]:
    """Table (2^(3 BITS),) of 0 and 1, indexed by the upper bits of blue, green, red; all ones for a mono camera."""
    if settings.laser == "mono":
        return np.ones(1 << (3 * BITS), np.uint8)
    gate = settings.gate
    levels = (np.arange(1 << BITS) + 0.5) / (1 << BITS)
    blue, green, red = np.meshgrid(levels, levels, levels, indexing="ij")
    hue, lightness, saturation = _hls(red, green, blue)
    low, high = gate.hue or HUES[settings.laser]
    inside = np.mod(hue - low, 360.0) <= high - low
    coloured = inside & (saturation >= gate.saturation) & (lightness >= gate.lightness)
    return (coloured | (lightness >= gate.white)).astype(np.uint8).ravel()


def _hls(red: NDArray, green: NDArray, blue: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Hue in degrees, lightness and saturation 0..1 of colours 0..1 (Foley and van Dam, Computer Graphics)."""
    most, least = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    chroma = most - least
    lightness = 0.5 * (most + least)
    saturation = np.where(chroma > 0, chroma / np.maximum(1.0 - np.abs(2.0 * lightness - 1.0), 1e-9), 0.0)
    safe = np.maximum(chroma, 1e-9)
    hue = np.where(
        most == red,
        np.mod((green - blue) / safe, 6.0),
        np.where(most == green, (blue - red) / safe + 2.0, (red - green) / safe + 4.0),
    )
    return 60.0 * hue, lightness, saturation


def learn_gate(pixels: NDArray[np.uint8], keep: float = 0.98) -> GateSettings:
    """The gate that passes the share `keep` of pixels (n, 3) BGR that are known to be the laser."""
    blue, green, red = (pixels[:, k] / 255.0 for k in range(3))
    hue, lightness, saturation = _hls(red, green, blue)
    centre = np.rad2deg(np.angle(np.exp(1j * np.deg2rad(hue)).mean()))
    off = np.mod(hue - centre + 180.0, 360.0) - 180.0
    tail = 50.0 * (1.0 - keep)
    low, high = np.percentile(off, [tail, 100.0 - tail])
    return GateSettings(
        hue=(float(centre + low - 10.0), float(centre + high + 10.0)),
        lightness=float(max(0.02, np.percentile(lightness, tail) * 0.7)),
        saturation=float(max(0.1, np.percentile(saturation, tail) * 0.7)),
    )
