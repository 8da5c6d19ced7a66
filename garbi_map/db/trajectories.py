"""The trajectory of a dive: on disk in the frame of the dive, laid into `map` as its submaps are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from garbi_map.db.submaps import read_parquet, write_parquet
from garbi_map.navigate import Trajectory

if TYPE_CHECKING:
    from garbi_map.db.catalogue import StoredSubmap

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_HALF = np.triu_indices(6)


def write_poses(path: Path, trajectory: Trajectory) -> None:
    """Poses and the upper half of their covariance, row by row. Raises GarbiError."""
    import pyarrow as pa

    poses = np.hstack([trajectory.position, trajectory.quaternion])
    half = trajectory.covariance[:, *_HALF].astype(np.float32)
    columns = {name: np.ascontiguousarray(poses[:, k]) for k, name in enumerate(_POSE)}
    columns |= {f"c{a}{b}": np.ascontiguousarray(half[:, k]) for k, (a, b) in enumerate(zip(*_HALF, strict=True))}
    write_parquet(path, pa.table({"stamp_ns": trajectory.stamp_ns, **columns}))


def read_poses(path: Path) -> Trajectory:
    """What write_poses wrote. Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path)
    covariance = np.empty((len(table["stamp_ns"]), 6, 6), np.float32)
    for a, b in zip(*_HALF, strict=True):
        covariance[:, a, b] = covariance[:, b, a] = table[f"c{a}{b}"]
    poses = np.stack([table[name] for name in _POSE], axis=1)
    return Trajectory(table["stamp_ns"], poses[:, :3], poses[:, 3:], covariance)


def laid(trajectory: Trajectory, submaps: Sequence[StoredSubmap]) -> Trajectory:
    """A dive's trajectory in `map`."""
    return trajectory.moved(submaps[0].transform)
