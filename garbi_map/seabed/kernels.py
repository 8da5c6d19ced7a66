"""Compiled loops over points, cells and voxels."""
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
def place_points(points, profile, rotation, position):
    """Points (n, 3) of the rig frame into `map` by their profile's rotation (m, 3, 3) and position (m, 3)."""
    placed = np.empty_like(points)
    for i in range(len(points)):
        r = rotation[profile[i]]
        t = position[profile[i]]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            placed[i, k] = r[k, 0] * x + r[k, 1] * y + r[k, 2] * z + t[k]
    return placed


@njit(cache=True, nogil=True)
def _pose_variance(covariance, d, lever):
    """Variance along d of a point at `lever` from base_link, all in `map`: j' P j with j = (d, lever x d)."""
    j = (
        d[0],
        d[1],
        d[2],
        lever[1] * d[2] - lever[2] * d[1],
        lever[2] * d[0] - lever[0] * d[2],
        lever[0] * d[1] - lever[1] * d[0],
    )
    total = 0.0
    for a in range(6):
        row = 0.0
        for b in range(6):
            row += covariance[a, b] * j[b]
        total += j[a] * row
    return max(total, 0.0)


@njit(cache=True, nogil=True)
def point_errors(placed, profile, sigma, rig_position, base_position, covariance, gradient):
    """What the errors of a point mean along its ray and for the elevation.

    gradient (n, 2) is the slope of the surface at each point: where it is steep, an error sideways is one of elevation.
    Returns the sigma along the ray (n,) m, the variance of the elevation by the point's own noise (n,) m^2, and the
    deviation of the elevation by the pose (n,) m.
    """
    n = len(placed)
    along = np.empty(n, np.float32)
    noise = np.empty(n)
    pose = np.empty(n)
    for i in range(n):
        k = profile[i]
        ray = (
            placed[i, 0] - rig_position[k, 0],
            placed[i, 1] - rig_position[k, 1],
            placed[i, 2] - rig_position[k, 2],
        )
        scale = 1.0 / max(np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]), 1e-9)
        ray = (ray[0] * scale, ray[1] * scale, ray[2] * scale)
        lever = (
            placed[i, 0] - base_position[k, 0],
            placed[i, 1] - base_position[k, 1],
            placed[i, 2] - base_position[k, 2],
        )
        up = (-gradient[i, 0], -gradient[i, 1], 1.0)
        own = float(sigma[i])
        along[i] = np.sqrt(own * own + _pose_variance(covariance[k], ray, lever))
        noise[i] = (own * (ray[0] * up[0] + ray[1] * up[1] + ray[2] * up[2])) ** 2
        pose[i] = np.sqrt(_pose_variance(covariance[k], up, lever))
    return along, noise, pose


# --- the elevation grid


@njit(cache=True, nogil=True)
def _add_point(cell, z, noise_variance, pose_deviation, intensity):
    """Take a point into the memory of one sweep (West's weighted update); what `_seal` closes is open until then."""
    weight = 1.0 / (noise_variance + pose_deviation * pose_deviation)
    total = cell.weight + weight
    share = weight / total
    step = z - cell.z
    cell.count += 1
    cell.z += share * step
    cell.within += weight * step * (z - cell.z)
    cell.within_expected += weight * noise_variance
    cell.noise += weight * weight * noise_variance
    cell.pose += weight * pose_deviation
    cell.intensity += share * (intensity - cell.intensity)
    cell.weight = total


@njit(cache=True, nogil=True)
def _seal(cell):
    """Close the memory of one sweep: its pose errors are one error."""
    cell.sweeps = 1
    cell.pose = cell.pose * cell.pose
    cell.between_noise = cell.noise / cell.weight
    cell.between_pose = cell.pose / cell.weight
    cell.within_expected -= cell.between_noise


@njit(cache=True, nogil=True)
def _merge_cell(into, other):
    """Two sealed memories, of different sweeps, become one (pairwise update of Chan, Golub and LeVeque)."""
    total = into.weight + other.weight
    share = other.weight / total
    step = other.z - into.z
    into.count += other.count
    into.sweeps += other.sweeps
    into.z += share * step
    into.noise += other.noise
    into.pose += other.pose
    into.within += other.within
    into.within_expected += other.within_expected
    into.between += other.between + step * step * into.weight * share
    into.between_noise += other.between_noise
    into.between_pose += other.between_pose
    into.intensity += share * (other.intensity - into.intensity)
    into.weight = total


