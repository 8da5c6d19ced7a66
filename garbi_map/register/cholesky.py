"""The factor of a least-squares problem's matrix: banded while only neighbours in time have to do with each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register.cholesky_kernels import back_substitute, factor_envelope, first_entries, forward_substitute

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_COMPILED = 10.0
"""How many times as long a multiplication takes in the loops for narrow matrices as it does in LAPACK's blocks."""


class Cholesky:
    """A symmetric positive definite matrix (n, n), which may be overwritten, factored.

    Raises numpy.linalg.LinAlgError where it is none.

    order (n,): the unknowns as they should follow each other, those that have to do with each other close together. Where
    that leaves most of the matrix empty, only its envelope is worked on (George and Liu, Computer Solution of Large Sparse
    Positive Definite Systems, 1981, chapter 4), else LAPACK has all of it.
    """

    def __init__(self, matrix: Floats, order: Ints) -> None:
        from scipy.linalg import cho_factor

        self._order, self._first = order, first_entries(matrix, order)
        width = np.arange(len(order)) - self._first
        self._narrow = _COMPILED * float((width.astype(float) ** 2).sum()) / 2.0 < len(order) ** 3 / 6.0
        if self._narrow:
            self._lower = np.zeros_like(matrix)
            if not factor_envelope(matrix, order, self._first, self._lower):
                raise np.linalg.LinAlgError("the matrix is not positive definite")
        else:
            self._lower = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)[0]

    def solve(self, right: Floats) -> Floats:
        """The x of matrix x = right, right (n,) or (n, k)."""
        from scipy.linalg import cho_solve

        if not self._narrow:
            return cho_solve((self._lower, True), right, check_finite=False)
        x = right.reshape(len(right), -1)[self._order]
        forward_substitute(self._lower, self._first, x)
        back_substitute(self._lower, self._first, x)
        out = np.empty_like(x)
        out[self._order] = x
        return out.reshape(right.shape)
