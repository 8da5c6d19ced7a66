"""Small planar patches of the bottom, each seen by one sweep, and which of them are the same place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.register import kernels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FLATTEST = 0.04
"""Largest ratio of a surfel's first to its second eigenvalue: a thicker patch has no normal worth the name."""
_NARROWEST = 0.12
"""Least second standard deviation, in voxel sizes: a single profile through a voxel is a line, not a plane."""
_SAME_FACE = np.cos(np.deg2rad(25.0))


@dataclass(frozen=True)
class Surfels:
    """Planar patches in the map frame.

    mean (n, 3) m, normal (n, 3) unit, toward the camera, time (n,) s, sweep (n,), thickness (n,) m rms about the plane.
    """

    mean: Floats
    normal: Floats
    time: Floats
    sweep: Ints
    thickness: Floats

    def select(self, keep: NDArray[np.bool_]) -> Surfels:
        """Those for which keep (n,) is true."""
        return Surfels(self.mean[keep], self.normal[keep], self.time[keep], self.sweep[keep], self.thickness[keep])

    def without(self, sweeps: Ints) -> Surfels:
        """Those of other sweeps."""
        return self.select(~np.isin(self.sweep, sweeps))

    def moved(self, transforms: Floats) -> Surfels:
        """Each moved by the transform (k, 4, 4) of its sweep."""
        own = transforms[self.sweep]
        mean = np.einsum("nij,nj->ni", own[:, :3, :3], self.mean) + own[:, :3, 3]
        return Surfels(
            mean, np.einsum("nij,nj->ni", own[:, :3, :3], self.normal), self.time, self.sweep, self.thickness
        )


def join(first: Surfels, second: Surfels) -> Surfels:
    """All of both."""
    return Surfels(
        np.concatenate([first.mean, second.mean]),
        np.concatenate([first.normal, second.normal]),
        np.concatenate([first.time, second.time]),
        np.concatenate([first.sweep, second.sweep]),
        np.concatenate([first.thickness, second.thickness]),
    )


def extract_surfels(
    points: Floats,
    sigma: NDArray[np.floating],
    profile: NDArray[np.integer],
    time: Floats,
    sweep: Ints,
    viewpoint: Floats,
    size: float,
    fewest: int,
) -> Surfels:
    """Surfels of voxels of `size` metres, made of one sweep's points only.

    points (n, 3) map frame, sigma (n,) m, profile (n,); of each profile time (m,) s, sweep (m,) and viewpoint (m, 3), where
    the camera was.
    """
    n = len(points)
    group, group_sweep = np.empty(n, np.int64), np.empty(n, np.int64)
    groups = kernels.group_by_voxel(points, profile, sweep, size, group, group_sweep)
    count = np.zeros(groups, np.int64)
    mean, second, mean_time = np.zeros((groups, 3)), np.zeros((groups, 6)), np.zeros(groups)
    camera = np.zeros((groups, 3))
    kernels.accumulate_moments(points, sigma, profile, time, viewpoint, group, count, mean, second, mean_time, camera)
    values, normal = np.zeros((groups, 3)), np.zeros((groups, 3))
    kernels.smallest_eigenvectors(second, values, normal)
    good = (count >= fewest) & (values[:, 1] > (_NARROWEST * size) ** 2) & (values[:, 0] < _FLATTEST * values[:, 1])
    mean, normal = mean[good], normal[good]
    away = np.einsum("nk,nk->n", camera[good] - mean, normal) < 0
    normal[away] *= -1.0
    thickness = np.sqrt(np.maximum(values[good, 0], 0.0))
    return Surfels(mean, normal, mean_time[good], group_sweep[:groups][good], thickness)


def match_surfels(
    surfels: Surfels, gate: float, longest: float, asked: NDArray[np.bool_] | None = None
) -> tuple[Ints, Ints]:
    """Pairs (m,), (m,) of surfels of different sweeps that may be the same place.

    For each surfel the nearest of every later sweep, no farther than `gate` metres, `longest` seconds and 25 degrees.
    asked (n,): only pairs whose earlier surfel is one of these.
    """
    n = len(surfels.mean)
    asked = np.ones(n, bool) if asked is None else asked
    key = np.empty(n, np.int64)
    kernels.voxel_keys(surfels.mean, gate, key)
    order = np.argsort(key, kind="stable")
    arguments = (
        asked,
        surfels.mean,
        surfels.normal,
        surfels.time,
        surfels.sweep,
        key,
        order,
        key[order],
        gate,
        longest,
    )
    room = 32 * n + 16
    while True:
        first, second = np.empty(room, np.int64), np.empty(room, np.int64)
        found = kernels.find_matches(*arguments, _SAME_FACE, first, second)
        if found < room:
            return first[:found], second[:found]
        room *= 2