@njit(cache=True, nogil=True)
def tile_span(placed, chosen, cell_side, tile):
    """Index of the first tile, of tile x tile cells, along x and y in which a chosen point lies, and of the last (2,)."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(len(placed)):
        if chosen[i]:
            for k in range(2):
                low[k] = min(low[k], placed[i, k])
                high[k] = max(high[k], placed[i, k])
    return (np.floor(low / cell_side) // tile).astype(np.int64), (np.floor(high / cell_side) // tile).astype(np.int64)


@njit(cache=True, nogil=True)
def mark_tiles(placed, chosen, cell_side, tile, first, marked):
    """Set marked[a, b] for every tile of tile x tile cells, counted from `first`, in which a chosen point lies."""
    for i in range(len(placed)):
        if chosen[i]:
            column = int(np.floor(placed[i, 0] / cell_side))
            row = int(np.floor(placed[i, 1] / cell_side))
            marked[column // tile - first[0], row // tile - first[1]] = True


@njit(cache=True, nogil=True)
def fuse_sweep(placed, chosen, gradient, noise, pose, intensity, floor, cell_side, first, slot_of, cells, entry_of):
    """Take the chosen points of one sweep into the grid.

    slot_of (a, b) finds the slot of a tile counted from tile `first`; cells (slots, tile, tile) of CELL, first index
    along x; entry_of, of the same shape, is -1 everywhere before and after: it finds a cell's memory of this sweep.
    """
    tile = cells.shape[1]
    own = np.zeros(np.count_nonzero(chosen), cells.dtype)
    home = np.empty((len(own), 3), np.int32)
    used = 0
    for i in range(len(placed)):
        if not chosen[i]:
            continue
        column = int(np.floor(placed[i, 0] / cell_side))
        row = int(np.floor(placed[i, 1] / cell_side))
        slot = slot_of[column // tile - first[0], row // tile - first[1]]
        a, b = column % tile, row % tile
        entry = entry_of[slot, a, b]
        if entry < 0:
            entry = used
            entry_of[slot, a, b] = used
            home[used, 0], home[used, 1], home[used, 2] = slot, a, b
            used += 1
        _add_point(
            own[entry],
            placed[i, 2]
            + gradient[i, 0] * ((column + 0.5) * cell_side - placed[i, 0])
            + gradient[i, 1] * ((row + 0.5) * cell_side - placed[i, 1]),
            max(noise[i], floor * floor),
            pose[i],
            intensity[i],
        )
    for entry in range(used):
        slot, a, b = home[entry, 0], home[entry, 1], home[entry, 2]
        _seal(own[entry])
        _merge_cell(cells[slot, a, b], own[entry])
        entry_of[slot, a, b] = -1


@njit(cache=True, nogil=True)
def merge_tile(into, other, factor):
    """Merge tile `other` into tile `into` (CELL), factor x factor cells into one.

    Points of one sweep in neighbouring cells then count as two sweeps: right for a factor of 1, cautious enough beyond.
    """
    for a in range(other.shape[0]):
        for b in range(other.shape[1]):
            if other[a, b].count > 0:
                _merge_cell(into[a // factor, b // factor], other[a, b])


# --- the evidence in voxels


@njit(cache=True, nogil=True)
def _slot(voxels, key):
    """Slot of a key in an open-addressed table, of a power of two slots: its own, or the free one to put it in."""
    mask = len(voxels) - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = int(mixed >> np.uint64(24)) & mask
    while voxels[slot].key != key and voxels[slot].key != -1:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _key(ix, iy, iz):
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
        key = _key(ix, iy, iz)
        if key != before:  # neighbouring points mostly share a voxel
            before, slot = key, _slot(voxels, key)
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
            new[_slot(new, old[i].key)] = old[i]


@njit(cache=True, nogil=True)
def surroundings(voxels, side, surrounding, covariance):
    """Sum up the 3 x 3 x 3 voxels about every voxel: all of `surrounding` but share, normal and thickness, and the
    covariance (slots, 3, 3) of its points, m^2."""
    low = (1 << 21) - 1
    for slot in range(len(voxels)):
        if voxels[slot].key == -1:
            continue
        key = voxels[slot].key
        ix, iy, iz = key >> 42, (key >> 21) & low, key & low
        count = 0
        support = 0
        hit = 0
        first, last = voxels[slot].first, voxels[slot].last
        m = np.zeros(9)
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    found = voxels[_slot(voxels, ((ix + dx) << 42) | ((iy + dy) << 21) | (iz + dz))]
                    if found.key == -1:
                        continue
                    n = found.count
                    ox, oy, oz = dx * side, dy * side, dz * side
                    count += n
                    support += found.profiles
                    hit += 1
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
        about.several = first != last
        about.x = m[0]
        about.y = m[1]
        about.z = m[2]
        c = covariance[slot]
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
    voxels, surrounding, placed, sigma, run, side, min_points, min_run, min_share, gate, verdict, gradient
):
    """Change the verdict (n,) of accepted points that do not belong; write the slope (n, 2) of the surface at the rest."""
    before, slot = -1, 0
    for i in range(len(placed)):
        if verdict[i] != ACCEPTED:
            continue
        ix = int(np.floor(placed[i, 0] / side))
        iy = int(np.floor(placed[i, 1] / side))
        iz = int(np.floor(placed[i, 2] / side))
        key = _key(ix, iy, iz)
        if key != before:
            before, slot = key, _slot(voxels, key)
        voxel, about = voxels[slot], surrounding[slot]
        shared = about.several and about.count >= min_points and about.support >= 4
        if voxel.key == -1 or not (shared or run[i] >= min_run):
            verdict[i] = ISOLATED
            continue
        if about.share < min_share:
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
