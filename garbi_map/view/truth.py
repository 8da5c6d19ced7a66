"""The true path and surface of a simulated dive, where its log has them: to be looked at, never to be computed with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.seabed import Mesh
from garbi_map.view import style
from garbi_map.view.surface import draw_surface
from garbi_map.view.thin import thinned

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.log import Log
    from garbi_map.navigate import Trajectory

PATH, SURFACE = ("/truth/odometry", "nav_msgs/msg/Odometry"), ("/truth/seabed", "sensor_msgs/msg/PointCloud2")
_VERTICES = 20_000
_MARGIN = 0.05
"""m about a map within which the true surface is shown."""
_FLOAT32 = 7
"""sensor_msgs/msg/PointField's number."""


@dataclass(frozen=True)
class Truth:
    """What a log knows of the truth, moved rigidly as a whole onto our path, since its frame has another origin.

    path      (n, 3) m, `map`
    surface   (rows, columns, 3) m, `map`, a grid seen from above, known where it is finite; None where there is none
    """

    path: NDArray[np.float64]
    surface: NDArray[np.float64] | None

    @classmethod
    def of(cls, log: Log, ours: Trajectory, seabed: NDArray) -> Truth | None:
        """The truth that a log has, the surface under and about the vertices of a map's mesh (v, 3); None where there is no
        true path."""
        stamps, position, rotation = _read_path(log)
        inside = (stamps >= ours.stamp_ns[0]) & (stamps <= ours.stamp_ns[-1])
        if inside.sum() < 2:
            return None
        position, rotation, there = position[inside], rotation[inside], ours.at(stamps[inside])
        turn, centre, shift = (
            (there.rotation * rotation.inv()).mean(),
            position.mean(axis=0),
            there.position.mean(axis=0),
        )
        surface = _read_surface(log)
        if surface is not None:
            surface = turn.apply((surface - centre).reshape(-1, 3)).reshape(surface.shape) + shift
            surface = _about(surface, seabed)
        return cls(turn.apply(position - centre) + shift, surface)

    @property
    def points(self) -> NDArray[np.float64] | None:
        """The known points (k, 3) m of the surface; None where there is none."""
        return None if self.surface is None else self.surface[np.isfinite(self.surface).all(axis=2)]

    def draw(self, recording: RecordingStream, seabed: NDArray, triangles: int) -> None:
        """The path, and the surface in at most so many triangles, coloured like a map's mesh with vertices (v, 3)."""
        import rerun as rr

        line = self.path[thinned(len(self.path), _VERTICES)].astype(np.float32)
        truth = style.TRUTH_ROUTE
        recording.log(truth.path, rr.LineStrips3D([line], radii=0.003, colors=[truth.colour]), static=True)
        if self.surface is not None:
            draw_surface(recording, _mesh(self.surface, triangles), style.TRUTH_SURFACE.path, seabed[:, 2])


def _about(surface: NDArray, seabed: NDArray) -> NDArray | None:
    """The part of a grid (rows, columns, 3) in which something lies within the box about points (v, 3); None if nothing."""
    low, high = seabed.min(axis=0)[:2] - _MARGIN, seabed.max(axis=0)[:2] + _MARGIN
    inside = np.isfinite(surface).all(axis=2) & ((surface[..., :2] >= low) & (surface[..., :2] <= high)).all(axis=2)
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    if len(rows) < 2 or len(columns) < 2:
        return None
    return np.where(inside[..., None], surface, np.nan)[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _mesh(grid: NDArray, triangles: int) -> Mesh:
    """Two triangles for each four neighbours that are known; of so many rows and columns one, that they are not too many."""
    step = max(int(np.ceil(np.sqrt(2.0 * grid.shape[0] * grid.shape[1] / triangles))), 1)
    grid = grid[::step, ::step]
    rows, columns = grid.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    a, b, c, d = (corner.ravel() for corner in corners)
    known = np.isfinite(grid).all(axis=2).ravel()
    whole = known[a] & known[b] & known[c] & known[d]
    faces = np.concatenate([np.stack([a, b, c], axis=1)[whole], np.stack([a, c, d], axis=1)[whole]])
    used, renumbered = np.unique(faces, return_inverse=True)
    return Mesh(grid.reshape(-1, 3)[used], renumbered.reshape(-1, 3).astype(np.int32), np.zeros(len(used), bool))


def _messages(log: Log, topic: str, type_name: str) -> Iterator[tuple[int, Any]]:
    """Stamp and content of the readable messages of a topic, if it has this type."""
    from garbi_map.log.decode import BAD_MESSAGE, stamp_of
    from garbi_map.log.types import log_types

    known = log.topics.get(topic)
    if known is None or known.type != type_name:
        return
    types = log_types(())
    for _, message in log.messages({topic}):
        try:
            yield stamp_of(message.data), types.deserialize_cdr(message.data, type_name)
        except BAD_MESSAGE:
            continue


def _read_path(log: Log) -> tuple[NDArray[np.int64], NDArray[np.float64], Rotation]:
    stamps: list[int] = []
    rows: list[list[float]] = []
    for stamp, content in _messages(log, *PATH):
        at, turn = content.pose.pose.position, content.pose.pose.orientation
        row = [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]
        if np.isfinite(row).all() and np.linalg.norm(row[3:]) > 0.5:
            stamps.append(stamp)
            rows.append(row)
    table = np.array(rows).reshape(-1, 7)
    turns = Rotation.from_quat(table[:, 3:]) if len(table) else Rotation.identity(0)
    return np.array(stamps, np.int64), table[:, :3], turns


def _read_surface(log: Log) -> NDArray[np.float64] | None:
    """The first organised cloud (rows, columns, 3) of the topic whose x, y and z are little-endian float32; None else."""
    for _, cloud in _messages(log, *SURFACE):
        fields = {field.name: field for field in cloud.fields}
        count, step = cloud.height * cloud.width, cloud.point_step
        if min(cloud.height, cloud.width) < 2 or cloud.is_bigendian or len(cloud.data) != count * step:
            continue
        found = [fields[name] for name in "xyz" if name in fields]
        if len(found) < 3 or any(one.datatype != _FLOAT32 or one.offset + 4 > step for one in found):
            continue
        table = np.asarray(cloud.data, np.uint8).reshape(count, step)
        axes = [table[:, one.offset : one.offset + 4].copy().view("<f4") for one in found]
        return np.hstack(axes).astype(np.float64).reshape(cloud.height, cloud.width, 3)
    return None
