"""Compiled shortest paths over layers of cells."""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit
from numpy.typing import NDArray

from garbi_map.log.records import Floats


@njit(cache=True, nogil=True)
def cheapest(cost: NDArray[np.float32], start: NDArray[np.int64], climb: float) -> tuple[Floats, NDArray[np.int64]]:
    """Dijkstra from `start` (layer, i, j): price of reaching each cell (layers, nx, ny), inf where it cannot be, and the
    flat number of the cell before (-1 at the start). A step costs its length in cells times the mean of both cells."""
    layers, nx, ny = cost.shape
    reached = np.full((layers, nx, ny), np.inf)
    parent = np.full((layers, nx, ny), -1, np.int64)
    done = np.zeros((layers, nx, ny), np.bool_)
    reached[start[0], start[1], start[2]] = 0.0
    queue = [(0.0, start[0] * nx * ny + start[1] * ny + start[2])]
    while len(queue) > 0:
        price, cell = heapq.heappop(queue)
        n, i, j = cell // (nx * ny), (cell // ny) % nx, cell % ny
        if done[n, i, j]:
            continue
        done[n, i, j] = True
        for dn in range(-1, 2):
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    if dn != 0 and (di != 0 or dj != 0):
                        continue
                    m, p, q = n + dn, i + di, j + dj
                    if m < 0 or m >= layers or p < 0 or p >= nx or q < 0 or q >= ny or done[m, p, q]:
                        continue
                    length = np.sqrt(di * di + dj * dj) + 2.0 * climb * abs(dn)
                    step = 0.5 * (cost[n, i, j] + cost[m, p, q]) * length
                    if price + step < reached[m, p, q]:
                        reached[m, p, q] = price + step
                        parent[m, p, q] = cell
                        heapq.heappush(queue, (price + step, m * nx * ny + p * ny + q))
    return reached, parent


@njit(cache=True, nogil=True)
def trace(parent: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cells (n, 3) from the start to `end`."""
    _, nx, ny = parent.shape
    count = 1
    cell = parent[end[0], end[1], end[2]]
    while cell >= 0:
        count += 1
        cell = parent[cell // (nx * ny), (cell // ny) % nx, cell % ny]
    cells = np.empty((count, 3), np.int64)
    cells[count - 1] = end
    cell = parent[end[0], end[1], end[2]]
    row = count - 2
    while cell >= 0:
        cells[row, 0], cells[row, 1], cells[row, 2] = cell // (nx * ny), (cell // ny) % nx, cell % ny
        cell = parent[cells[row, 0], cells[row, 1], cells[row, 2]]
        row -= 1
    return cells
