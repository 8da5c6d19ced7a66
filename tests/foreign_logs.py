"""A log as another program would have recorded it: its own topic names and types, raw images, several files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.writer import Writer
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from garbi_map.log import open_log
from garbi_map.log.decode import decode_image, stamp_of
from garbi_map.log.types import standard_types
from garbi_map.stripe.decode import decode

RENAMED = {
    "/camera/image/compressed": "/front_camera/image_raw",
    "/laser/joint_states": "/slit_motor/state",
    "/imu/data": "/mti/imu",
    "/depth/pressure": "/ctd/pressure",
    "/dvl/twist": "/nav/dvl_velocity",
    "/tf_static": "/tf_static",
}
OURS = standard_types()


@dataclass(frozen=True)
class Message:
    """topic, type and object of a message; arrival: what the recorder writes down as its time, ns."""

    topic: str
    type: str
    arrival: int
    message: Any


Retype = Callable[[str, str, Any], tuple[str, Any]]


def as_it_is(topic: str, type_name: str, message: Any) -> tuple[str, Any]:
    """The type stays."""
    return type_name, message


def other_types(topic: str, type_name: str, message: Any) -> tuple[str, Any]:
    """The encoder as a bare number of degrees, the pressure as a depth in a pose, the velocity without covariance."""
    make = OURS.types
    if topic == "/laser/joint_states":
        return "std_msgs/msg/Float64", make["std_msgs/msg/Float64"](data=float(np.degrees(message.position[0])))
    if topic == "/depth/pressure":
        depth = (message.fluid_pressure - 101325.0) / (1025.0 * 9.80665)
        turn = make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        pose = make["geometry_msgs/msg/Pose"](make["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=-depth), turn)
        return "geometry_msgs/msg/PoseStamped", make["geometry_msgs/msg/PoseStamped"](message.header, pose)
    if topic == "/dvl/twist":
        return "geometry_msgs/msg/TwistStamped", make["geometry_msgs/msg/TwistStamped"](
            message.header, message.twist.twist
        )
    return type_name, message


def told_again(source: Path, seconds: float, retype: Retype = as_it_is) -> Iterator[Message]:
    """The messages of the first seconds of a log, images decoded, in the order of their arrival."""
    log = open_log([source])
    found = []
    for topic, raw in log.messages(set(RENAMED), end_ns=log.begin_ns + round(seconds * 1e9)):
        type_name = log.topics[topic].type
        stamp = raw.log_time if topic == "/tf_static" else stamp_of(raw.data)
        if stamp >= log.begin_ns + round(seconds * 1e9):
            continue
        if topic == "/camera/image/compressed":
            type_name, message = "sensor_msgs/msg/Image", _raw(decode_image(OURS, type_name, raw.data, 0), raw.data)
        else:
            message = OURS.deserialize_cdr(raw.data, type_name)
        type_name, message = retype(topic, type_name, message)
        found.append(Message(RENAMED[topic], type_name, raw.arrival(stamp), message))
    return iter(sorted(found, key=lambda one: one.arrival))


def _raw(image: Any, data: memoryview) -> Any:
    pixels = decode(image)
    header: Any = OURS.deserialize_cdr(data, "sensor_msgs/msg/CompressedImage")
    return OURS.types["sensor_msgs/msg/Image"](
        header=header.header,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding="bgr8",
        is_bigendian=0,
        step=pixels.shape[1] * 3,
        data=pixels.ravel(),
    )


def write_split(folder: Path, messages: Iterator[Message], files: int = 3) -> Path:
    """A rosbag2 directory of several MCAP files."""
    folder.mkdir()
    listed = list(messages)
    names = [f"bag_{part}.mcap" for part in range(files)]
    for part, name in enumerate(names):
        with (folder / name).open("wb") as file:
            writer = Writer(file, chunk_size=1 << 20)
            writer.start("ros2", "another recorder")
            channels: dict[str, int] = {}
            for one in listed[part * len(listed) // files : (part + 1) * len(listed) // files]:
                if one.topic not in channels:
                    text = OURS.generate_msgdef(one.type, ros_version=2)[0].encode()
                    channels[one.topic] = writer.register_channel(
                        one.topic, "cdr", writer.register_schema(one.type, "ros2msg", text)
                    )
                data = bytes(OURS.serialize_cdr(one.message, one.type))
                writer.add_message(channels[one.topic], one.arrival, data, one.arrival)
            writer.finish()
    bag = {"version": 5, "storage_identifier": "mcap", "relative_file_paths": names}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": bag}))
    return folder


def write_database(folder: Path, messages: Iterator[Message]) -> Path:
    """A rosbag2 directory of an SQLite database."""
    with rosbag2.Writer(folder, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as bag:
        connections: dict[str, Any] = {}
        for one in messages:
            if one.topic not in connections:
                connections[one.topic] = bag.add_connection(one.topic, one.type, typestore=OURS)
            bag.write(connections[one.topic], one.arrival, OURS.serialize_cdr(one.message, one.type))
    return folder


def write_ros1(path: Path, messages: Iterator[Message]) -> Path:
    """A ROS 1 bag."""
    theirs = get_typestore(Stores.ROS1_NOETIC)
    theirs.register(
        {
            "tf2_msgs/msg/TFMessage": OURS.fielddefs["tf2_msgs/msg/TFMessage"],
        }
    )
    with rosbag1.Writer(path) as bag:
        connections: dict[str, Any] = {}
        for one in messages:
            if one.topic not in connections:
                connections[one.topic] = bag.add_connection(one.topic, one.type, typestore=theirs)
            bag.write(connections[one.topic], one.arrival, theirs.serialize_ros1(_ros1(theirs, one.message), one.type))
    return path


def _ros1(theirs: Any, message: Any) -> Any:
    """A message with ROS 1's header, which counts."""
    if isinstance(message, list):
        return [_ros1(theirs, one) for one in message]
    name = getattr(message, "__msgtype__", None)
    if name is None:
        return message
    fields = {
        field: _ros1(theirs, getattr(message, field)) for field in message.__dataclass_fields__ if field[0] != "_"
    }
    if name == "std_msgs/msg/Header":
        fields["seq"] = 7
    return theirs.types[name](**fields)
