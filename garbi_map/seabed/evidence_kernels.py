"""Compiled loops over the voxels of the evidence."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit

from garbi_map.seabed.types import Verdict

HALF = 1 << 20  # a voxel's index along an axis is within +-HALF
ACCEPTED = int(Verdict.ACCEPTED)
INVALID = int(Verdict.INVALID)
UNCERTAIN = int(Verdict.UNCERTAIN)
ISOLATED = int(Verdict.ISOLATED)
SEEN_THROUGH = int(Verdict.SEEN_THROUGH)
OFF_SURFACE = int(Verdict.OFF_SURFACE)


@njit(cache=True, nogil=True)
def mixed(key):
    """A number, not negative, every low bit of which depends on all bits of a key."""
    # a product's low bits know nothing of a factor's high ones, where the key has x: fold these down first
    number = np.uint64(key)
    number = (number ^ (number >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((number ^ (number >> np.uint64(29))) >> np.uint64(1))


@njit(cache=True, nogil=True)
def slot_of(voxels, key):
    """Slot of a key in an open-addressed table, of a power of two slots: its own, or the free one to put it in."""
    mask = len(voxels) - 1
    slot = mixed(key) & mask
    while voxels[slot].key != key and voxels[slot].key != -1:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def key_of(ix, iy, iz):
    return ((ix + HALF) << 42) | ((iy + HALF) << 21) | (iz + HALF)


@njit(cache=True, nogil=True)
def observe_points(voxels, used, start, placed, verdict, profile, base, side):
    """Count accepted points from `start` on into the table; stops early when it is three quarters full.

    Returns the number of slots used and the first point not counted.
    """
    full = len(voxels) * 3 // 4
    before, slot = -1, 0
    for i in range(start, len(placed)):
        if verdict[i] != ACCEPTED:
            continue
        ix = int(np.floor(placed[i, 0] / side))
        iy = int(np.floor(placed[i, 1] / side))
        iz = int(np.floor(placed[i, 2] / side))
        key = key_of(ix, iy, iz)
        if key != before:  # neighbouring points mostly share a voxel
            before, slot = key, slot_of(voxels, key)
        voxel = voxels[slot]
        number = base + profile[i]
        if voxel.key == -1:
            if used >= full:
                return used, i
            used += 1
            voxel.key = key
            voxel.first = number
            voxel.last = number
            voxel.profiles = 1
            voxel.passer = -1
            voxel.piercer = -1
        elif voxel.last != number:
            voxel.profiles += 1
            voxel.first = min(voxel.first, number)
            voxel.last = number
        x = placed[i, 0] - (ix + 0.5) * side
        y = placed[i, 1] - (iy + 0.5) * side
        z = placed[i, 2] - (iz + 0.5) * side
        voxel.count += 1
        voxel.x += x
        voxel.y += y
        voxel.z += z
        voxel.xx += x * x
        voxel.xy += x * y
        voxel.xz += x * z
        voxel.yy += y * y
        voxel.yz += y * z
        voxel.zz += z * z
    return used, len(placed)


@njit(cache=True, nogil=True)
def rehash(old, new):
    """Move the voxels of a table into a larger, free one."""
    for i in range(len(old)):
        if old[i].key != -1:
            new[slot_of(new, old[i].key)] = old[i]


@njit(cache=True, nogil=True)
def surroundings(voxels, side, begin, surrounding, covariance, pierced):
    """Sum up the 3 x 3 x 3 voxels about each of the k voxels from slot `begin` on: all of `surrounding` but moved, normal
    and thickness, the covariance (k, 3, 3) of its points, m^2, and how many profiles pierced them (k,)."""
    low = (1 << 21) - 1
    for slot in range(begin, begin + len(covariance)):
        if voxels[slot].key == -1:
            continue
        key = voxels[slot].key
        ix, iy, iz = key >> 42, (key >> 21) & low, key & low
        count = 0
        support = 0
        hit = 0
        through = 0
        first, last = voxels[slot].first, voxels[slot].last
        m = np.zeros(9)
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    found = voxels[slot_of(voxels, ((ix + dx) << 42) | ((iy + dy) << 21) | (iz + dz))]
                    if found.key == -1:
                        continue
                    n = found.count
                    ox, oy, oz = dx * side, dy * side, dz * side
                    count += n
                    support += found.profiles
                    hit += 1
                    through += found.through
                    pierced[slot - begin] += found.pierced
                    first = min(first, found.first)
                    last = max(last, found.last)
                    m[0] += found.x + n * ox
                    m[1] += found.y + n * oy
                    m[2] += found.z + n * oz
                    m[3] += found.xx + 2 * ox * found.x + n * ox * ox
                    m[4] += found.xy + ox * found.y + oy * found.x + n * ox * oy
                    m[5] += found.xz + ox * found.z + oz * found.x + n * ox * oz
                    m[6] += found.yy + 2 * oy * found.y + n * oy * oy
                    m[7] += found.yz + oy * found.z + oz * found.y + n * oy * oz
                    m[8] += found.zz + 2 * oz * found.z + n * oz * oz
        m /= count
        about = surrounding[slot]
        about.count = count
        about.support = support
        about.voxels = hit
        about.through = through
        about.several = first != last
        about.x = m[0]
        about.y = m[1]
        about.z = m[2]
        c = covariance[slot - begin]
        c[0, 0] = m[3] - m[0] * m[0]
        c[0, 1] = c[1, 0] = m[4] - m[0] * m[1]
        c[0, 2] = c[2, 0] = m[5] - m[0] * m[2]
        c[1, 1] = m[6] - m[1] * m[1]
        c[1, 2] = c[2, 1] = m[7] - m[1] * m[2]
        c[2, 2] = m[8] - m[2] * m[2]


@njit(cache=True, nogil=True)
def first_verdicts(placed, sigma, limit, max_sigma):
    """What a point says of itself (n,): accepted so far, invalid (comparisons with NaN are false), or uncertain."""
    verdict = np.empty(len(placed), np.uint8)
    for i in range(len(placed)):
        near = abs(placed[i, 0]) < limit and abs(placed[i, 1]) < limit and abs(placed[i, 2]) < limit
        if not (near and sigma[i] > 0.0 and sigma[i] < np.inf):
            verdict[i] = INVALID
        elif sigma[i] > max_sigma:
            verdict[i] = UNCERTAIN
        else:
            verdict[i] = ACCEPTED
    return verdict


@njit(cache=True, nogil=True)
def run_lengths(points, profile, row):
    """Length of the run of neighbouring points, in rows of one profile, that each point belongs to (n,)."""
    n = len(points)
    length = np.empty(n, np.int32)
    start = 0
    for i in range(1, n + 1):
        if i < n and profile[i] == profile[i - 1] and row[i] - row[i - 1] <= 3:
            apart = 0.0
            reach = 0.0
            for k in range(3):
                apart += (points[i, k] - points[i - 1, k]) ** 2
                reach += (points[i, k] * (row[i] - row[i - 1])) ** 2
            # on a surface neighbouring rows see points that are a few thousandths of the range apart
            if apart < 2.5e-5 * reach:
                continue
        length[start:i] = i - start
        start = i
    return length


@njit(cache=True, nogil=True)
def judge_points(
    voxels,
    surrounding,
    placed,
    sigma,
    run,
    side,
    min_points,
    min_run,
    gate,
    verdict,
    gradient,
):
    """Change the verdict (n,) of accepted points that do not belong; write the surface's slope (n, 2) at the others."""
    before, slot = -1, 0
    for i in range(len(placed)):
        if verdict[i] != ACCEPTED:
            continue
        ix = int(np.floor(placed[i, 0] / side))
        iy = int(np.floor(placed[i, 1] / side))
        iz = int(np.floor(placed[i, 2] / side))
        key = key_of(ix, iy, iz)
        if key != before:
            before, slot = key, slot_of(voxels, key)
        voxel, about = voxels[slot], surrounding[slot]
        shared = about.several and about.count >= min_points and about.support >= 4
        if voxel.key == -1 or not (shared or run[i] >= min_run):
            verdict[i] = ISOLATED
            continue
        if about.moved:
            verdict[i] = SEEN_THROUGH
            continue
        off = (
            (placed[i, 0] - (ix + 0.5) * side - about.x) * about.normal_x
            + (placed[i, 1] - (iy + 0.5) * side - about.y) * about.normal_y
            + (placed[i, 2] - (iz + 0.5) * side - about.z) * about.normal_z
        )
        corroborated = voxel.first != voxel.last and 4 * voxel.profiles * about.voxels >= about.support
        if off * off > gate * gate * (sigma[i] ** 2 + about.thickness) and not corroborated and run[i] < min_run:
            verdict[i] = OFF_SURFACE
            continue
        if about.normal_z > 0.3:  # steeper than 72 degrees the spread of the cell says more than its slope
            gradient[i, 0] = -about.normal_x / about.normal_z
            gradient[i, 1] = -about.normal_y / about.normal_z
