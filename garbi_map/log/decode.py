"""ROS 2 messages to rows of numbers.

A decoder takes a message's bytes (CDR, with its four bytes of encapsulation) and gives (stamp ns, values), or None
where the message honestly carries no value (no satellite fix, another joint); the stamp is None where the message has
no header. On nonsense it raises one of BAD_MESSAGE.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from garbi_map.log.foreign import HEADERLESS, PICKERS
from garbi_map.log.records import Image
from garbi_map.log.types import DVL_MESSAGE

Decoder = Callable[[memoryview], tuple[int | None, Sequence[float]] | None]
BAD_MESSAGE = (SerdeError, struct.error, ValueError, LookupError, TypeError, AttributeError, OverflowError, MemoryError)
IMAGE_TYPES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
UNKNOWN_VARIANCE = 1e6  # m^2, of a height that a satellite fix does not give

_HEADER = {1: struct.Struct("<iII"), 0: struct.Struct(">iII")}
_NAN3 = (math.nan,) * 3


def frame_of(data: memoryview) -> str:
    """The frame of any message that begins with a std_msgs/Header."""
    length = _header(data)[2]
    return bytes(data[16 : 16 + length]).rstrip(b"\0").decode()


def stamp_of(data: memoryview) -> int:
    """The header stamp of any message that begins with a std_msgs/Header, ns."""
    seconds, nanoseconds, _ = _header(data)
    return seconds * 1_000_000_000 + nanoseconds


def _header(data: memoryview) -> tuple[int, int, int]:
    if data[0] != 0 or data[1] > 1:
        raise ValueError("unsupported encapsulation")
    return _HEADER[data[1]].unpack_from(data, 4)


def _doubles(count: int, pick: Callable[[tuple[float, ...]], Sequence[float]]) -> Decoder:
    """Decoder of a message that is a header and then `count` float64: the frequent ones, read without any object."""
    body = {1: struct.Struct(f"<{count}d"), 0: struct.Struct(f">{count}d")}

    def decode(data: memoryview) -> tuple[int, Sequence[float]]:
        seconds, nanoseconds, frame_length = _header(data)
        start = 4 + ((12 + frame_length + 7) & ~7)
        if not start + 8 * count <= len(data) <= start + 8 * count + 3:
            raise ValueError("message of the wrong length")
        return seconds * 1_000_000_000 + nanoseconds, pick(body[data[1]].unpack_from(data, start))

    return decode


# float64 fields in the order of the message definitions
_imu = _doubles(37, lambda v: (*v[13:16], *v[25:28], *v[0:4], *v[4:13]))
_pressure = _doubles(2, lambda v: v[:1])
_twist = _doubles(42, lambda v: (*v[0:3], *v[6:9], *v[12:15], *v[18:21]))
_pose = _doubles(43, lambda v: (*v[0:3], *v[7:10], *v[13:16], *v[19:22]))


def _generic(types: Typestore, name: str, pick: Callable[[Any], Sequence[float] | None]) -> Decoder:
    def decode(data: memoryview) -> tuple[int | None, Sequence[float]] | None:
        message: Any = types.deserialize_cdr(data, name)
        values = pick(message)
        stamp = None if name in HEADERLESS else _stamp(message)
        return None if values is None else (stamp, values)

    return decode


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)


def _joint(joint: str, seen: set[str]) -> Callable[[Any], Sequence[float] | None]:
    def pick(message: Any) -> Sequence[float] | None:
        names = message.name
        if len(names) == 1:
            seen.add(names[0])
            return (message.position[0],)
        seen.update(names)
        return (message.position[names.index(joint)],) if joint in names else None

    return pick


def _odometry(message: Any) -> Sequence[float]:
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    return at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w


def _navsat(message: Any) -> Sequence[float] | None:
    if message.status.status < 0:
        return None
    height, covariance = message.altitude, list(message.position_covariance)
    if math.isnan(height):
        height, covariance[8] = 0.0, UNKNOWN_VARIANCE
    return message.latitude, message.longitude, height, *covariance


def _dvl(message: Any) -> Sequence[float]:
    valid = message.velocity_mode == 1 and message.beam_velocities_valid
    velocity = (message.velocity.x, message.velocity.y, message.velocity.z) if valid else _NAN3
    return *velocity, *message.velocity_covar


WIDTHS = {
    "encoder": 1, "imu": 19, "pressure": 1, "depth": 1, "attitude": 4,
    "dvl": 12, "navsat": 12, "usbl": 12, "odometry": 7,
}  # fmt: skip
"""Values in a row, by role."""


def decoders(types: Typestore, joint: str, joints_seen: set[str]) -> dict[str, dict[str, Decoder]]:
    """role -> type name -> decoder. Names of joints that were met are added to `joints_seen`."""
    joints = "sensor_msgs/msg/JointState"
    own: dict[str, dict[str, Decoder]] = {
        "encoder": {joints: _generic(types, joints, _joint(joint, joints_seen))},
        "imu": {"sensor_msgs/msg/Imu": _imu},
        "pressure": {"sensor_msgs/msg/FluidPressure": _pressure},
        "dvl": {
            "geometry_msgs/msg/TwistWithCovarianceStamped": _twist,
            DVL_MESSAGE: _generic(types, DVL_MESSAGE, _dvl),
        },
        "navsat": {"sensor_msgs/msg/NavSatFix": _generic(types, "sensor_msgs/msg/NavSatFix", _navsat)},
        "usbl": {"geometry_msgs/msg/PoseWithCovarianceStamped": _pose},
        "odometry": {"nav_msgs/msg/Odometry": _generic(types, "nav_msgs/msg/Odometry", _odometry)},
    }
    return {
        role: {
            **{name: _generic(types, name, pick) for name, pick in PICKERS.get(role, {}).items()},
            **own.get(role, {}),
        }
        for role in WIDTHS
    }


def decode_image(types: Typestore, type_name: str, data: memoryview, arrival_ns: int) -> Image:
    """An image message, its pixels left as they are."""
    message: Any = types.deserialize_cdr(data, type_name)
    if type_name == IMAGE_TYPES[0]:
        return Image(_stamp(message), arrival_ns, _file_format(message.format), message.data.tobytes())
    if message.height * message.step != len(message.data) or not message.step:
        raise ValueError("image of the wrong size")
    return Image(
        _stamp(message),
        arrival_ns,
        message.encoding,
        message.data.tobytes(),
        height=message.height,
        width=message.width,
        step=message.step,
    )


def _file_format(stated: str) -> str:
    """ "jpeg", "png", ... of a CompressedImage.format such as "bgr8; jpeg compressed bgr8" or "jpg"."""
    lowered = stated.lower()
    if "png" in lowered:
        return "png"
    return "jpeg" if "jpeg" in lowered or "jpg" in lowered else stated
