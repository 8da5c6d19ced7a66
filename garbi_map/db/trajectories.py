"""The trajectory of a dive: on disk in the frame of the dive, laid into `map` as its submaps are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

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
    """A dive's trajectory in `map`: as its submaps are in their middles, and changing evenly from one to the next."""
    transforms = np.array([submap.transform for submap in submaps])
    if np.abs(transforms - transforms[0]).max() < 1e-9:
        return trajectory.moved(transforms[0])
    begin_ns = trajectory.stamp_ns[0]
    middle = np.array([(one.written.begin_ns - begin_ns + one.written.end_ns - begin_ns) * 5e-10 for one in submaps])
    t = np.clip((trajectory.stamp_ns - begin_ns) * 1e-9, middle[0], middle[-1])
    centre = trajectory.position.mean(axis=0)
    shift = transforms[:, :3, :3] @ centre + transforms[:, :3, 3] - centre
    turn = Slerp(middle, Rotation.from_matrix(transforms[:, :3, :3]))(t)
    moved = np.stack([np.interp(t, middle, column) for column in shift.T], axis=1)
    return Trajectory(
        trajectory.stamp_ns,
        turn.apply(trajectory.position - centre) + centre + moved,
        (turn * trajectory.rotation).as_quat(),
        trajectory.moved(transforms[0]).covariance,
    )
