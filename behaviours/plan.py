"""A way through the local volume: Dijkstra over stacked layers of cells, the vehicle as an upright cylinder."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from behaviours import kernels
from behaviours.kernels_plan import cheapest, trace
from behaviours.settings import Vehicle
from behaviours.space import Space
from behaviours.types import Pose
from garbi_map.log.records import Floats

NEAR_PRICE, CLIMB_PRICE = 3.0, 4.0
UNSEEN_PRICE, BLIND_PRICE, BLIND = 1.0, 8.0, 1.6  # what is unseen this near (m) will not come into view from here
LAYER = 0.2  # m between heights


class Planner:
    """Unseen cells may be planned through, at a price; cells near an obstacle cost more, cells too near cannot be."""

    def __init__(self, vehicle: Vehicle, band: float) -> None:
        self._half = np.array(vehicle.hull) / 2
        self._band = band

    def plan(self, space: Space, pose: Pose, goal: Floats) -> Floats | None:
        """Points (n, 3), odom, from the vehicle to the goal or to the cell nearest to it; None: shut in."""
        voxel = space.voxel
        # A lattice of heights that holds the goal's draws the vehicle back to it.
        middle = float(goal[2] + LAYER * np.round((pose.position[2] - goal[2]) / LAYER))
        occupied, unknown = self._layers(space, middle)
        count = occupied.shape[0]
        heights = middle + LAYER * (np.arange(count) - count // 2)
        keep_off = self._half[1] + 0.38
        cost = np.empty(occupied.shape, np.float32)
        i, j = np.ogrid[: occupied.shape[1], : occupied.shape[2]]
        own_cell = self._cell(space, pose.position, heights)
        price = np.where(np.hypot(i - own_cell[1], j - own_cell[2]) * voxel < BLIND, BLIND_PRICE, UNSEEN_PRICE)
        for n in range(count):
            off = distance_transform_edt(~occupied[n]) * voxel if occupied[n].any() else np.full(occupied[n].shape, 9.0)
            blind = distance_transform_edt(~unknown[n]) * voxel < self._half[1]  # some of the hull would be in it
            cost[n] = 1.0 + price * blind + NEAR_PRICE * np.clip(1.0 - (off - keep_off) / 0.6, 0.0, 1.0)
            cost[n][off < keep_off] = np.inf
        start = own_cell
        own = cost[:, max(start[1] - 3, 0) : start[1] + 4, max(start[2] - 3, 0) : start[2] + 4]
        own[np.isinf(own)] = 12.0  # the vehicle is here, however near: it has to get out
        target = self._cell(space, goal, heights)
        reached, parent = cheapest(cost, start, CLIMB_PRICE)
        end = self._end(reached, target, voxel, cost)
        if end is None:
            return None
        cells = trace(parent, end)
        path = np.empty((len(cells), 3))
        path[:, 0] = (space.low[0] + cells[:, 1] + 0.5) * voxel
        path[:, 1] = (space.low[1] + cells[:, 2] + 0.5) * voxel
        path[:, 2] = heights[cells[:, 0]]
        if np.linalg.norm(path[-1, :2] - goal[:2]) < 2 * voxel:
            path[-1, :2] = goal[:2]
        return path

    def _layers(self, space: Space, height: float) -> tuple[np.ndarray, np.ndarray]:
        """(layers, nx, ny) bool: a hull at that height would touch something occupied; it would touch something unseen."""
        order = [np.mod(np.arange(low, low + n), n) for low, n in zip(space.low, space.shape, strict=True)]
        hits = space.layers[3][np.ix_(*order)] >= space.settings.hits
        known = space.layers[0][np.ix_(*order)] != kernels.NEVER
        if np.isfinite(space.assumed_free_above):
            known[
                :, :, np.arange(space.low[2], space.low[2] + space.shape[2]) * space.voxel >= space.assumed_free_above
            ] = True
        count = 2 * int(self._band / LAYER) + 1
        occupied = np.zeros((count, *hits.shape[:2]), bool)
        unknown = np.ones_like(occupied)
        for n in range(count):
            middle = height + LAYER * (n - count // 2)
            first = int(np.floor((middle - self._half[2] - 0.2) / space.voxel)) - int(space.low[2])
            last = int(np.floor((middle + self._half[2] + 0.2) / space.voxel)) - int(space.low[2])
            if first < 0 or last >= hits.shape[2]:
                occupied[n] = True
                continue
            occupied[n] = hits[:, :, first : last + 1].any(2)
            unknown[n] = ~known[:, :, first + 2 : last - 1].all(2)
        return occupied, unknown

    def _cell(self, space: Space, point: Floats, heights: Floats) -> np.ndarray:
        index = np.floor(np.asarray(point)[:2] / space.voxel).astype(np.int64) - space.low[:2]
        index = np.clip(index, 0, space.shape[:2] - 1)
        return np.array([int(np.abs(heights - point[2]).argmin()), *index], np.int64)

    @staticmethod
    def _end(reached: np.ndarray, target: np.ndarray, voxel: float, cost: np.ndarray) -> np.ndarray | None:
        """The reached cell from which the straight way on to the target is cheapest."""
        if not np.isfinite(reached).any():
            return None
        n, i, j = np.ogrid[: reached.shape[0], : reached.shape[1], : reached.shape[2]]
        rest = np.sqrt((i - target[1]) ** 2 + (j - target[2]) ** 2 + (2 * CLIMB_PRICE * (n - target[0])) ** 2)
        total = reached + 3.0 * rest
        return np.array(np.unravel_index(int(np.argmin(total)), reached.shape), np.int64)
