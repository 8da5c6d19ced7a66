"""Map folders of a floor with a formula, laid anywhere: the truth of the tests of comparison."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map import __version__
from garbi_map.export import CloudWriter, Georeference, write_seabed_tif
from garbi_map.seabed import AcceptedPoints, Seabed

Floats = NDArray[np.float64]
Height = Callable[[Floats, Floats], Floats]

CELL = 0.005
NOISE = 0.0004
"""m, 1 sigma of a point"""

_BUMPS = np.random.default_rng(5)
_AT = _BUMPS.uniform([-0.7, -0.5], [0.7, 0.5], (40, 2))
_HIGH = _BUMPS.uniform(-0.02, 0.03, 40)
_WIDE = _BUMPS.uniform(0.03, 0.09, 40)


def floor(x: Floats, y: Floats) -> Floats:
    """Ripples and forty smooth stones and pits."""
    z = 0.01 * np.sin(9.0 * x + 2.0 * y)
    for (cx, cy), high, wide in zip(_AT, _HIGH, _WIDE, strict=True):
        z = z + high * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * wide**2))
    return z


def with_dome(height: Height, at: tuple[float, float], radius: float, high: float) -> Height:
    """The floor with a smooth heap on it."""

    def heaped(x: Floats, y: Floats) -> Floats:
        share = np.clip(1.0 - ((x - at[0]) ** 2 + (y - at[1]) ** 2) / radius**2, 0.0, None)
        return height(x, y) + high * np.sqrt(share)

    return heaped


def write_folder(
    folder: Path,
    height: Height,
    rotation: Floats | None = None,
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
    points: int = 200_000,
    reference: Georeference | None = None,
) -> Path:
    """What `garbi map` leaves of a scan of 1.2 by 0.9 m whose origin is free: x_map = rotation x + shift."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(seed)
    x, y = random.uniform(-0.6, 0.6, points), random.uniform(-0.45, 0.45, points)
    true = np.stack([x, y, height(x, y) + NOISE * random.standard_normal(points)], axis=1)
    placed = true @ (np.eye(3) if rotation is None else rotation).T + shift
    sigma = np.full(points, NOISE, np.float32)
    with CloudWriter(folder / "cloud.laz", reference=reference) as cloud:
        stamp = 1_790_000_000_000_000_000 + np.arange(points) * 1000
        cloud.write(AcceptedPoints(stamp, placed, sigma, np.full(points, 90, np.float32), np.zeros(points, np.uint8)))
    write_seabed_tif(folder / "seabed.tif", _grid(placed), reference)
    (folder / "config.yaml").write_text("{}\n")
    (folder / "report.json").write_text(json.dumps({"title": folder.name, "versions": {"garbi": __version__}}))
    return folder


def _grid(points: Floats) -> Seabed:
    index = np.floor(points[:, :2] / CELL).astype(int)
    low = index.min(0)
    columns, rows = index.max(0) - low + 1
    flat = (index[:, 1] - low[1]) * columns + index[:, 0] - low[0]
    count = np.bincount(flat, minlength=rows * columns).reshape(rows, columns)
    total = np.bincount(flat, points[:, 2], minlength=rows * columns).reshape(rows, columns)
    mean = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0).astype(np.float32)
    sigma = np.where(count > 0, NOISE / np.sqrt(np.maximum(count, 1)), np.nan).astype(np.float32)
    zero = np.zeros(count.shape, np.float32)
    number = count.astype(np.int32)
    return Seabed((low[0] * CELL, low[1] * CELL), CELL, mean, sigma, number, zero, zero, number)
