"""Which points stand for the whole from afar: an octree whose every node holds an even sample of what lies in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int64]
Key = tuple[int, int, int, int]
"""A node: its level, and its place x, y, z among the 2^level along each edge."""

SAMPLES = 7
"""Halvings from a node's side to the spacing of its points: 128 of them along an edge."""
_BITS = 21
"""Of each coordinate in a Morton code, three of which fill an int64."""
_LEAF = 40_000
"""Points up to which a node is not divided."""


@dataclass(frozen=True)
class Cube:
    """The octree's root: least corner (3,) and the binary logarithm of its side, in steps of the coordinates."""

    corner: NDArray[np.int64]
    bits: int

    @classmethod
    def about(cls, low: NDArray[np.int64], high: NDArray[np.int64]) -> Cube:
        """The smallest cube of a power of two that holds low (3,) to high (3,), in steps."""
        bits = (int(np.max(high - low)) + 1).bit_length()
        return cls((low + high) // 2 - (1 << bits) // 2, bits)

    def codes(self, steps: NDArray[np.int64]) -> Codes:
        """Morton codes (n,) of points (n, 3): the bits of x, y and z in turn, the coarsest first."""
        code = np.zeros(len(steps), np.int64)
        for axis in range(3):
            code |= _spread(((steps[:, axis] - self.corner[axis]) << _BITS) >> self.bits) << axis
        return code

    def nodes_of(self, steps: NDArray[np.int64], level: int) -> NDArray[np.int64]:
        """The number (n,) of the node of a level in which each point (n, 3) is, along the Morton curve."""
        return self.codes(steps) >> 3 * (_BITS - level)


def nodes(codes: Codes, whole_from: int = 0) -> Iterator[tuple[Key, NDArray[np.int64]]]:
    """The nodes and the points in them, every point (n,) in exactly one, root first.

    A node takes, of every cell of its 128 x 128 x 128 that holds points, the one in the middle of the Morton curve; its
    children share the rest. Nodes of few points take them all, from level `whole_from` on.
    """
    order = np.argsort(codes, kind="stable")
    left = codes[order]
    for level in range(_BITS - SAMPLES + 1):
        if not len(left):
            return
        begin, end = _runs(left >> 3 * (_BITS - level))
        small = (end - begin <= _LEAF) & (level >= whole_from)
        taken = np.repeat(small | (level + SAMPLES == _BITS), end - begin)
        first, last = _runs(left >> 3 * (_BITS - level - SAMPLES))
        taken[(first + last) // 2] = True
        before = np.r_[0, np.cumsum(taken)]
        rows, keys = order[taken], left[begin] >> 3 * (_BITS - level)
        for key, one, two in zip(keys.tolist(), before[begin].tolist(), before[end].tolist(), strict=True):
            yield (level, *_place(key)), rows[one:two]
        order, left = order[~taken], left[~taken]


def _runs(keys: Codes) -> tuple[Codes, Codes]:
    """Begin and end of each run of equal keys."""
    edges = np.flatnonzero(np.diff(keys)) + 1
    return np.r_[0, edges], np.r_[edges, len(keys)]


def _spread(bits: NDArray[np.int64]) -> Codes:
    """The 21 low bits of each number, each followed by two zeros on its way up."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        bits = (bits | bits << shift) & mask
    return bits


def _place(key: int) -> tuple[int, int, int]:
    """x, y and z of which a Morton code is made."""
    x, y, z = (sum((key >> (3 * bit + axis) & 1) << bit for bit in range(_BITS)) for axis in range(3))
    return x, y, z
