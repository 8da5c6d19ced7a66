"""The path that the vehicle is asked to follow, as a function of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats
from tools.simulator.scenario import Route

ARC_SPEED = 0.6  # of the speed on a lane: a vehicle without sway slides outwards on a narrow arc


@dataclass(frozen=True)
class Reference:
    """Where the vehicle should be: time (n,) s, position (n, 2) m in map, heading (n,) rad unwrapped, speed (n,) m/s
    along the heading, negative where it reverses."""

    time: Floats
    position: Floats
    heading: Floats
    speed: Floats

    def at(self, time: float) -> tuple[float, float, float, float, float]:
        """x, y, heading, speed and turn rate (rad/s) at one time; held at both ends."""
        i = min(max(int(np.searchsorted(self.time, time, side="right")), 1), len(self.time) - 1)
        step = self.time[i] - self.time[i - 1]
        w = min(max((time - self.time[i - 1]) / step, 0.0), 1.0)
        x, y = self.position[i - 1] * (1 - w) + self.position[i] * w
        heading = self.heading[i - 1] * (1 - w) + self.heading[i] * w
        over = time > self.time[-1]
        turn = 0.0 if over else (self.heading[i] - self.heading[i - 1]) / step
        return float(x), float(y), float(heading), 0.0 if over else float(self.speed[i]), float(turn)


def plan(route: Route, duration: float) -> Reference:
    """The reference of a route, long enough for `duration` seconds; lanes are flown again from the start if need be."""
    step = 0.02  # m
    if route.kind == "station":
        return _reference(np.zeros((2, 2)), np.full(2, route.heading), np.zeros(2), np.array([0.0, duration]), route)
    if route.kind == "straight":
        s = np.arange(0.0, duration * route.speed + 2 * step, step)
        points = np.stack([s - s[-1] / 2, np.zeros_like(s)], 1)
        return _travel(points, np.zeros(len(s)), np.ones(len(s)), route)
    lane = _shuttle if route.kind == "shuttle" else _lane
    pieces = []
    travelled = 0.0
    number = 0
    while travelled < duration * route.speed + route.length:
        pieces.append(lane(route, number, step))
        travelled += len(pieces[-1][0]) * step
        number += 1
    points, heading, sign = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return _travel(points, heading, sign, route)


def _lane(route: Route, number: int, step: float) -> tuple[Floats, Floats, Floats]:
    """One lane of a lawnmower and the half circle to the next; after the last lane the pattern is flown back."""
    there, k = divmod(number, max(route.lanes - 1, 1))
    index = k if there % 2 == 0 else route.lanes - 1 - k
    up = 1.0 if there % 2 == 0 else -1.0
    y = (index - (route.lanes - 1) / 2) * route.spacing
    way = 1.0 if number % 2 == 0 else -1.0
    x = np.arange(-route.length / 2, route.length / 2, step) * way
    points = np.stack([x, np.full(len(x), y)], 1)
    # Unwrapped: a turn to the left adds half a turn, one to the right takes it away.
    base = sum(_turn_sign(route, n) * np.pi for n in range(number))
    heading = np.full(len(x), base)
    if route.lanes == 1:
        up = 1.0 if number % 2 == 0 else -1.0
    radius = route.spacing / 2
    angle = np.arange(0.0, np.pi, step / radius)
    arc = np.stack([way * (route.length / 2 + radius * np.sin(angle)), y + up * radius * (1 - np.cos(angle))], 1)
    turned = base + _turn_sign(route, number) * angle
    return (
        np.concatenate([points, arc]),
        np.concatenate([heading, turned]),
        np.r_[np.ones(len(points)), np.full(len(arc), ARC_SPEED)],
    )


def _turn_sign(route: Route, number: int) -> float:
    """+1 where the half circle after lane `number` turns left."""
    there = number // max(route.lanes - 1, 1)
    up = 1.0 if there % 2 == 0 else -1.0
    way = 1.0 if number % 2 == 0 else -1.0
    return way * up


def _shuttle(route: Route, number: int, step: float) -> tuple[Floats, Floats, Floats]:
    """One leg, ahead or astern; the heading opens a fan so that a vehicle without sway comes to a new line."""
    ahead = number % 2 == 0
    slope = np.tan(route.fan)
    s = np.arange(0.0, route.length, step)
    x = -route.length / 2 + (s if ahead else route.length - s)
    y = (number // 2) * 2 * route.length * slope + (s if ahead else s + route.length) * slope
    heading = np.full(len(s), route.fan if ahead else -route.fan)
    blend = min(1.0, 0.4 / route.length)
    turn = np.clip((s - route.length * (1 - blend)) / (route.length * blend), 0, 1)
    heading = heading * (1 - 2 * turn)
    return np.stack([x, y], 1), heading, np.full(len(s), 1.0 if ahead else -1.0)


def _travel(points: Floats, heading: Floats, sign: Floats, route: Route) -> Reference:
    """Points at the route's speed times `sign` (negative astern), turned and moved to where the route lies."""
    pace = np.linalg.norm(np.diff(points, axis=0), axis=1) / (route.speed * np.abs(sign[1:]))
    keep = np.r_[True, pace > 1e-9]
    time = np.r_[0.0, np.cumsum(pace)]
    return _reference(points[keep], heading[keep] + route.heading, sign[keep] * route.speed, time[keep], route)


def _reference(points: Floats, heading: Floats, speed: Floats, time: Floats, route: Route) -> Reference:
    c, s = np.cos(route.heading), np.sin(route.heading)
    position = points @ np.array([[c, s], [-s, c]]) + route.centre
    return Reference(time, position, heading, speed)
