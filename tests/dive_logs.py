"""Logs cut from the sample log, and what can be wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from garbi_map.log import LogWriter, open_log
from garbi_map.log.decode import stamp_of
from garbi_map.log.navigation import TRANSFORMS

SAMPLE = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"

IMAGE = "/camera/image/compressed"
ENCODER = "/laser/joint_states"
IMU = "/imu/data"
PRESSURE = "/depth/pressure"
DVL = "/dvl/twist"
TRUTH = "/truth/odometry"
ODOMETRY = "/odometry/filtered"

Change = Callable[[str, float, Any], Any]
Restamp = Callable[[str, float, int], int]


def rewrite(
    source: Path,
    target: Path,
    seconds: float = float("inf"),
    change: Change = lambda topic, at, message: message,
    restamp: Restamp = lambda topic, at, stamp_ns: stamp_ns,
    rename: dict[str, str] | None = None,
    rig: str | None = None,
) -> Path:
    """The first seconds of a log as another log.

    change(topic, s since the begin, message) gives the message to write, None leaves it out; restamp gives its header
    stamp, ns. rename: topic -> topic. rig: text of another rig.yaml, "" for none.
    """
    log = open_log([source])
    rig = log.rig_text if rig is None else rig
    with LogWriter(target) as writer:
        if rig:
            writer.attach("rig.yaml", "application/yaml", rig.encode())
        for topic, raw in log.messages(set(log.topics), end_ns=log.begin_ns + round(min(seconds, 1e6) * 1e9)):
            type_name = log.topics[topic].type
            message = writer.types.deserialize_cdr(raw.data, type_name)
            stamp = raw.log_time if type_name == TRANSFORMS else stamp_of(raw.data)
            at = (stamp - log.begin_ns) * 1e-9
            message = change(topic, at, message) if at < seconds else None
            if message is None:
                continue
            arrival, stamp = raw.arrival(stamp), restamp(topic, at, stamp)
            if hasattr(message, "header"):
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            writer.write((rename or {}).get(topic, topic), type_name, message, stamp, arrival)
    return target


def without(*topics: str) -> Change:
    """Some topics are not there at all."""
    return lambda topic, at, message: None if topic in topics else message


def later_part(begin: float) -> Change:
    """The log begins so many seconds later."""
    return lambda topic, at, message: message if at >= begin or topic == "/tf_static" else None


def stopped(after: float, *topics: str) -> Change:
    """Some topics stop after so many seconds."""
    return lambda topic, at, message: None if topic in topics and at > after else message


def silent(begin: float, end: float, *topics: str) -> Change:
    """Some topics have a hole."""
    return lambda topic, at, message: None if topic in topics and begin < at < end else message


def black(begin: float, end: float) -> Change:
    """The laser is off: images of water."""
    import numpy as np
    import simplejpeg

    dark = np.frombuffer(simplejpeg.encode_jpeg(np.full((576, 768, 3), 6, np.uint8), colorspace="BGR"), np.uint8)

    def change(topic: str, at: float, message: Any) -> Any:
        if topic == IMAGE and begin <= at < end:
            message.data = dark
        return message

    return change


def zeroed(source: Path, target: Path, begin: float, end: float) -> Path:
    """A stretch of the file, from one share of its length to another, overwritten with zeros."""
    data = bytearray(source.read_bytes())
    first, last = int(begin * len(data)), int(end * len(data))
    data[first:last] = bytes(last - first)
    target.write_bytes(data)
    return target


def swaying_bottom(topic: str, at: float, message: Any) -> Any:
    """The ground moves by centimetres as sea grass does, each row of the image otherwise."""
    import numpy as np
    import simplejpeg

    if topic == IMAGE:
        image = simplejpeg.decode_jpeg(message.data.tobytes(), colorspace="BGR")
        rows, columns = (np.arange(size) for size in image.shape[:2])
        shift = np.round(6.0 * np.sin(2.0 * np.pi * (at / 1.3 + rows / 150.0))).astype(int)
        moved = image[rows[:, None], (columns - shift[:, None]) % image.shape[1]]
        message.data = np.frombuffer(simplejpeg.encode_jpeg(moved, colorspace="BGR"), np.uint8)
    return message


def to_and_fro(turn: float) -> Change:
    """A vehicle that does not move: what images and encoder said until `turn` s, backward, forward again and so on.

    turn: about the moment of an image.
    """
    import numpy as np

    said: dict[str, list[tuple[float, Any]]] = {}

    def change(topic: str, at: float, message: Any) -> Any:
        known = said.setdefault(topic, [])
        if topic in (IMAGE, ENCODER):
            if at < turn:
                known.append((at, message.data if topic == IMAGE else message.position.copy()))
                return message
            end = said[IMAGE][-1][0]
            then = end - abs(at % (2.0 * end) - end)
            times = np.array([time for time, _ in known])
            if topic == IMAGE:
                message.data = known[int(np.abs(times - then).argmin())][1]
            else:
                message.position = np.array([np.interp(then, times, [value[0] for _, value in known])])
        if topic in (IMU, PRESSURE):
            known.append((at, message))
            for name in ("orientation", "linear_acceleration", "fluid_pressure"):
                if hasattr(message, name):
                    setattr(message, name, getattr(known[0][1], name))
            if topic == IMU:
                message.angular_velocity.x = message.angular_velocity.y = message.angular_velocity.z = 0.0
        return None if topic == DVL else message

    return change
