"""Compiled shortest paths: over layers of cells, and over cells and headings."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from garbi_map.log.records import Floats

HEADINGS = 8
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])
SLACK = 0.1  # m of the hull's outline in the unseen that safety lets by, slowly
TURN, ASTERN = 0.45, 1.7  # m that an eighth of a turn is worth; price of a metre backwards
TURN_UNSEEN, ASTERN_UNSEEN = 2.5, 15.0  # m for an eighth of a turn, and per metre, where some of the hull is not seen
TIGHT = 20.0  # price of a metre where there is no room


@njit(cache=True, nogil=True)
def cheapest(cost: NDArray[np.float32], begin: Floats, climb: float) -> tuple[Floats, NDArray[np.int64]]:
    """Dijkstra from cells with a price to begin with (layers, nx, ny; inf: none): price of reaching each cell, inf where it
    cannot be, and the flat number of the cell before (-1 where it begins). A step costs its length in cells times the mean
    of both cells."""
    layers, nx, ny = cost.shape
    reached = begin.copy()
    parent = np.full((layers, nx, ny), -1, np.int64)
    done = np.zeros((layers, nx, ny), np.bool_)
    queue = [(0.0, np.int64(-1))]
    for first in range(layers * nx * ny):
        price = begin[first // (nx * ny), (first // ny) % nx, first % ny]
        if price < np.inf:
            heapq.heappush(queue, (price, np.int64(first)))
    while len(queue) > 0:
        price, cell = heapq.heappop(queue)
        if cell < 0:
            continue
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


@njit(cache=True, nogil=True)
def manoeuvring(
    begin: Floats,
    size: float,
    occupied: NDArray[np.float32],
    wary: NDArray[np.float32],
    unseen: NDArray[np.float32],
    circles: Floats,
    radius: float,
    clearance: float,
    near_price: float,
    unseen_price: float,
) -> Floats:
    """m of way left (nx, ny, headings) for a hull that goes ahead, astern, or turns on the spot, from Dijkstra backwards.

    begin (nx, ny) m left from cells of that size (m) where the search begins, inf elsewhere; occupied, wary, unseen
    (2 nx, 2 ny) charts of one height, two columns to a cell; discs of `radius` at `circles` m along the hull. What is ahead
    is seen before the hull comes there; what is abeam or astern is not: to turn or back into the unseen is dear."""
    nx, ny = begin.shape
    half = 0.5 * size
    sweep = radius + circles[len(circles) - 1] - 0.14  # m, of the corners
    ahead, dark = np.empty((nx, ny, HEADINGS)), np.zeros((nx, ny, HEADINGS), np.bool_)
    spin = np.full((nx, ny), TURN)
    for i in range(nx):
        for j in range(ny):
            if occupied[2 * i, 2 * j] - 0.5 * half < sweep + 0.05:
                spin[i, j] = TIGHT
            elif unseen[2 * i, 2 * j] < sweep - SLACK:
                spin[i, j] = TURN_UNSEEN
            for h in range(HEADINGS):
                cos, sin = math.cos(h * math.pi / 4), math.sin(h * math.pi / 4)
                room, calm, seen = 1e9, 1e9, 1e9
                for k in range(len(circles)):
                    a = min(max(2 * i + round(circles[k] * cos / half), 0), 2 * nx - 1)
                    b = min(max(2 * j + round(circles[k] * sin / half), 0), 2 * ny - 1)
                    room = min(room, occupied[a, b] - radius - 0.5 * half)
                    calm = min(calm, wary[a, b] - radius - 0.5 * half)
                    seen = min(seen, unseen[a, b] - radius)
                ahead[i, j, h] = 1.0 + near_price * min(max(1.0 - (calm - clearance) / 0.4, 0.0), 2.0)
                if room < clearance - 0.1:
                    ahead[i, j, h] = TIGHT
                if seen < -SLACK:
                    dark[i, j, h] = True
    left = np.full((nx, ny, HEADINGS), np.inf)
    queue = [(0.0, np.int64(-1))]
    for i in range(nx):
        for j in range(ny):
            if begin[i, j] < np.inf:
                for h in range(HEADINGS):
                    left[i, j, h] = begin[i, j]
                    heapq.heappush(queue, (begin[i, j], np.int64((i * ny + j) * HEADINGS + h)))
    while len(queue) > 0:
        price, place = heapq.heappop(queue)
        if place < 0:
            continue
        i, j, h = int(place // HEADINGS // ny), int((place // HEADINGS) % ny), int(place % HEADINGS)
        if price > left[i, j, h]:
            continue
        length = size * math.sqrt(float(STEP_X[h] ** 2 + STEP_Y[h] ** 2))
        for way in range(4):  # from where does one come here: ahead, astern, turning either way
            p, q, g = i, j, h
            if way < 2:
                sign = -1 if way == 0 else 1
                p, q = i + sign * STEP_X[h], j + sign * STEP_Y[h]
                if p < 0 or q < 0 or p >= nx or q >= ny:
                    continue
                if way == 0:
                    cost = length * (ahead[i, j, h] + (unseen_price if dark[i, j, h] else 0.0))
                else:
                    cost = length * (ASTERN * ahead[i, j, h] + (ASTERN_UNSEEN if dark[i, j, h] else 0.0))
            else:
                g = (h + (1 if way == 2 else HEADINGS - 1)) % HEADINGS
                cost = spin[i, j]
            if price + cost < left[p, q, g]:
                left[p, q, g] = price + cost
                heapq.heappush(queue, (price + cost, np.int64((p * ny + q) * HEADINGS + g)))
    return left
