"""Compiled loops over points and cells of the grid."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit

from garbi_map.seabed.cells import TILE, TILE_BITS


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
def _add_point(cell, rise, noise_variance, pose_deviation, intensity):
    """Take a point that lies `rise` above the sweep's first into the memory of one sweep: sums, until `_seal` closes it."""
    weight = 1.0 / (noise_variance + pose_deviation * pose_deviation)
    cell.count += 1
    cell.weight += weight
    cell.z += weight * rise
    cell.within += weight * rise * rise
    cell.within_expected += weight * noise_variance
    cell.noise += weight * weight * noise_variance
    cell.pose += weight * pose_deviation
    cell.intensity += weight * intensity


@njit(cache=True, nogil=True)
def _seal(cell, first_z, seen):
    """Close the memory of one sweep, which began at `seen` s: its pose errors are one error."""
    mean_rise = cell.z / cell.weight
    cell.within = max(cell.within - mean_rise * cell.z, 0.0)
    cell.z = first_z + mean_rise
    cell.intensity /= cell.weight
    cell.sweeps = 1
    cell.first = cell.last = seen
    cell.leading = cell.lasting = cell.pose
    cell.pose = cell.pose * cell.pose
    cell.between_noise = cell.noise / cell.weight
    cell.between_pose = cell.pose / cell.weight
    cell.within_expected -= cell.between_noise


@njit(cache=True, nogil=True)
def _merge_poses(into, other, memory):
    """The variance by poses of two stretches of sweeps, and what is needed to add more at either end."""
    into.pose += other.pose
    if into.count == 0 or not memory > 0.0 or np.isnan(other.first):
        into.first, into.last, into.leading, into.lasting = other.first, other.last, other.leading, other.lasting
        return
    after = np.exp(-abs(other.last - into.last) / memory)
    before = np.exp(-abs(other.first - into.first) / memory)
    if other.first >= into.last:
        into.pose += 2.0 * into.lasting * other.leading * np.exp((into.last - other.first) / memory)
    elif into.first >= other.last:
        into.pose += 2.0 * other.lasting * into.leading * np.exp((other.last - into.first) / memory)
    else:  # two stretches of the same time: as if their ends were all
        into.pose += 2.0 * into.lasting * other.lasting * after
    later, earlier = other.last >= into.last, other.first <= into.first
    into.lasting = other.lasting + into.lasting * after if later else into.lasting + other.lasting * after
    into.leading = other.leading + into.leading * before if earlier else into.leading + other.leading * before
    into.last = max(into.last, other.last)
    into.first = min(into.first, other.first)


@njit(cache=True, nogil=True)
def _merge_cell(into, other, memory):
    """Two sealed memories, of different sweeps, become one (pairwise update of Chan, Golub and LeVeque).

    The errors of the path are a Gauss-Markov process that forgets itself in `memory` s. What two stretches of it have in
    common hangs on the end of the earlier and the begin of the later alone, so that stretches merge in any grouping.
    """
    _merge_poses(into, other, memory)
    total = into.weight + other.weight
    share = other.weight / total
    step = other.z - into.z
    into.count += other.count
    into.sweeps += other.sweeps
    into.z += share * step
    into.noise += other.noise
    into.within += other.within
    into.within_expected += other.within_expected
    into.between += other.between + step * step * into.weight * share
    into.between_noise += other.between_noise
    into.between_pose += other.between_pose
    into.intensity += share * (other.intensity - into.intensity)
    into.weight = total


@njit(cache=True, nogil=True)
def cells_of(placed, side):
    """Index (n, 2) of the cell of each point along x and y, and of the first and of the last tile (2,)."""
    index = np.empty((len(placed), 2), np.int32)
    low, high = np.full(2, np.iinfo(np.int32).max), np.full(2, np.iinfo(np.int32).min)
    for i in range(len(placed)):
        for k in range(2):
            index[i, k] = at = int(np.floor(placed[i, k] / side))
            low[k] = min(low[k], at)
            high[k] = max(high[k], at)
    return index, low >> TILE_BITS, high >> TILE_BITS


