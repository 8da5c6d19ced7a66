"""Compiled rehearsal of manoeuvres: where the vehicle would get, the water carrying it, and what that would cost."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from behaviours.kernels_charts import FAR
from behaviours.kernels_plan import SLACK
from garbi_map.log.records import Floats

INF = 1e6
GLANCE = 4  # steps between those at which the view is judged
STILL = 0.02  # m/s, a current that carries the vehicle nowhere
# steps of turning into the current, at most; rad/s; rad from it, that end it
TURNING, TURN_RATE, TURNED = 14, 0.25, 0.3


@njit(cache=True, nogil=True, inline="always")
def moved_on(x, y, heading, surge, sway, rate, wanted_surge, wanted_rate, current, step, model):  # type: ignore[no-untyped-def]
    """Place m, heading rad, speeds m/s and yaw rate rad/s after a step s: surge and yaw follow what is wanted with the lags
    of `model` (see rehearse), and abeam, where nothing drives it, the vehicle goes with the water and skids in turns."""
    surge += (wanted_surge - surge) * min(step / model[0], 1.0)
    rate += (wanted_rate - rate) * min(step / model[1], 1.0)
    cos, sin = math.cos(heading), math.sin(heading)
    sway += step * ((-sin * current[0] + cos * current[1] - sway) / model[2] - model[3] * surge * rate)
    x += step * (cos * surge - sin * sway)
    y += step * (sin * surge + cos * sway)
    return x, y, heading + step * rate, surge, sway, rate


@njit(cache=True, nogil=True, inline="always")
def _at(chart, voxel, low, x, y, outside):  # type: ignore[no-untyped-def]
    """The value of the column (nx, ny) that (x, y) is in."""
    i, j = math.floor(x / voxel) - low[0], math.floor(y / voxel) - low[1]
    if i < 0 or j < 0 or i >= chart.shape[0] or j >= chart.shape[1]:
        return outside
    return chart[i, j]


@njit(cache=True, nogil=True)
def _left(guide, size, corner, x, y, heading):  # type: ignore[no-untyped-def]
    """The guide (nx, ny, headings) at a place and heading, linear between those that can be; INF where none can."""
    a, b = (x - corner[0]) / size - 0.5, (y - corner[1]) / size - 0.5
    out = max(-a, 0.0) + max(a - guide.shape[0] + 1, 0.0) + max(-b, 0.0) + max(b - guide.shape[1] + 1, 0.0)
    a, b = min(max(a, 0.0), guide.shape[0] - 1.001), min(max(b, 0.0), guide.shape[1] - 1.001)
    headings = guide.shape[2]
    c = (heading / (2 * math.pi) * headings) % headings
    i, j, h = int(a), int(b), int(c)
    total, weight = 0.0, 0.0
    for p in range(2):
        for q in range(2):
            for r in range(2):
                value = guide[i + p, j + q, (h + r) % headings]
                if value < INF:
                    w = (1.0 - abs(a - i - p)) * (1.0 - abs(b - j - q)) * (1.0 - abs(c - h - r)) + 1e-6
                    total += w * value
                    weight += w
    return total / weight + 2.0 * size * out if weight > 0.0 else INF


@njit(cache=True, nogil=True)
def _share_in_view(look, x, y, cos, sin, view):  # type: ignore[no-untyped-def]
    """Of the columns (l, 2), from a camera at (x, y)."""
    if len(look) == 0:
        return 0.0
    shown, wide = 0, math.tan(view[1])
    for one in range(len(look)):
        dx, dy = look[one, 0] - x, look[one, 1] - y
        forward, across = cos * dx + sin * dy, cos * dy - sin * dx
        if view[2] < forward < view[3] and abs(across) < wide * forward:
            shown += 1
    return shown / len(look)


@njit(cache=True, nogil=True)
def _turning_in(x, y, heading, surge, sway, rate, current, step, model, chart, voxel, low, circles, radius, margin):  # type: ignore[no-untyped-def]
    """m s by which the hull comes nearer than a margin m to the occupied while it turns its nearer end into the current, at
    TURN_RATE, from where a manoeuvre leaves it: water carries what lies broadside to it, see behaviours.leeway."""
    if current[0] ** 2 + current[1] ** 2 < STILL**2:
        return 0.0
    up, hit = math.atan2(-current[1], -current[0]), 0.0
    for _ in range(TURNING):
        off = (up - heading + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        if abs(off) < TURNED:
            break
        wanted = TURN_RATE if off > 0.0 else -TURN_RATE
        x, y, heading, surge, sway, rate = moved_on(x, y, heading, surge, sway, rate, 0.0, wanted, current, step, model)
        cos, sin, near = math.cos(heading), math.sin(heading), INF
        for k in range(len(circles)):
            near = min(near, _at(chart, voxel, low, x + cos * circles[k], y + sin * circles[k], FAR))
        hit += step * max(margin - (near - radius - 0.5 * voxel), 0.0)
    return hit


@njit(cache=True, nogil=True)
def rehearse(
    state: Floats,
    current: Floats,
    manoeuvres: Floats,
    step: float,
    count: int,
    soon: int,
    model: Floats,
    heights: Floats,
    low: NDArray[np.int64],
    voxel: float,
    occupied: NDArray[np.float32],
    wary: NDArray[np.float32],
    unseen: NDArray[np.float32],
    guide: Floats,
    size: float,
    corner: Floats,
    circles: Floats,
    radius: float,
    margins: Floats,
    movers: Floats,
    look: Floats,
    view: Floats,
    weights: Floats,
) -> tuple[Floats, Floats]:
    """Price (m,) of each manoeuvre, and (m, 4) what it is made of: way left m, obstacle m s, unseen m s, share seen.

    state       (7,) x y z m, heading rad, surge and sway over ground m/s, yaw rate rad/s
    current     (2,) m/s, odom
    manoeuvres  (m, 6) surge, yaw, for how many s; surge and yaw for the rest; height to reach, m
    step, count, soon  s, number of steps, and of those in which the hull must not get into the unseen
    model       (4,) lag of surge s, of yaw s, of sway s, share of surge times yaw rate that becomes sway
    heights, low, voxel, occupied, wary, unseen  see Charts
    guide       (nx, ny, headings) m of way left, of cells of `size` m from `corner` (2,) m, odom, on
    circles     (k,) m along the hull, of discs of that radius that cover it
    margins     (3,) m: kept from the occupied, wished for beyond it, kept from what moves
    movers      (j, 7) place m, velocity m/s, odom, radius m
    look        (l, 2) columns whose state decides on the way, m, odom
    view        (4,) camera before base_link m, half angle rad, nearest and farthest m at which the whole hull's height shows
    weights     (5,) of way left, obstacle, wish, unseen, looking
    """
    total, glances = manoeuvres.shape[0], count // GLANCE
    price = np.zeros(total)
    parts = np.zeros((total, 4))
    for m in range(total):
        x, y, z, heading, surge, sway, rate = state
        hit, wish, blind, least, mean, seen = 0.0, 0.0, 0.0, INF, 0.0, 0.0
        layer, left, arrested, deep = 0, INF, False, 0.0
        for n in range(count):
            first = (n + 0.5) * step <= manoeuvres[m, 2]
            wanted_surge = manoeuvres[m, 0] if first else manoeuvres[m, 3]
            wanted_rate = manoeuvres[m, 1] if first else manoeuvres[m, 4]
            x, y, heading, surge, sway, rate = moved_on(
                x, y, heading, surge, sway, rate, wanted_surge, wanted_rate, current, step, model
            )
            z += step * min(max(0.5 * (manoeuvres[m, 5] - z), -0.1), 0.1)
            layer = min(max(int(math.floor((z - heights[0]) / (heights[1] - heights[0]) + 0.5)), 0), len(heights) - 1)
            cos, sin = math.cos(heading), math.sin(heading)
            near, calm, dark = INF, INF, INF
            for k in range(len(circles)):
                px, py = x + cos * circles[k], y + sin * circles[k]
                near = min(near, _at(occupied[layer], voxel, low, px, py, FAR) - radius - 0.5 * voxel)
                calm = min(calm, _at(wary[layer], voxel, low, px, py, FAR) - radius - 0.5 * voxel)
                dark = min(dark, _at(unseen[layer], voxel, low, px, py, 0.0) - radius)
                for j in range(len(movers)):
                    if abs(movers[j, 2] + (n + 1) * step * movers[j, 5] - z) > movers[j, 6] + 0.8:
                        continue
                    mx = movers[j, 0] + (n + 1) * step * movers[j, 3] - px
                    my = movers[j, 1] + (n + 1) * step * movers[j, 4] - py
                    gap = math.sqrt(mx * mx + my * my) - movers[j, 6] - radius
                    hit += step * max(margins[2] - gap, 0.0)
            hit += step * max(margins[0] - near, 0.0)
            wish += step * min(max(1.0 - (calm - margins[0]) / margins[1], 0.0), 1.5)
            if n < soon:  # farther on there is time for another look
                blind += step * (max(-dark - deep, 0.0) + 0.05 * max(-dark, 0.0))
            if n == 0:
                deep = max(-dark, SLACK)  # water may have carried it into the unseen already: not farther
            arrested = arrested or -dark > deep + 0.05  # what lies in the unseen is no way made
            if not arrested or n == 0:
                left = _left(guide, size, corner, x, y, heading)
            least = min(least, left)
            mean += left / count
            if n % GLANCE == GLANCE - 1:
                seen += _share_in_view(look, x + cos * view[0], y + sin * view[0], cos, sin, view)
        hit += _turning_in(
            x, y, heading, surge, sway, rate, current, step, model, occupied[layer], voxel, low, circles, radius,
            margins[0],
        )  # fmt: skip
        seen /= glances
        parts[m, 0], parts[m, 1], parts[m, 2], parts[m, 3] = least, hit, blind, seen
        price[m] = (
            weights[0] * (least + mean) + weights[1] * hit + weights[2] * wish + weights[3] * blind - weights[4] * seen
        )
    return price, parts
