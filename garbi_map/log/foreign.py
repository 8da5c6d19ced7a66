"""Messages that other people's recorders use for what the contract says in its own types.

Each picker takes a deserialised message and gives the row of its role as `decode` lays it out, or None where the
message honestly carries no value. Turns are xyzw; a depth is metres down, a pose's z is up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Picker = Callable[[Any], Sequence[float] | None]

HEADERLESS = frozenset(
    {"std_msgs/msg/Float64", "std_msgs/msg/Float32", "std_msgs/msg/Int32", "geometry_msgs/msg/Twist"}
)
"""Types without a stamp of their own: the time of recording stands in for it."""
WATER_LINKED = "dvl_msgs/msg/DVL"
_UNKNOWN3 = (math.nan,) * 3
_NO_COVARIANCE = (0.0,) * 9


def _number(message: Any) -> Sequence[float]:
    return (float(message.data),)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _xyzw(turn: Any) -> tuple[float, float, float, float]:
    return turn.x, turn.y, turn.z, turn.w


def _corner(covariance: Any) -> Sequence[float]:
    """The upper left (3, 3) of a flat (6, 6)."""
    return (*covariance[0:3], *covariance[6:9], *covariance[12:15])


def _imu_attitude(message: Any) -> Sequence[float] | None:
    return None if message.orientation_covariance[0] == -1 else _xyzw(message.orientation)


def _water_linked(message: Any) -> Sequence[float]:
    return (*(_xyz(message.velocity) if message.velocity_valid else _UNKNOWN3), *_NO_COVARIANCE)


def _transform(message: Any) -> Sequence[float]:
    return (*_xyz(message.transform.translation), *_xyzw(message.transform.rotation))


_POSE: Mapping[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
}


def _of_pose(pick: Callable[[Any], Sequence[float]]) -> dict[str, Picker]:
    """A picker for every message that holds a pose."""

    def reach(inner: Callable[[Any], Any]) -> Picker:
        return lambda message: pick(inner(message))

    return {name: reach(inner) for name, inner in _POSE.items()}


_NUMBER: dict[str, Picker] = dict.fromkeys(("std_msgs/msg/Float64", "std_msgs/msg/Float32"), _number)

PICKERS: dict[str, dict[str, Picker]] = {
    "encoder": {**_NUMBER, "std_msgs/msg/Int32": _number},
    "pressure": dict(_NUMBER),
    "depth": {
        **_NUMBER,
        **_of_pose(lambda pose: (-pose.position.z,)),
        "geometry_msgs/msg/PointStamped": lambda message: (-message.point.z,),
    },
    "attitude": {
        "sensor_msgs/msg/Imu": _imu_attitude,
        "geometry_msgs/msg/QuaternionStamped": lambda message: _xyzw(message.quaternion),
        **_of_pose(lambda pose: _xyzw(pose.orientation)),
    },
    "dvl": {
        "geometry_msgs/msg/TwistStamped": lambda message: (*_xyz(message.twist.linear), *_NO_COVARIANCE),
        "geometry_msgs/msg/Twist": lambda message: (*_xyz(message.linear), *_NO_COVARIANCE),
        "geometry_msgs/msg/Vector3Stamped": lambda message: (*_xyz(message.vector), *_NO_COVARIANCE),
        "nav_msgs/msg/Odometry": lambda message: (
            *_xyz(message.twist.twist.linear),
            *_corner(message.twist.covariance),
        ),
        WATER_LINKED: _water_linked,
    },
    "usbl": {
        "geometry_msgs/msg/PoseStamped": lambda message: (*_xyz(message.pose.position), *_NO_COVARIANCE),
        "geometry_msgs/msg/PointStamped": lambda message: (*_xyz(message.point), *_NO_COVARIANCE),
        "nav_msgs/msg/Odometry": lambda message: (
            *_xyz(message.pose.pose.position),
            *_corner(message.pose.covariance),
        ),
    },
    "odometry": {
        **_of_pose(lambda pose: (*_xyz(pose.position), *_xyzw(pose.orientation))),
        "geometry_msgs/msg/TransformStamped": _transform,
    },
}
"""role -> type name -> picker, beside those of the contract."""
