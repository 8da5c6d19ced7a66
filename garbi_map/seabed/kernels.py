"""Compiled loops over points and cells of the grid."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit


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
def _seal(cell, seen):
    """Close the memory of one sweep, which began at `seen` s: its pose errors are one error."""
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
def tile_span(placed, chosen, cell_side, tile):
    """Index (2,) along x and y of the first tile of tile x tile cells that has a chosen point, and of the last."""
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
def fuse_sweep(
    placed, chosen, gradient, noise, pose, intensity, floor, cell_side, first, slot_of, cells, entry_of, seen, memory
):
    """Take the chosen points of one sweep into the grid.

    slot_of (a, b) finds the slot of a tile counted from tile `first`; cells (slots, tile, tile) of CELL, first index
    along x; entry_of, of the same shape, is -1 everywhere before and after: it finds a cell's memory of this sweep.
    seen: when the sweep began, s; memory: s in which the path's errors forget themselves.
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
        _seal(own[entry], seen)
        _merge_cell(cells[slot, a, b], own[entry], memory)
        entry_of[slot, a, b] = -1


@njit(cache=True, nogil=True)
def merge_tile(into, other, factor, memory):
    """Merge tile `other` into tile `into` (CELL), factor x factor cells into one.

    Points of one sweep in neighbouring cells then count as two sweeps of one moment.
    """
    for a in range(other.shape[0]):
        for b in range(other.shape[1]):
            if other[a, b].count > 0:
                _merge_cell(into[a // factor, b // factor], other[a, b], memory)
