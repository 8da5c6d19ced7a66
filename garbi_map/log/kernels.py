"""Where one wrong bit is, from the checksum that does not match."""

from __future__ import annotations

import numpy as np
from numba import njit

_POLYNOMIAL = 0xEDB88320  # CRC-32 of ISO 3309, bits reversed


def _tables() -> tuple[np.ndarray, np.ndarray]:
    """The table (256,) of a byte's step of the checksum, and (256,) which entry has a given highest byte."""
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(_POLYNOMIAL), table >> 1).astype(np.uint32)
    entry = np.empty(256, np.uint32)
    entry[table >> 24] = np.arange(256)
    return table, entry


_TABLE, _ENTRY = _tables()


@njit(cache=True, nogil=True)
def flipped_bit(syndrome, size):  # type: ignore[no-untyped-def]
    """(byte, bit as a mask) of the one bit among `size` bytes whose turning changes their CRC-32 by `syndrome`, (-1, 0)
    where there is none: the checksum's steps are undone from the last byte back until one bit is left
    (Peterson and Brown, Cyclic codes for error detection, 1961)."""
    left = np.uint32(syndrome)
    for back in range(size):
        entry = _ENTRY[left >> np.uint32(24)]
        left = np.uint32((left ^ _TABLE[entry]) << np.uint32(8)) | entry
        if left < 256 and left != 0 and left & np.uint32(left - 1) == 0:
            return size - 1 - back, np.int64(left)
    return -1, np.int64(0)
