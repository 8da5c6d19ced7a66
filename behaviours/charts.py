"""Charts of the local volume, one per height of the vehicle: how far the nearest column is that a hull there would touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from behaviours import kernels, kernels_charts
from behaviours.kernels_charts import FAR
from behaviours.moving import Mover
from behaviours.settings import TravelSettings
from behaviours.space import Space
from behaviours.types import Pose
from garbi_map.log.records import Floats

LAYER = 0.3  # m between heights
REACH = 3.8  # m to each side of the vehicle
ABOVE_AND_BELOW = 0.3  # m kept from what is occupied above and below
ABOUT = 3.5  # columns about something that moves, which its hits may be in


@dataclass(frozen=True)
class Charts:
    """Layers of columns.

    heights   (n,) m, odom, LAYER apart, of base_link
    low       (2,) number of the first column on each axis; voxel: edge, m
    occupied  (n, nx, ny) m from each column to the nearest in which a hull at that height meets something; 0 there
    wary      (n, nx, ny) m, the same less the way that what may move may have come since
    unseen    (n, nx, ny) m, likewise to the nearest in which some of it would be in unseen water
    """

    heights: Floats
    low: NDArray[np.int64]
    voxel: float
    occupied: NDArray[np.float32]
    wary: NDArray[np.float32]
    unseen: NDArray[np.float32]

    def column(self, point: Floats) -> tuple[int, int, int]:
        """Layer and column of a point (3,), odom; the nearest there is."""
        index = np.floor(np.asarray(point)[:2] / self.voxel).astype(np.int64) - self.low
        i, j = np.clip(index, 0, np.array(self.occupied.shape[1:]) - 1)
        return int(np.abs(self.heights - point[2]).argmin()), int(i), int(j)


def draw(space: Space, pose: Pose, middle: float, settings: TravelSettings, movers: list[Mover]) -> Charts:
    """Charts about the vehicle, for heights within a band about `middle` m, odom, as the space is known now.

    What was hit once may move: the longer ago that was, the nearer it may have come. What is known to move, and how, is
    left out: where it is now it will not be when the vehicle comes."""
    voxel = space.voxel
    count = 2 * round(settings.band / LAYER) + 1
    heights = np.array([middle + LAYER * (n - count // 2) for n in range(count)])
    low = np.floor(pose.position[:2] / voxel).astype(np.int64) - round(REACH / voxel)
    occupied, unseen, hit_ms = kernels_charts.chart(
        heights, float(space.half[2]), ABOVE_AND_BELOW, low, 2 * round(REACH / voxel), voxel, space.low, space.shape,
        space.settings.hits, round(space.settings.settled * 1e3), space.assumed_free_above, space.layers,
    )  # fmt: skip
    for mover in movers:
        if mover.passes > 1 and np.linalg.norm(mover.velocity) > 2 * mover.doubt:
            i, j = np.ogrid[: occupied.shape[1], : occupied.shape[2]]
            x, y = mover.at(pose.stamp_ns)[:2] / voxel - low - 0.5
            about = np.hypot(i - x, j - y) < mover.radius / voxel + ABOUT
            occupied[:, about], hit_ms[:, about] = False, kernels.NEVER
    near = np.empty(occupied.shape, np.float32)
    dark, wary = np.empty_like(near), np.empty_like(near)
    now = space.milliseconds(pose.stamp_ns)
    for n in range(count):
        near[n] = kernels_charts.distance(occupied[n], FAR / voxel) * voxel
        dark[n] = kernels_charts.distance(unseen[n], FAR / voxel) * voxel
        wary[n] = near[n]
        settled = kernels_charts.distance(occupied[n] & (hit_ms[n] == kernels.NEVER), FAR / voxel)
        restless = (hit_ms[n] != kernels.NEVER) & (settled > 1.5)
        if restless.any():
            oldest = (now - int(hit_ms[n][restless].min())) * 1e-3
            come = min(settings.unsettled_speed * max(oldest, 0.0), settings.unsettled_most)
            wary[n] = np.minimum(near[n], kernels_charts.distance(restless, FAR / voxel) * voxel - come)
    return Charts(heights, low, voxel, near, wary, dark)
