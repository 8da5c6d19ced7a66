"""Compiled rehearsal of escapes: how near would what moves come if the vehicle did this or that."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from behaviours.kernels import FREE, OCCUPIED, _inside, _kind
from behaviours.kernels_rollout import moved_on
from garbi_map.log.records import Floats

MOST_DOUBT = 0.4  # m: more would bar all ways


@njit(cache=True, nogil=True)
def _barred(x, y, z, heading, shell, room, voxel, low, shape, least, assumed_free_above, layers, dare):  # type: ignore[no-untyped-def]
    """How many points (p, 3), base_link, of the hull would not be in water that was seen free, or those about it in
    something that was hit; dare: the unseen does not count."""
    free_ms, _, _, hits, _, _, _, _ = layers
    cos, sin = math.cos(heading), math.sin(heading)
    count = 0
    for p in range(len(shell)):
        i = math.floor((x + cos * shell[p, 0] - sin * shell[p, 1]) / voxel)
        j = math.floor((y + sin * shell[p, 0] + cos * shell[p, 1]) / voxel)
        k = math.floor((z + shell[p, 2]) / voxel)
        if not _inside(i, j, k, low, shape):
            count += not dare
            continue
        a, b, c = i % shape[0], j % shape[1], k % shape[2]
        kind = _kind(a, b, c, k, voxel, least, assumed_free_above, free_ms, hits)
        if kind == OCCUPIED or (kind != FREE and not dare):
            count += 1
            continue
        i = math.floor((x + cos * room[p, 0] - sin * room[p, 1]) / voxel)
        j = math.floor((y + sin * room[p, 0] + cos * room[p, 1]) / voxel)
        k = math.floor((z + room[p, 2]) / voxel)
        if _inside(i, j, k, low, shape) and hits[i % shape[0], j % shape[1], k % shape[2]] >= least:
            count += 1
    return count


@njit(cache=True, nogil=True, inline="always")
def _gap(mover, t, doubtful, x, y, z, cos, sin, half):  # type: ignore[no-untyped-def]
    """m between the hull and one of the movers (9,) in t s, less the doubt after `doubtful` s; where it is, base_link."""
    dx, dy, dz = mover[0] + t * mover[3] - x, mover[1] + t * mover[4] - y, mover[2] + t * mover[5] - z
    bx, by = cos * dx + sin * dy, cos * dy - sin * dx
    qx, qy, qz = max(abs(bx) - half[0], 0.0), max(abs(by) - half[1], 0.0), max(abs(dz) - half[2], 0.0)
    return math.sqrt(qx * qx + qy * qy + qz * qz) - mover[6] - min(mover[7] + doubtful * mover[8], MOST_DOUBT), bx, by


@njit(cache=True, nogil=True)
def flee(
    state: Floats,
    current: Floats,
    manoeuvres: Floats,
    step: float,
    count: int,
    model: Floats,
    half: Floats,
    shell: Floats,
    room: Floats,
    movers: Floats,
    most: float,
    voxel: float,
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    least: int,
    assumed_free_above: float,
    layers: tuple,
    dare: bool,
) -> Floats:
    """(m, 4) of each manoeuvre: least gap between hull and what moves, m, less the doubt of where that will be; the mean of
    that gap, `most` m at most; share of the time in which the nearest of them is before the bow; least gap afterwards, at
    rest, for twice as long.

    state       (8,) x y z m, heading rad, surge, sway, heave over ground m/s, yaw rate rad/s
    current     (2,) m/s, odom
    manoeuvres  (m, 5) surge, yaw rate, for how many s; surge for the rest, straight on; heave throughout
    step, count s, number of steps
    model       (4,) lag of surge and heave s, of yaw s, of sway s, share of surge times yaw rate that becomes sway
    half        (3,) m, of the hull; shell (p, 3) points all over it, base_link; room (p, 3) as many at the distance that is
                kept from what stands
    movers      (j, 9) place m, velocity m/s, odom, radius m, doubt of the place m, and its growth m/s
    voxel ...   the local volume, see behaviours.kernels: where the hull would leave what was seen free it stands still
    dare        it does so only where the hull would meet something
    """
    found = np.empty((len(manoeuvres), 4))
    for m in range(len(manoeuvres)):
        x, y, z, heading, surge, sway, heave, rate = state
        nearest, mean, before = 1e6, 0.0, 0
        barred = _barred(x, y, z, heading, shell, room, voxel, low, shape, least, assumed_free_above, layers, dare)
        for n in range(count):
            first = (n + 0.5) * step <= manoeuvres[m, 2]
            wanted_surge = manoeuvres[m, 0] if first else manoeuvres[m, 3]
            wanted_rate = manoeuvres[m, 1] if first else 0.0
            px, py, turned, surge, sway, rate = moved_on(
                x, y, heading, surge, sway, rate, wanted_surge, wanted_rate, current, step, model
            )
            heave += (manoeuvres[m, 4] - heave) * min(step / model[0], 1.0)
            pz = z + step * heave
            now = _barred(px, py, pz, turned, shell, room, voxel, low, shape, least, assumed_free_above, layers, dare)
            if now > barred:  # safety will not let it; water carries it abeam all the same
                surge, heave, rate = 0.0, 0.0, 0.0
                x, y = x - step * math.sin(heading) * sway, y + step * math.cos(heading) * sway
                now = _barred(x, y, z, heading, shell, room, voxel, low, shape, least, assumed_free_above, layers, dare)
            else:
                x, y, z, heading = px, py, pz, turned
            barred = now
            cos, sin = math.cos(heading), math.sin(heading)
            least_now, ahead = 1e6, False
            for j in range(len(movers)):
                t = (n + 1) * step
                gap, bx, by = _gap(movers[j], t, t, x, y, z, cos, sin, half)
                if gap < least_now:
                    least_now, ahead = gap, bx > half[0] and abs(by) < 0.6 * bx
            nearest = min(nearest, least_now)
            mean += min(least_now, most) / count
            before += ahead
        after = 1e6  # once it rests
        for n in range(count, 3 * count):
            for j in range(len(movers)):
                after = min(after, _gap(movers[j], n * step, count * step, x, y, z, cos, sin, half)[0])
        found[m, 0], found[m, 1], found[m, 2], found[m, 3] = nearest, mean, before / count, after
    return found
