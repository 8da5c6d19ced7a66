"""The true path of a simulated dive, where its log has one: to be looked at, never to be computed with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.view import style
from garbi_map.view.thin import thinned

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.log import Log
    from garbi_map.navigate import Trajectory

TOPIC, TYPE = "/truth/odometry", "nav_msgs/msg/Odometry"
_VERTICES = 20_000


def draw_truth(recording: RecordingStream, log: Log, ours: Trajectory) -> bool:
    """The true path, moved rigidly as a whole onto ours, since its frame has another origin; False where there is none."""
    import rerun as rr

    stamps, position, rotation = _read(log)
    inside = (stamps >= ours.stamp_ns[0]) & (stamps <= ours.stamp_ns[-1])
    if inside.sum() < 2:
        return False
    position, rotation, there = position[inside], rotation[inside], ours.at(stamps[inside])
    turn = (there.rotation * rotation.inv()).mean()
    line = turn.apply(position - position.mean(axis=0)) + there.position.mean(axis=0)
    shown = line[thinned(len(line), _VERTICES)].astype(np.float32)
    truth = style.TRUTH_ROUTE
    recording.log(truth.path, rr.LineStrips3D([shown], radii=0.003, colors=[truth.colour]), static=True)
    return True


def _read(log: Log) -> tuple[NDArray[np.int64], NDArray[np.float64], Rotation]:
    from garbi_map.log.decode import BAD_MESSAGE, stamp_of
    from garbi_map.log.types import log_types

    stamps: list[int] = []
    rows: list[list[float]] = []
    topic = log.topics.get(TOPIC)
    if topic is not None and topic.type == TYPE:
        types = log_types(())
        for _, message in log.messages({TOPIC}):
            try:
                pose = types.deserialize_cdr(message.data, TYPE).pose.pose  # type: ignore[attr-defined]
                at, turn = pose.position, pose.orientation
                row = [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]
                if np.isfinite(row).all() and np.linalg.norm(row[3:]) > 0.5:
                    stamps.append(stamp_of(message.data))
                    rows.append(row)
            except BAD_MESSAGE:
                continue
    table = np.array(rows).reshape(-1, 7)
    turns = Rotation.from_quat(table[:, 3:]) if len(table) else Rotation.identity(0)
    return np.array(stamps, np.int64), table[:, :3], turns
