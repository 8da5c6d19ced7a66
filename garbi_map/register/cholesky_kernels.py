"""Compiled loops over the envelope of a symmetric matrix: what lies between a row's first entry and the diagonal."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def first_entries(matrix, order):  # type: ignore[no-untyped-def]
    """The place (n,) of each row's first entry that is not zero, rows and columns taken in `order`."""
    n = order.shape[0]
    first = np.arange(n)
    for i in range(n):
        row = matrix[order[i]]
        for j in range(i):
            if row[order[j]] != 0.0:
                first[i] = j
                break
    return first


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total


@njit(cache=True, nogil=True)
def factor_envelope(matrix, order, first, lower):  # type: ignore[no-untyped-def]
    """Fills lower (n, n), zero before, with the factor of the ordered matrix; False where that is not positive definite."""
    for i in range(order.shape[0]):
        row, begin = lower[i], first[i]
        for j in range(begin, i + 1):
            start = max(begin, first[j])
            rest = matrix[order[i], order[j]] - _dot(row[start:j], lower[j, start:j])
            if j < i:
                row[j] = rest / lower[j, j]
            elif rest > 0.0:
                row[i] = np.sqrt(rest)
            else:
                return False
    return True


@njit(cache=True, nogil=True)
def forward_substitute(lower, first, x):  # type: ignore[no-untyped-def]
    """x (n, k) becomes the solution of lower y = x."""
    for i in range(x.shape[0]):
        for j in range(first[i], i):
            for k in range(x.shape[1]):
                x[i, k] -= lower[i, j] * x[j, k]
        for k in range(x.shape[1]):
            x[i, k] /= lower[i, i]


@njit(cache=True, nogil=True)
def back_substitute(lower, first, x):  # type: ignore[no-untyped-def]
    """x (n, k) becomes the solution of lower' y = x."""
    for i in range(x.shape[0] - 1, -1, -1):
        for k in range(x.shape[1]):
            x[i, k] /= lower[i, i]
        for j in range(first[i], i):
            for k in range(x.shape[1]):
                x[j, k] -= lower[i, j] * x[i, k]
