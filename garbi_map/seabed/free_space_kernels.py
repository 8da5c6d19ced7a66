"""Compiled walk of rays through the voxels of the evidence (Amanatides and Woo, A fast voxel traversal algorithm, 1987)."""
# mypy: disable-error-code="no-untyped-def"

import numpy as np
from numba import njit

from garbi_map.seabed.evidence_kernels import ACCEPTED, key_of, mixed, slot_of

BLOCK = 8  # voxels along a side of a block


@njit(cache=True, nogil=True)
def _find(blocks, key):
    """Slot of a block's key in an open-addressed table: its own, or a free one (-1)."""
    mask = len(blocks) - 1
    slot = mixed(key) & mask
    while blocks[slot] != key and blocks[slot] != -1:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def occupied_blocks(voxels, blocks):
    """Enter the blocks of all voxels into a free table; returns their number, or -1 when it is half full."""
    low = (1 << 21) - 1
    used = 0
    half = 1 << 20
    for i in range(len(voxels)):
        key = voxels[i].key
        if key == -1:
            continue
        ix, iy, iz = (key >> 42) - half, ((key >> 21) & low) - half, (key & low) - half
        block = key_of(ix // BLOCK, iy // BLOCK, iz // BLOCK)
        slot = _find(blocks, block)
        if blocks[slot] == -1:
            if 2 * used >= len(blocks):
                return -1
            blocks[slot] = block
            used += 1
    return used


@njit(cache=True, nogil=True)
def _pass(voxel, ix, iy, iz, eye, d, side, beam, thin_beam, far, number):
    """Count a profile whose ray, eye + t d with t < far, goes through the middle of the voxel's points."""
    if voxel.piercer == number:
        return
    n = voxel.count
    x = (ix + 0.5) * side + voxel.x / n - eye[0]
    y = (iy + 0.5) * side + voxel.y / n - eye[1]
    z = (iz + 0.5) * side + voxel.z / n - eye[2]
    t = x * d[0] + y * d[1] + z * d[2]
    off = x * x + y * y + z * z - t * t
    if not (t < far and off < beam * beam):
        return
    if voxel.passer != number:
        voxel.passer = number
        voxel.through += 1
    if off < thin_beam * thin_beam:
        voxel.piercer = number
        voxel.pierced += 1


@njit(cache=True, nogil=True)
def _walk(voxels, eye, d, begin, end, far, side, beam, thin_beam, number):
    """All voxels from eye + begin d to eye + end d."""
    index = np.empty(3, np.int64)
    step = np.empty(3, np.int64)
    following = np.empty(3)
    stride = np.empty(3)
    for k in range(3):
        place = eye[k] + begin * d[k]
        index[k] = int(np.floor(place / side))
        step[k] = 1 if d[k] > 0 else -1
        if abs(d[k]) < 1e-12:
            following[k] = stride[k] = np.inf
            continue
        edge = (index[k] + (1 if d[k] > 0 else 0)) * side
        following[k] = begin + (edge - place) / d[k]
        stride[k] = side / abs(d[k])
    while True:
        voxel = voxels[slot_of(voxels, key_of(index[0], index[1], index[2]))]
        if voxel.key != -1:
            _pass(voxel, index[0], index[1], index[2], eye, d, side, beam, thin_beam, far, number)
        k = (
            0
            if following[0] <= following[1] and following[0] <= following[2]
            else 1
            if following[1] <= following[2]
            else 2
        )
        if following[k] > end:
            return
        index[k] += step[k]
        following[k] += stride[k]


@njit(cache=True, nogil=True)
def pass_rays(voxels, blocks, placed, verdict, profile, row, base, eyes, side, gap, beam, thin_beam, every):
    """Let the rays of a sweep pass: of every point (n, 3) in `map` that counts, the rays from the eyes.

    eyes (e, profiles, 3): where camera and laser are at each profile; gap m before a point its ray ends; of the rows of a
    profile one in `every` takes part.
    """
    large = side * BLOCK
    d = np.empty(3)
    index = np.empty(3, np.int64)
    step = np.empty(3, np.int64)
    following = np.empty(3)
    stride = np.empty(3)
    for i in range(len(placed)):
        if verdict[i] != ACCEPTED or (row[i] + profile[i]) % every != 0:
            continue
        for e in range(len(eyes)):
            eye = eyes[e, profile[i]]
            length = 0.0
            for k in range(3):
                d[k] = placed[i, k] - eye[k]
                length += d[k] * d[k]
            length = np.sqrt(length)
            far = length - gap
            if not far > 0.0:
                continue
            for k in range(3):
                d[k] /= length
                index[k] = int(np.floor(eye[k] / large))
                step[k] = 1 if d[k] > 0 else -1
                if abs(d[k]) < 1e-12:
                    following[k] = stride[k] = np.inf
                    continue
                following[k] = ((index[k] + (1 if d[k] > 0 else 0)) * large - eye[k]) / d[k]
                stride[k] = large / abs(d[k])
            begin = 0.0
            while begin < far:
                k = (
                    0
                    if following[0] <= following[1] and following[0] <= following[2]
                    else 1
                    if following[1] <= following[2]
                    else 2
                )
                end = min(following[k], far)
                block = key_of(index[0], index[1], index[2])
                if blocks[_find(blocks, block)] == block:
                    _walk(voxels, eye, d, begin + 1e-9, end, far, side, beam, thin_beam, base + profile[i])
                begin = following[k]
                index[k] += step[k]
                following[k] += stride[k]
