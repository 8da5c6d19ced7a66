"""The filter's nodes on disk: an hour of them is 0.2 GB, of which the smoother looks at a few megabytes at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.navigate.eskf import Node
from garbi_map.navigate.process import Step
from garbi_map.navigate.states import STATES

_RECORD = np.dtype(
    [
        ("sample", np.int64),
        ("seconds", np.float64),
        ("jacobian", np.float64, (9, 15)),
        ("no_rate", np.float64),
        ("no_force", np.float64),
        ("doubt", np.float64, (STATES,)),
        ("correction", np.float64, (STATES,)),
        ("biases", np.float64, (STATES - 9,)),
        ("covariance", np.float64, (STATES * (STATES + 1) // 2,)),
    ]
)
_BLOCK = 500


class NodeTape:
    """Nodes written to a temporary file as they come, and read back in stretches. The file has no name: it goes when the
    tape or the process does. Raises GarbiError where the disk is full."""

    def __init__(self, nodes: Iterable[Node]) -> None:
        self._count = 0
        coming = iter(nodes)
        try:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115, it lives as long as the tape
            while block := list(islice(coming, _BLOCK)):
                self._file.write(_records(block).tobytes())
                self._count += len(block)
            self._file.flush()
        except OSError as error:
            where = tempfile.gettempdir()
            raise GarbiError(f"{where}: navigation needs room there: {error.strerror}; set TMPDIR") from error

    def __len__(self) -> int:
        return self._count

    def stretch(self, first: int, end: int) -> Sequence[Node]:
        """The nodes from first to end - 1."""
        self._file.seek(first * _RECORD.itemsize)
        data = self._file.read((end - first) * _RECORD.itemsize)
        return list(_nodes(np.frombuffer(data, _RECORD)))


def _records(nodes: Sequence[Node]) -> np.ndarray:
    out = np.empty(len(nodes), _RECORD)
    for name in ("seconds", "jacobian", "no_rate", "no_force", "doubt"):
        out[name] = [getattr(node.step, name) for node in nodes]
    for name in ("sample", "correction", "biases", "covariance"):
        out[name] = [getattr(node, name) for node in nodes]
    return out


def _nodes(records: np.ndarray) -> Iterator[Node]:
    for one in records:
        step = Step(float(one["seconds"]), one["jacobian"], float(one["no_rate"]), float(one["no_force"]), one["doubt"])
        yield Node(int(one["sample"]), step, one["correction"], one["biases"], one["covariance"])
