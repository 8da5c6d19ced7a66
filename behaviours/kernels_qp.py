"""The smallest change of a command that meets linear constraints: a QP in four variables."""

from __future__ import annotations

import numpy as np
from numba import njit

from garbi_map.log.records import Floats

ROUNDS = 300


@njit(cache=True, nogil=True)
def project(
    wanted: Floats, rows: Floats, bounds: Floats, low: Floats, high: Floats, weight: Floats
) -> tuple[Floats, bool]:
    """Minimise sum (weight (u - wanted))^2 subject to rows (m, 4) u <= bounds (m,) and low <= u <= high.

    Hildreth's method: coordinate ascent on the dual, one constraint after the other; and whether u meets them all.
    """
    m = rows.shape[0]
    total = m + 8
    a = np.zeros((total, 4))
    b = np.empty(total)
    for i in range(m):
        for k in range(4):
            a[i, k] = rows[i, k] / weight[k]
        b[i] = bounds[i]
    for k in range(4):
        a[m + k, k] = 1.0 / weight[k]
        b[m + k] = high[k]
        a[m + 4 + k, k] = -1.0 / weight[k]
        b[m + 4 + k] = -low[k]
    x = wanted * weight
    dual = np.zeros(total)
    square = np.empty(total)
    for i in range(total):
        square[i] = max((a[i] * a[i]).sum(), 1e-12)
    for _ in range(ROUNDS):
        moved = 0.0
        for i in range(total):
            over = (a[i] * x).sum() - b[i]
            step = max(over / square[i], -dual[i])
            if step != 0.0:
                dual[i] += step
                x -= step * a[i]
                moved = max(moved, abs(step) * np.sqrt(square[i]))
        if moved < 1e-7:
            break
    met = True
    for i in range(total):
        if (a[i] * x).sum() > b[i] + 2e-3:
            met = False
    u = x / weight
    for k in range(4):
        u[k] = min(max(u[k], low[k]), high[k])
    return u, met
