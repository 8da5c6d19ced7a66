"""How well overlapping sweeps agree: placed by the navigation filter alone, and in the finished map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.navigate.kernels import place_points
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register.entropy import Balls
from garbi_map.register.normals import summed_normals
from garbi_map.register.surfels import Surfels, match_surfels
from garbi_map.sweep.store import SweepStore

Floats = NDArray[np.float64]

ENTROPY_RADIUS = 0.02
"""m, about each place."""
_GATE = 0.05
"""m, between surfels that are the same place."""
_MOST_PAIRS = 200_000
_MOST_ASKED = 100_000
"""Surfels, evenly drawn, whose partners are looked for."""
_MOST_PLACES = 4_000
_MOST_POINTS = 4_000_000


@dataclass(frozen=True)
class Agreement:
    """The same pairs of surfels of different sweeps, and the same places, before (navigation filter) and after (map).

    place            (m, 2) float32, x and y between the two surfels of a pair in the finished map, m
    before, after    (m,) float32, distance of the two along their common normal, m
    entropy          mean map entropy before and after, nats; NaN where no place has points enough
    """

    place: NDArray[np.float32]
    before: NDArray[np.float32]
    after: NDArray[np.float32]
    entropy: tuple[float, float]

    @property
    def median(self) -> tuple[float, float]:
        """Median distance before and after, m; NaN where no two sweeps overlap."""
        if not len(self.after):
            return float("nan"), float("nan")
        return float(np.median(self.before)), float(np.median(self.after))

    def moved(self, transform: Floats) -> Agreement:
        """The same with places in another frame, which a transform (4, 4) turns about the vertical, nearly, and shifts."""
        place = self.place @ transform[:2, :2].T + transform[:2, 3]
        return replace(self, place=place.astype(np.float32))


def compare_placements(
    store: SweepStore, mount: Mount, before: Trajectory, after: Trajectory, placed: Surfels, surfels: Surfels
) -> Agreement:
    """What two trajectories make of the same sweeps; `placed` and `surfels` are the same ones by the one and the other."""
    entropy = mean_map_entropies(store, mount, (before, after), (placed.mean, surfels.mean))
    return Agreement(*pair_distances(placed, surfels), entropy)


def pair_distances(
    placed: Surfels, surfels: Surfels
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Place (m, 2) and distances before and after (m,), m, of the pairs that the finished map finds.

    The same pairs twice: matched anew, surfels that navigation alone puts a metre apart would find a wrong partner nearby.
    """
    asked = np.zeros(len(surfels.mean), bool)
    asked[:: len(asked) // _MOST_ASKED + 1] = True
    first, second = (_evenly(rows, _MOST_PAIRS) for rows in match_surfels(surfels, _GATE, np.inf, asked))
    middle = (surfels.mean[first, :2] + surfels.mean[second, :2]) / 2
    distances = []
    for own in (placed, surfels):
        normal = summed_normals(own.normal[first], own.normal[second], first)
        apart = np.einsum("nk,nk->n", own.mean[first] - own.mean[second], normal)
        distances.append(np.abs(apart).astype(np.float32))
    return middle.astype(np.float32), distances[0], distances[1]


def mean_map_entropies(
    store: SweepStore, mount: Mount, trajectories: tuple[Trajectory, Trajectory], places: tuple[Floats, Floats]
) -> tuple[float, float]:
    """Mean map entropy, nats, of all sweeps as two trajectories place them, at the same places (m, 3) of each map.

    One pass over the sweeps, of at most a few million points, at some thousand places: bounded whatever the dive's length.
    """
    balls = [Balls(_evenly(own, _MOST_PLACES), ENTROPY_RADIUS) for own in places]
    stride = max(1, -(-sum(entry.points for entry in store.entries) // _MOST_POINTS))
    turn = Rotation.from_quat(mount.quaternion).as_matrix()
    for sweep in store:
        points = sweep.points[::stride] @ turn.T + mount.translation
        for ball, trajectory in zip(balls, trajectories, strict=True):
            poses = trajectory.at(sweep.stamp_ns)
            ball.add(place_points(points, sweep.profile[::stride], poses.rotation.as_matrix(), poses.position))
    entropies = np.array([ball.entropy() for ball in balls])
    known = np.isfinite(entropies).all(axis=0)
    before, after = entropies[:, known].mean(axis=1) if known.any() else (np.nan, np.nan)
    return float(before), float(after)


def _evenly(rows: NDArray, most: int) -> NDArray:
    return rows[:: max(1, -(-len(rows) // most))]
