"""Charts of the local volume, one per height of the vehicle: how far the nearest column is that a hull there would touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from behaviours import kernels
from behaviours.space import Space
from garbi_map.log.records import Floats

LAYER = 0.2  # m between heights
ABOVE_AND_BELOW = 0.3  # m kept from what is occupied above and below
FAR = 9.0  # m, where there is none


@dataclass(frozen=True)
class Charts:
    """Layers of columns.

    heights   (n,) m, odom, LAYER apart, of base_link
    low       (2,) number of the first column on each axis; voxel: edge, m
    occupied  (n, nx, ny) m from each column to the nearest in which a hull at that height meets something; 0 there
    unseen    (n, nx, ny) m, likewise to the nearest in which some of it would be in unseen water
    """

    heights: Floats
    low: NDArray[np.int64]
    voxel: float
    occupied: NDArray[np.float32]
    unseen: NDArray[np.float32]

    def column(self, point: Floats) -> tuple[int, int, int]:
        """Layer and column of a point (3,), odom; the nearest there is."""
        index = np.floor(np.asarray(point)[:2] / self.voxel).astype(np.int64) - self.low
        i, j = np.clip(index, 0, np.array(self.occupied.shape[1:]) - 1)
        return int(np.abs(self.heights - point[2]).argmin()), int(i), int(j)


def draw(space: Space, middle: float, band: float, grown: Floats) -> Charts:
    """Charts for heights within `band` m of `middle`, odom, as the space is known now.

    grown: (nx, ny, nz) m by which each occupied voxel may have come nearer, see Space.unsettled"""
    order = [np.mod(np.arange(low, low + n), n) for low, n in zip(space.low, space.shape, strict=True)]
    hits = space.layers[3][np.ix_(*order)] >= space.settings.hits
    known = space.layers[0][np.ix_(*order)] != kernels.NEVER
    if np.isfinite(space.assumed_free_above):
        floors = np.arange(space.low[2], space.low[2] + space.shape[2]) * space.voxel
        known[:, :, floors >= space.assumed_free_above] = True
    grown = grown[np.ix_(*order)]
    count = 2 * round(band / LAYER) + 1
    heights = middle + LAYER * (np.arange(count) - count // 2)
    occupied = np.zeros((count, *hits.shape[:2]), np.float32)
    unseen = np.zeros_like(occupied)
    for n, height in enumerate(heights):
        wide = _levels(space, height, float(space.half[2]) + ABOVE_AND_BELOW)
        own = _levels(space, height, float(space.half[2]) - 0.5 * space.voxel)
        if wide is not None and own is not None:
            there = hits[:, :, wide].any(2)
            occupied[n] = _away(there, space.voxel)
            come = np.where(there, grown[:, :, wide].max(2), 0.0)
            if come.any():
                away, (i, j) = distance_transform_edt(come == 0.0, return_indices=True)
                occupied[n] = np.minimum(occupied[n], np.maximum(away * space.voxel - come[i, j], 0.0))
            unseen[n] = _away(~known[:, :, own].all(2), space.voxel)
    return Charts(heights, space.low[:2].copy(), space.voxel, occupied, unseen)


def _levels(space: Space, height: float, half: float) -> slice | None:
    """The levels of voxels that a hull of that half height at `height` is in; None: outside the volume."""
    first = int(np.floor((height - half) / space.voxel)) - int(space.low[2])
    last = int(np.floor((height + half) / space.voxel)) - int(space.low[2])
    return None if first < 0 or last >= space.shape[2] else slice(first, last + 1)


def _away(there: NDArray[np.bool_], voxel: float) -> NDArray[np.float32]:
    """m from each column (nx, ny) to the nearest that is true."""
    if not there.any():
        return np.full(there.shape, FAR, np.float32)
    return (distance_transform_edt(~there) * voxel).astype(np.float32)
