"""The way to a goal through the local volume, and the manoeuvre that makes most of it within what has been seen.

Dijkstra's algorithm over the charts tells how long the way is from everywhere, unseen water included at a price. Then some
hundred manoeuvres are rehearsed with the water's drift: the hull may only go where water was seen free, so that a way
through the unseen draws the vehicle to where its camera shows it (compare the dynamic window of Fox et al., 1997).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from behaviours.charts import LAYER, Charts, draw
from behaviours.hull import discs, rollout_model
from behaviours.kernels_plan import cheapest, manoeuvring, trace
from behaviours.kernels_rollout import rehearse
from behaviours.moving import Mover
from behaviours.settings import TravelSettings, Vehicle
from behaviours.space import Space
from behaviours.types import Pose
from garbi_map.log.records import Floats

CLIMB_PRICE = 2.0
NEAR_PRICE, UNSEEN_PRICE = 1.5, 0.5
TRIED_PRICE = 3.0
OFF_PRICE = 0.25  # for each layer off the goal's height
OUTSIDE = 1.5  # price of a metre beyond the charts
STEP, COUNT, SOON = 0.5, 24, 13  # s, number of steps of a rehearsal, and of those that must stay in what was seen
WEIGHTS = np.array([1.0, 60.0, 0.15, 12.0, 6.0])  # way left, obstacle, wish, unseen, looking
HABIT = 0.2  # price, on surge and yaw each, of doing the contrary of what was done last
AROUND = 12  # cells of two columns to each side of the vehicle, in which its turning is planned
LOOK_AHEAD, LOOK_MOST = 2.5, 60  # m of the way, columns
LOOKED_MOST = 20_000  # columns that are remembered
PATIENCE = 5.0  # s in view, after which a column that is still unseen is hidden by something
BLIND = 0.02  # m s of the hull's outline in the unseen


@dataclass(frozen=True)
class Plan:
    """What to do for now: surge m/s, yaw rad/s, height m in odom; path (n, 3) m, odom, to the goal; why, in words; and
    whether even so some of the hull gets into unseen water."""

    surge: float
    yaw: float
    height: float
    path: Floats
    words: str
    blind: bool = False

    @property
    def heading(self) -> float:
        """rad, in which the way leads a metre on."""
        away = self.path[:, :2] - self.path[0, :2]
        far = np.flatnonzero(np.hypot(*away.T) > 1.0)
        x, y = away[far[0] if len(far) else -1]
        return float(np.arctan2(y, x))


class Planner:
    """Remembers which unseen columns it has looked at in vain."""

    def __init__(self, vehicle: Vehicle, settings: TravelSettings) -> None:
        self._vehicle, self._settings = vehicle, settings
        self._half = np.array(vehicle.hull) / 2
        self._circles, self._radius = discs(vehicle)
        self._habit = np.zeros(2)
        self._looked: dict[tuple[int, int], float] = {}
        self._model = rollout_model(vehicle)

    def plan(self, space: Space, pose: Pose, goal: Floats, current: Floats, movers: list[Mover]) -> Plan | None:
        """None: no way is known, not even through the unseen."""
        # The heights are a lattice that holds the goal's.
        middle = float(goal[2] + LAYER * np.round((pose.position[2] - goal[2]) / LAYER))
        charts = draw(space, pose, middle, self._settings, movers)
        left, path = self._way(charts, pose, goal)
        if path is None:
            return None
        view = space.view(pose.stamp_ns)
        look = self._undecided(charts, path)
        self._remember(look, pose, view, charts.voxel)
        height = self._height(path)
        guide, corner = self._guide(charts, pose, goal, height, left)
        manoeuvres = self._manoeuvres(float(pose.position[2]), height)
        state = np.array([*pose.position, pose.heading, pose.velocity[0], pose.velocity[1], pose.rate[2]])
        moving = np.array([[*one.at(pose.stamp_ns), *one.velocity, one.radius] for one in movers]).reshape(-1, 7)
        margins = np.array([self._settings.clearance, 0.4, 0.5])
        price, parts = rehearse(
            state, current, manoeuvres, STEP, COUNT, SOON, self._model, charts.heights, charts.low, charts.voxel,
            charts.occupied, charts.wary, charts.unseen, guide, 2 * charts.voxel, corner,
            self._circles, self._radius, margins, moving, look, view, WEIGHTS,
        )  # fmt: skip
        price = price - HABIT * (np.sign(manoeuvres[:, :2]) == self._habit).sum(1)
        best = int(np.argmin(price))
        self._habit = np.sign(manoeuvres[best, :2])
        surge, yaw, _, _, _, rise = manoeuvres[best]
        way, near, blind, seen = parts[best]
        words = f"{way:.1f} m of way would be left"
        if len(look):
            words += f", {100 * seen:.0f} % of what is unseen on the way in view"
        if near > 0.02:
            words += ", too near to something"
        if blind > BLIND:
            words += ", carried into the unseen"
        return Plan(float(surge), float(yaw), float(rise), path, words, bool(blind > BLIND))

    def _way(self, charts: Charts, pose: Pose, goal: Floats) -> tuple[Floats, Floats | None]:
        """m of way left from every second column (layers, nx / 2, ny / 2); and the path."""
        occupied, wary, unseen = (chart[:, ::2, ::2] for chart in (charts.occupied, charts.wary, charts.unseen))
        n, i, j = charts.column(pose.position)
        own = np.array([n, i // 2, j // 2], np.int64)
        a, b = np.ogrid[: occupied.shape[1], : occupied.shape[2]]
        width = self._half[1] + 0.5 * charts.voxel
        cost = 1.0 + UNSEEN_PRICE * (unseen < width)
        if self._looked:
            tried = np.array([key for key, seconds in self._looked.items() if seconds > PATIENCE], np.int64)
            tried = tried.reshape(-1, 2)
            tried = (tried - charts.low) // 2
            tried = tried[((tried >= 0) & (tried < cost.shape[1:])).all(1)]
            cost[:, tried[:, 0], tried[:, 1]] += TRIED_PRICE * (unseen[:, tried[:, 0], tried[:, 1]] < width)
        cost += NEAR_PRICE * np.clip(1.0 - (wary - width - self._settings.clearance) / 0.4, 0.0, 2.0)
        cost[occupied < width + 0.05] = np.inf
        around = cost[:, max(own[1] - 2, 0) : own[1] + 3, max(own[2] - 2, 0) : own[2] + 3]
        around[np.isinf(around)] = 12.0  # the vehicle is here, however near: it has to get out
        n, i, j = charts.column(goal)
        target = np.array([n, i // 2, j // 2], np.int64)
        off = np.abs(np.arange(len(cost)) - n)
        cost += OFF_PRICE * off[:, None, None]  # at the goal's height sooner, not later
        begin = np.full(cost.shape, np.inf)
        cost[target[0], target[1], target[2]] = min(cost[target[0], target[1], target[2]], 12.0)
        edge = np.zeros(cost.shape[1:], bool)
        edge[[0, -1]], edge[:, [0, -1]] = True, True
        if edge[target[1], target[2]]:  # the goal lies outside, or as good as
            rest = np.hypot(*(self._middles(charts, a, b) - goal[:2, None, None])) / (2 * charts.voxel)
            begin[:, edge] = OUTSIDE * rest[edge] + 2 * CLIMB_PRICE * off[:, None]
        else:
            begin[target[0], target[1], target[2]] = 0.0
            begin[target[0]][self._there(charts, a, b, goal) & np.isfinite(cost[target[0]])] = 0.0
        reached, parent = cheapest(cost.astype(np.float32), begin, CLIMB_PRICE)
        left = np.where(np.isfinite(reached), reached * 2 * charts.voxel, 1e7)
        if not np.isfinite(reached[own[0], own[1], own[2]]):
            return left, None
        cells = trace(parent, own)[::-1]
        path = np.empty((len(cells), 3))
        path[:, :2] = (charts.low + 2 * cells[:, 1:] + 0.5) * charts.voxel
        path[:, 2] = charts.heights[cells[:, 0]]
        return left, path

    @staticmethod
    def _middles(charts: Charts, i: NDArray[np.int64], j: NDArray[np.int64]) -> Floats:
        """m, odom, of the columns from which cells of two are taken: (2, nx, ny)."""
        east, north = np.broadcast_arrays(charts.low[0] + 2 * i + 0.5, charts.low[1] + 2 * j + 0.5)
        return np.stack([east, north]) * charts.voxel

    def _there(self, charts: Charts, i: NDArray[np.int64], j: NDArray[np.int64], goal: Floats) -> NDArray[np.bool_]:
        """Which cells of two columns are as good as the goal."""
        away = self._middles(charts, i, j) - goal[:2, None, None]
        return np.asarray(np.hypot(*away) < self._settings.arrived - charts.voxel)

    def _guide(self, charts: Charts, pose: Pose, goal: Floats, height: float, left: Floats) -> tuple[Floats, Floats]:
        """m of way left (nx, ny, headings) about the vehicle, its turning included; and the corner (2,) m, odom."""
        n, i, j = charts.column(np.array([*pose.position[:2], height]))
        first = np.clip(np.array([i, j]) // 2 - AROUND, 0, np.array(left.shape[1:]) - 2 * AROUND)
        cells = tuple(slice(f, f + 2 * AROUND) for f in first)
        columns = tuple(slice(2 * f, 2 * f + 4 * AROUND) for f in first)
        begin = np.full((2 * AROUND, 2 * AROUND), np.inf)
        rest = np.where(left[n][cells] < 1e6, left[n][cells], np.inf)
        for edge in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
            begin[edge] = rest[edge]
        _, i, j = charts.column(goal)
        own = np.array([i, j]) // 2 - first
        if (own > 0).all() and (own < 2 * AROUND - 1).all():
            begin[own[0], own[1]] = rest[own[0], own[1]]
            a, b = np.ogrid[cells]
            there = self._there(charts, a, b, goal)
            begin[there] = rest[there]
        settings = self._settings
        guide = manoeuvring(
            begin, 2 * charts.voxel, np.ascontiguousarray(charts.occupied[n][columns]),
            np.ascontiguousarray(charts.wary[n][columns]), np.ascontiguousarray(charts.unseen[n][columns]),
            self._circles, self._radius, settings.clearance, NEAR_PRICE, UNSEEN_PRICE,
        )  # fmt: skip
        # A cell stands for the first of its two columns: its middle is half a column on.
        return guide, (charts.low + 2 * first - 0.5) * charts.voxel

    def _undecided(self, charts: Charts, path: Floats) -> Floats:
        """(l, 2) m, odom: unseen columns that a hull on the way would meet, the first of them."""
        found: list[Floats] = []
        offsets = np.arange(-self._radius, self._radius + 0.01, charts.voxel)
        dx, dy = (part.ravel() for part in np.meshgrid(offsets, offsets))
        disc = np.stack([dx, dy], 1)[np.hypot(dx, dy) <= self._radius]
        gone = 0.0
        for here, there in itertools.pairwise(path):
            gone += float(np.linalg.norm(there[:2] - here[:2]))
            if gone > LOOK_AHEAD:
                break
            n, i, j = charts.column(there)
            if charts.unseen[n, i, j] >= self._radius:
                continue
            index = np.floor((there[:2] + disc) / charts.voxel).astype(np.int64) - charts.low
            index = index[((index >= 0) & (index < charts.unseen.shape[1:])).all(1)]
            dark = index[charts.unseen[n, index[:, 0], index[:, 1]] == 0.0]
            found.append((dark + charts.low + 0.5) * charts.voxel)
        if not found:
            return np.empty((0, 2))
        columns = np.unique(np.concatenate(found), axis=0)
        tried = np.array([self._looked.get(key, 0.0) > PATIENCE for key in self._keys(columns, charts.voxel)], bool)
        columns = columns[~tried]
        return np.ascontiguousarray(columns[:: -(-len(columns) // LOOK_MOST)] if len(columns) else columns)

    @staticmethod
    def _keys(columns: Floats, voxel: float) -> list[tuple[int, int]]:
        return [(int(i), int(j)) for i, j in np.floor(columns / voxel)]

    def _remember(self, look: Floats, pose: Pose, view: Floats, voxel: float) -> None:
        """For how long each column has been in view without becoming known."""
        if len(self._looked) > LOOKED_MOST:
            self._looked.clear()
        away = (look - pose.position[:2]) @ np.array(
            [[np.cos(pose.heading), -np.sin(pose.heading)], [np.sin(pose.heading), np.cos(pose.heading)]]
        ) - [view[0], 0.0]
        within = (away[:, 0] > view[2]) & (away[:, 0] < view[3])
        within &= np.abs(np.arctan2(away[:, 1], away[:, 0])) < view[1]
        for key in self._keys(look[within], voxel):
            self._looked[key] = self._looked.get(key, 0.0) + self._settings.replan

    @staticmethod
    def _height(path: Floats) -> float:
        """The height of the way half a metre on."""
        gone = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))]
        return float(path[min(int(np.searchsorted(gone, 0.6)), len(path) - 1), 2])

    def _manoeuvres(self, height: float, wanted: float) -> Floats:
        """(m, 6), see `rehearse`: two pieces each; the first one is what is done now."""
        speed, rate = self._settings.speed, min(0.3, self._vehicle.limits[2])
        astern = -min(0.12, self._vehicle.astern)
        heights = [wanted] if abs(wanted - height) < 0.1 else [wanted, height]
        grid = np.meshgrid(
            np.array([astern, 0.0, 0.5 * speed, speed]),
            rate * np.array([-1.0, -0.4, 0.0, 0.4, 1.0]),
            np.array([1.5, 3.0, 5.0]),
            np.array([astern, 0.0, speed]),
            rate * np.array([-0.8, 0.0, 0.8]),
            np.array(heights),
            indexing="ij",
        )
        return np.stack([axis.ravel() for axis in grid], 1)
