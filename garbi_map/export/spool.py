"""Records that wait on disk: no more of them are in memory than are asked for."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

Records = NDArray[np.void]


class Spool:
    """A context manager over a nameless file of packed records in a folder. Raises OSError where the disk is full."""

    def __init__(self, folder: Path, dtype: np.dtype, count: int = 0) -> None:
        """count: records that there is to be room for, zero at first."""
        self.dtype = dtype
        self._folder = folder
        self._count = count

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._file = stack.enter_context(tempfile.TemporaryFile(dir=self._folder, buffering=0))
            if self._count:
                os.posix_fallocate(self._file.fileno(), 0, self._count * self.dtype.itemsize)
            self._open = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def __len__(self) -> int:
        return self._count

    def append(self, records: Records) -> None:
        """After the last."""
        self._count += len(records)
        self.put(self._count - len(records), records)

    def put(self, begin: int, records: Records) -> None:
        """In the place of those from `begin` on."""
        self._file.seek(begin * self.dtype.itemsize)
        left = np.ascontiguousarray(records).view(np.uint8).data
        while left:
            left = left[self._file.write(left) :]

    def read(self, rows: slice) -> Records:
        """A copy of the records from rows.start to rows.stop."""
        records = np.empty(rows.stop - rows.start, self.dtype)
        self._file.seek(rows.start * self.dtype.itemsize)
        left = records.view(np.uint8).data
        while left:
            left = left[self._file.readinto(left) :]
        return records

    def blocks(self, most: int) -> Iterator[Records]:
        """All, so many at a time."""
        for begin in range(0, self._count, most):
            yield self.read(slice(begin, min(begin + most, self._count)))
