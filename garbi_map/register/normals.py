"""One normal for two matched surfels: the surest, or one freed of what is only noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Normals = Callable[[Floats, Floats, NDArray[np.int64]], Floats]
"""Unit normals (n, 3) of n matches from those of the two surfels, (n, 3) each, and the group (n,) of each match."""

_DOUBT = 2.0
"""Times the noise that the spread of normals must exceed to tell of slopes."""


def summed_normals(first: Floats, second: Floats, group: NDArray[np.int64]) -> Floats:
    """The mean direction of the two, in which a surface's curvature cancels (Rusinkiewicz, 2019)."""
    normal = first + second
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def common_normals(first: Floats, second: Floats, group: NDArray[np.int64]) -> Floats:
    """The same, less what is only noise: for the information, which would otherwise be too large.

    The noise of normals points in every direction, and thousands of matches on a level floor would seem to hold a sweep in
    place along it. The two of a match are two looks at one normal: their differences tell the noise. Within a group of
    matches, normals are drawn toward their mean in those directions in which they spread no more than that, and the means
    of the groups toward that of all (James and Stein, 1961).
    """
    both, apart = (first + second) / 2.0, (first - second) / 2.0
    _, group, count = np.unique(group, return_inverse=True, return_counts=True)
    everything = np.zeros(len(count), np.int64)
    mean, spread = _moments(both, np.ones(len(both)), group)
    _, noise = _moments(apart, np.ones(len(both)), group)
    centre, spread_of_means = _moments(mean, count.astype(float), everything)
    noise_of_means = noise.sum(axis=0, keepdims=True) / count.sum()
    inside = np.einsum("nij,nj->ni", _trust(spread, noise)[group], both - mean[group])
    between = (mean - centre) @ _trust(spread_of_means, noise_of_means)[0]
    normal = centre + between[group] + inside
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _trust(spread: Floats, noise: Floats) -> Floats:
    """How much (g, 3, 3) of a deviation to believe, from the covariances (g, 3, 3) of deviations and of their noise."""
    values, vectors = np.linalg.eigh(spread)
    noises = np.einsum("gia,gij,gja->ga", vectors, noise, vectors)
    trust = np.clip(1.0 - _DOUBT * noises / np.maximum(values, 1e-12), 0.0, 1.0)
    return np.einsum("gia,ga,gja->gij", vectors, trust, vectors)


def _moments(values: Floats, weight: Floats, group: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Weighted mean (g, 3) and covariance (g, 3, 3) of each group."""
    total = np.bincount(group, weight)[:, None]
    mean = np.stack([np.bincount(group, weight * column) for column in values.T], axis=1) / total
    off = values - mean[group]
    products = (off[:, :, None] * off[:, None, :]).reshape(-1, 9)
    second = np.stack([np.bincount(group, weight * column) for column in products.T], axis=1) / total
    return mean, second.reshape(-1, 3, 3)
