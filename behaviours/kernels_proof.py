"""Compiled: what one profile proves to be free water."""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.log.records import Floats


@njit(cache=True, nogil=True)
def proved(
    origins: Floats,
    directions: Floats,
    return_depth: Floats,
    clear_depth: float,
    axis: Floats,
    centre: Floats,
    normal: Floats,
    apex: Floats,
) -> tuple[Floats, Floats]:
    """What one profile proves to be free: from (n, 3) to (n, 3), m, rig frame.

    origins, directions   (rows, columns, 3) rays of the camera in the rig frame, one group of image rows per row
    return_depth          (rows,) nearest depth, m along `axis`, at which the group has a stripe; inf: it has none
    clear_depth           depth up to which a missing stripe means free water; 0: it means nothing
    normal, apex          of the sheet, rig frame

    Where a ray meets the sheet nearer than its group's stripe there is no surface; light came from there to the camera,
    so that the ray up to there is free as well.
    """
    rows, columns = origins.shape[0], origins.shape[1]
    starts, ends = np.empty((rows * columns, 3)), np.empty((rows * columns, 3))
    count = 0
    for r in range(rows):
        limit = return_depth[r] if return_depth[r] < 1e8 else clear_depth
        if limit <= 0.0:
            continue
        for c in range(columns):
            o, d = origins[r, c], directions[r, c]
            across = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
            if abs(across) < 1e-9:
                continue
            s = (normal[0] * (apex[0] - o[0]) + normal[1] * (apex[1] - o[1]) + normal[2] * (apex[2] - o[2])) / across
            if not s > 0.05:
                continue
            x, y, z = o[0] + s * d[0], o[1] + s * d[1], o[2] + s * d[2]
            depth = (x - centre[0]) * axis[0] + (y - centre[1]) * axis[1] + (z - centre[2]) * axis[2]
            if depth < limit:
                starts[count] = o
                ends[count, 0], ends[count, 1], ends[count, 2] = x, y, z
                count += 1
    return starts[:count], ends[:count]