@njit(cache=True, nogil=True)
def sort_by_cell(index, first, span):
    """Points in the order of tiles, of cells in a tile, and as they come: one counting sort.

    index (n, 2) of cells; first (2,), span (2,): of the tiles. Returns the order (n,), the tiles (t, 2) that were hit, and
    where the points of each cell of these begin (t TILE^2 + 1,).
    """
    number = np.full((span[0], span[1]), -1, np.int32)
    for i in range(len(index)):
        number[(index[i, 0] >> TILE_BITS) - first[0], (index[i, 1] >> TILE_BITS) - first[1]] = 0
    tiles = np.empty((np.count_nonzero(number == 0), 2), np.int32)
    used = 0
    for a in range(span[0]):
        for b in range(span[1]):
            if number[a, b] == 0:
                number[a, b] = used
                tiles[used, 0], tiles[used, 1] = a + first[0], b + first[1]
                used += 1
    place = np.empty(len(index), np.int32)
    begin = np.zeros(used * TILE * TILE + 1, np.int32)
    for i in range(len(index)):
        column, row = index[i, 0], index[i, 1]
        tile = number[(column >> TILE_BITS) - first[0], (row >> TILE_BITS) - first[1]]
        place[i] = (tile * TILE + (column & (TILE - 1))) * TILE + (row & (TILE - 1))
        begin[place[i] + 1] += 1
    begin = np.cumsum(begin).astype(np.int32)
    following = begin[:-1].copy()
    order = np.empty(len(index), np.int32)
    for i in range(len(index)):
        order[following[place[i]]] = i
        following[place[i]] += 1
    return order, tiles, begin


@njit(cache=True, nogil=True)
def fuse_cells(
    order, begin, hit, index, placed, sweep, seen, gradient, noise, pose, intensity, floor, side, memory, own, cells
):
    """Fuse the points of every cell, sweep by sweep, into cells (k,) of CELL, all zero.

    order, begin: as `sort_by_cell` leaves them; hit (k,): which cells have points; index (n, 2) of each point's cell;
    sweep (n,) of each point, ascending; seen (s,): when each sweep began, s; memory: s in which the path's errors forget
    themselves; own (1,) of OPEN_CELL, zero, to work in.
    """
    empty = np.zeros_like(own)
    for k in range(len(hit)):
        now, first_z = -1, 0.0
        for j in range(begin[hit[k]], begin[hit[k] + 1]):
            i = order[j]
            z = (
                placed[i, 2]
                + gradient[i, 0] * ((index[i, 0] + 0.5) * side - placed[i, 0])
                + gradient[i, 1] * ((index[i, 1] + 0.5) * side - placed[i, 1])
            )
            if sweep[i] != now:
                if now >= 0:
                    _seal(own[0], first_z, seen[now])
                    _merge_cell(cells[k], own[0], memory)
                own[0] = empty[0]
                now, first_z = sweep[i], z
            _add_point(own[0], z - first_z, max(noise[i], floor * floor), pose[i], intensity[i])
        _seal(own[0], first_z, seen[now])
        _merge_cell(cells[k], own[0], memory)


@njit(cache=True, nogil=True)
def merge_cells(tiles, slot, cell, cells, factor, memory):
    """Merge cells (k,) of CELL, of number `cell` (k,) in their tile, into tiles (slots, side, side) at `slot` (k,).

    factor x factor cells become one: points of one sweep in neighbouring cells then count as two sweeps of one moment.
    """
    for k in range(len(cells)):
        a, b = cell[k] // TILE // factor, cell[k] % TILE // factor
        _merge_cell(tiles[slot[k], a, b], cells[k], memory)


@njit(cache=True, nogil=True)
def paint(field, slot_of, first, raster):
    """Write one field (slots, side, side) of all tiles, first index along x, into a raster (rows, columns).

    slot_of (a, b) is -1 where there is no tile; first (2,): the cell along x and y, counted from tile (0, 0), at
    raster[0, 0]. No cell may be beyond the raster but those that were not hit.
    """
    side = field.shape[1]
    rows, columns = raster.shape
    for a in range(slot_of.shape[0]):
        for b in range(slot_of.shape[1]):
            if slot_of[a, b] < 0:
                continue
            tile = field[slot_of[a, b]]
            for i in range(max(0, first[0] - a * side), min(side, first[0] + columns - a * side)):
                for j in range(max(0, first[1] - b * side), min(side, first[1] + rows - b * side)):
                    raster[b * side + j - first[1], a * side + i - first[0]] = tile[i, j]
