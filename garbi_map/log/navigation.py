"""The navigation of a log: raw messages to ascending arrays, what cannot be believed left out and named."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.log.attitude import with_attitude
from garbi_map.log.decode import BAD_MESSAGE, WIDTHS, Decoder, decoders
from garbi_map.log.frames import east_north_up, mounts_in
from garbi_map.log.records import (
    Attitude,
    Dvl,
    Encoder,
    Fixes,
    Floats,
    Imu,
    Mount,
    Navigation,
    Odometry,
    Pressure,
    Stamps,
)
from garbi_map.log.stamps import believable, in_order
from garbi_map.log.types import log_types
from garbi_map.words import many

if TYPE_CHECKING:
    from garbi_map.log.reader import Log

TRANSFORMS = "tf2_msgs/msg/TFMessage"
ATMOSPHERE, WATER_DENSITY, GRAVITY = 101325.0, 1025.0, 9.80665  # Pa, kg/m^3, m/s^2


@dataclass
class _Column:
    """The rows of one topic while they are read."""

    width: int
    decode: Decoder
    stamps: array[int] = field(default_factory=lambda: array("q"))
    arrivals: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    bad: int = 0


@dataclass(frozen=True)
class _Rows:
    stamp_ns: Stamps
    arrival_ns: Stamps
    values: Floats


def read_navigation(log: Log, begin_ns: int | None, end_ns: int | None, joint: str) -> Navigation:
    """See Log.navigation."""
    types = log_types(log.schemas())
    joints: set[str] = set()
    columns: dict[str, _Column] = {}
    for role, usable in decoders(types, joint, joints).items():
        type_name = log.type_of(role, tuple(usable))
        if type_name is not None:
            columns[role] = _Column(WIDTHS[role], usable[type_name])
    _fill(log, columns, begin_ns, end_ns)
    if joints and joint not in joints and len(joints) > 1:
        topic = log.settings.topics.encoder
        raise GarbiError(f"topic {topic}: has joints {', '.join(sorted(joints)[:8])}, but none named {joint}")
    rows = {role: _believed(log, role, column) for role, column in columns.items()}
    records: dict[str, Any] = {
        role: _BUILDERS[role](found) for role, found in rows.items() if found is not None and role in _BUILDERS
    }
    navsat = records.pop("navsat", None)
    fixes = records.pop("usbl", None) or navsat
    attitude, depth = rows.get("attitude"), rows.get("depth")
    if attitude is not None:
        turns = Attitude(attitude.stamp_ns, attitude.arrival_ns, attitude.values)
        records["imu"] = with_attitude(records.get("imu"), turns)
    if depth is not None:
        records.setdefault("pressure", Pressure(depth.stamp_ns, depth.arrival_ns, pressure_at(depth.values[:, 0])))
    return Navigation(**records, fixes=fixes, mounts=find_mounts(log))


def pressure_at(depth: Floats) -> Floats:
    """Absolute pressure, Pa, at depths, m, in the water and under the air that `navigate` assumes by default."""
    return ATMOSPHERE + WATER_DENSITY * GRAVITY * depth


def _fill(log: Log, columns: dict[str, _Column], begin_ns: int | None, end_ns: int | None) -> None:
    by_topic: dict[str, list[_Column]] = {}
    for role, one in columns.items():
        by_topic.setdefault(getattr(log.settings.topics, role), []).append(one)
    first = -(1 << 63) if begin_ns is None else begin_ns
    last = (1 << 63) - 1 if end_ns is None else end_ns
    for topic, message in log.messages(set(by_topic), begin_ns, end_ns):
        for column in by_topic[topic]:
            try:
                row = column.decode(message.data)
                if row is None:
                    continue
                stamp, values = row
                if len(values) != column.width:
                    raise ValueError("row of the wrong width")
                if stamp is None:
                    stamp = log.stamp_of_recording(message.log_time)
                    log.remark(f"{topic}: its messages have no stamp; the time of recording is taken for it")
                if first <= stamp < last:
                    column.values.extend(values)
                    column.stamps.append(stamp)
                    column.arrivals.append(message.arrival(stamp))
            except BAD_MESSAGE:
                column.bad += 1


def _believed(log: Log, role: str, column: _Column) -> _Rows | None:
    """The rows that can be used, ascending; what was left out is named in the log's losses."""
    topic = getattr(log.settings.topics, role)
    if column.bad:
        log.lose(f"{topic}: {many(column.bad, 'message')} left out: not readable")
    stamps, arrivals = np.array(column.stamps, np.int64), np.array(column.arrivals, np.int64)
    values = np.array(column.values).reshape(-1, column.width) * getattr(log.settings.scale, role, 1.0)
    keep = _usable(role, values)
    if not keep.all():
        log.lose(f"{topic}: {many(int(np.count_nonzero(~keep)), 'message')} left out: not a number")
    stamps, arrivals, values = stamps[keep], arrivals[keep], values[keep]
    if not len(stamps):
        return None
    near = believable(stamps, arrivals, int(log.settings.clock_tolerance * 1e9))
    stamps, arrivals, values = stamps[near], arrivals[near], values[near]
    order = in_order(stamps, int(log.settings.reorder * 1e9))
    left_out = int(np.count_nonzero(~near)) + len(stamps) - len(order)
    if left_out:
        log.lose(
            f"{topic}: {many(left_out, 'message')} left out: a stamp repeats, goes back or is far from the arrival"
        )
    return _Rows(stamps[order], arrivals[order], values[order])


# what must be a number for a message to be of any use: all columns but those named here
_MAY_BE_NAN: dict[str, Any] = {
    "imu": slice(6, None),
    "dvl": slice(None),
    "usbl": slice(3, None),
    "navsat": slice(3, None),
}


def _usable(role: str, values: Floats) -> NDArray[np.bool_]:
    required = np.array(values)
    ignored = _MAY_BE_NAN.get(role, slice(0))
    if role == "imu" and np.isnan(values[:, :6]).all():
        ignored = np.r_[0:6, 10:19]  # a compass: its attitude is all that it has to say
    required[:, ignored] = 0.0
    usable = np.asarray(np.isfinite(required).all(axis=1))
    if role in ("odometry", "attitude"):
        usable &= np.linalg.norm(values[:, -4:], axis=1) > 0.5
    return usable


def _imu(rows: _Rows) -> Imu:
    attitude = rows.values[:, 6:10]
    length = np.linalg.norm(attitude, axis=1)
    covariance = rows.values[:, 10:19].reshape(-1, 3, 3)
    given = (length > 0.5) & np.isfinite(length) & (covariance[:, 0, 0] != -1)
    with np.errstate(invalid="ignore", divide="ignore"):
        attitude = np.where(given[:, None], attitude / length[:, None], np.nan)
    return Imu(rows.stamp_ns, rows.arrival_ns, rows.values[:, 0:3], rows.values[:, 3:6], attitude, covariance)


def _dvl(rows: _Rows) -> Dvl:
    velocity = rows.values[:, :3]
    velocity = np.where(np.isfinite(velocity).all(axis=1, keepdims=True), velocity, np.nan)
    return Dvl(rows.stamp_ns, rows.arrival_ns, velocity, rows.values[:, 3:].reshape(-1, 3, 3))


def _navsat(rows: _Rows) -> Fixes:
    latitude, longitude, height = (float(number) for number in rows.values[0, :3])
    origin = (latitude, longitude, height)
    position = east_north_up(rows.values[:, :3], origin)
    return Fixes(rows.stamp_ns, rows.arrival_ns, position, rows.values[:, 3:].reshape(-1, 3, 3), origin)


def _usbl(rows: _Rows) -> Fixes:
    return Fixes(rows.stamp_ns, rows.arrival_ns, rows.values[:, :3], rows.values[:, 3:].reshape(-1, 3, 3))


def _odometry(rows: _Rows) -> Odometry:
    turn = rows.values[:, 3:7]
    return Odometry(
        rows.stamp_ns, rows.arrival_ns, rows.values[:, :3], turn / np.linalg.norm(turn, axis=1, keepdims=True)
    )


_BUILDERS: dict[str, Callable[[_Rows], Any]] = {
    "encoder": lambda rows: Encoder(rows.stamp_ns, rows.arrival_ns, rows.values[:, 0]),
    "imu": _imu,
    "pressure": lambda rows: Pressure(rows.stamp_ns, rows.arrival_ns, rows.values[:, 0]),
    "dvl": _dvl,
    "navsat": _navsat,
    "usbl": _usbl,
    "odometry": _odometry,
}


def find_mounts(log: Log) -> dict[str, Mount]:
    """The mounts by the names that the map uses."""
    mounts = read_mounts(log, log.settings.topics.tf_static)
    called = log.settings.frames.model_dump()
    known = {ours: mounts[theirs] for ours, theirs in called.items() if theirs in mounts}
    return {frame: mount for frame, mount in mounts.items() if frame not in called} | known


def read_mounts(log: Log, topic: str) -> dict[str, Mount]:
    """Poses base <- frame by the log's own names. Static transforms are sent once, whenever: they are read from the
    whole log. Raises GarbiError where the topic is of another type."""
    about = log.topics.get(topic)
    if about is None or about.count == 0:
        return {}
    if about.type != TRANSFORMS:
        raise GarbiError(f"topic {topic}: type {about.type} cannot be used as tf_static; wanted is {TRANSFORMS}")
    types = log_types(())
    found: dict[str, tuple[str, str, Mount]] = {}
    bad = 0
    for _, message in log.messages({topic}):
        try:
            transforms: Any = types.deserialize_cdr(message.data, TRANSFORMS)
            for transform in transforms.transforms:
                parent, child = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
                found[child] = (parent, child, _mount(transform.transform))
        except BAD_MESSAGE:
            bad += 1
    if bad:
        log.lose(f"{topic}: {many(bad, 'message')} left out: not a readable transform")
    return mounts_in(log.settings.base_frame, found.values())


def _mount(transform: Any) -> Mount:
    at, turn = transform.translation, transform.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    translation = np.array([at.x, at.y, at.z])
    length = np.linalg.norm(quaternion)
    if not (np.isfinite(translation).all() and 0.5 < length < 2):
        raise ValueError("no rotation")
    return Mount(translation, quaternion / length)
