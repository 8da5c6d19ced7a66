"""What is in a log, what is missing and what that costs the map, what is damaged."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.log.decode import IMAGE_TYPES
from garbi_map.log.gaps import Rhythm, find_rhythms
from garbi_map.log.reader import Log
from garbi_map.log.records import Navigation

READ_WHOLE = 1 << 28  # bytes; a larger log is not read through unless asked for
FIRST_NS = 1_000_000_000  # of a larger log, whose messages are looked into
PERIODIC = ("image", "encoder", "imu", "pressure", "depth", "attitude", "dvl", "navsat", "usbl", "odometry")

COSTS = {
    "image": "there is nothing to map",
    "encoder": "the laser's angle is unknown: only a scanner whose rig file gives laser.fixed_angle can be mapped",
    "imu": "no attitude and no rates: the motion inside a sweep rests on registration alone, and the map may lean",
    "attitude": "no heading and no level: x of the map is where the vehicle first looked, and roll and pitch drift",
    "pressure": "no depth: z counts from the first pose instead of the surface, and drifts with the rest",
    "dvl": "no velocity: positions rest on registration and inertia, and drift by decimetres where the ground is flat",
    "fixes": "no absolute position: the map's origin is the first pose, it has no place on the chart",
    "tf_static": "lever arms are unknown: every sensor is taken to sit in base_link, which shears the map as it turns",
    "rig.yaml": "the log carries no calibration: give a rig file with --rig",
}


@dataclass(frozen=True)
class Gap:
    """Silence of a topic, s since the log's first message."""

    begin: float
    end: float


@dataclass(frozen=True)
class TopicCheck:
    """role is "" for a topic that the map does not use; rate Hz, the inverse of the median interval, 0 when unknown."""

    name: str
    type: str
    role: str
    count: int
    rate: float
    gaps: tuple[Gap, ...]


@dataclass(frozen=True)
class Missing:
    """Something that the log does not have, and what that costs, in words."""

    what: str
    topic: str
    cost: str


@dataclass(frozen=True)
class LogCheck:
    """The health of a log.

    duration    s, from first to last header stamp
    damage      what cannot be read, one line each
    unusable    why the log cannot be mapped as it is configured, one line each
    read_whole  every message was read and its checksum validated; else all is from the log's index, and damage inside
                of chunks is not known
    checksums   every part that was read carries a checksum; where not, damage cannot be seen
    shortest_gap  s; shorter silences were not looked for, as the log is too long to read its whole index; 0: all were
    """

    begin_ns: int
    duration: float
    topics: tuple[TopicCheck, ...]
    missing: tuple[Missing, ...]
    damage: tuple[str, ...]
    unusable: tuple[str, ...]
    read_whole: bool
    checksums: bool
    shortest_gap: float

    @property
    def mappable(self) -> bool:
        """There are images to map, and no topic has a type that cannot be used."""
        return not self.unusable

    def as_dict(self) -> dict[str, Any]:
        """Everything, as JSON can hold it."""
        return {**asdict(self), "mappable": self.mappable}


def check_log(log: Log, whole: bool | None = None) -> LogCheck:
    """Check a log. It is read through if `whole`, or (None) if it is smaller than READ_WHOLE; rates and gaps are by log
    time, from the message indexes where the log has them."""
    read_whole = log.size <= READ_WHOLE if whole is None else whole
    checksums = log.verify() if read_whole else True
    navigation, unusable = None, []
    try:
        if log.type_of("image", IMAGE_TYPES) is None:
            unusable.append(_no_images(log))
        navigation = log.navigation() if read_whole else log.navigation(log.begin_ns, log.begin_ns + FIRST_NS)
    except GarbiError as error:
        unusable.append(str(error))
    roles = {topic: role for role, topic in log.settings.topics.model_dump().items() if topic}
    rhythms = find_rhythms(log)
    begin = log.recorded_span()[0]
    topics = [
        _check_topic(name, topic.type, roles.get(name, ""), topic.count, rhythms.topics.get(name), begin)
        for name, topic in sorted(log.topics.items())
    ]
    return LogCheck(
        begin_ns=log.begin_ns,
        duration=(log.end_ns - log.begin_ns) * 1e-9,
        topics=tuple(topics),
        missing=tuple(_missing(log, navigation, read_whole)),
        damage=tuple(log.losses),
        unusable=tuple(unusable),
        read_whole=read_whole,
        checksums=checksums,
        shortest_gap=rhythms.blind,
    )


def _no_images(log: Log) -> str:
    pictures = [name for name, topic in log.topics.items() if topic.type in IMAGE_TYPES and topic.count]
    hint = f"; images are on {', '.join(pictures)}: garbi check --suggest-topics prints a topic map" if pictures else ""
    return f"no images on {log.settings.topics.image}, there is nothing to map{hint}"


def _check_topic(name: str, type_name: str, role: str, count: int, rhythm: Rhythm | None, begin: int) -> TopicCheck:
    interval = rhythm.interval if rhythm else 0.0
    rate = 1 / interval if interval > 0 else 0.0
    silences = rhythm.silences if rhythm and role in PERIODIC else ()
    gaps = tuple(Gap(float(first - begin) * 1e-9, float(last - begin) * 1e-9) for first, last in silences)
    return TopicCheck(name, type_name, role, count, rate, gaps)


def _missing(log: Log, navigation: Navigation | None, whole: bool) -> list[Missing]:
    names = log.settings.topics.model_dump()
    absent = {role for role, name in names.items() if name not in log.topics or log.topics[name].count == 0}
    missing = [Missing(role, names[role], COSTS[role]) for role in ("image", "encoder") if role in absent]
    # somebody else's trajectory stands in for what it was computed from
    if "odometry" in absent:
        if "depth" not in absent:
            absent.discard("pressure")
        if "attitude" not in absent:
            absent.discard("imu")
        missing += [Missing(role, names[role], COSTS[role]) for role in ("imu", "pressure", "dvl") if role in absent]
    if {"navsat", "usbl"} <= absent:
        missing.append(Missing("fixes", f"{names['navsat']}, {names['usbl']}", COSTS["fixes"]))
    if "tf_static" in absent:
        missing.append(Missing("tf_static", names["tf_static"], COSTS["tf_static"]))
    if log.rig_text is None:
        missing.append(Missing("rig.yaml", "", COSTS["rig.yaml"]))
    if navigation is not None:
        missing += _missing_inside(log, navigation, whole)
    return missing


def _missing_inside(log: Log, navigation: Navigation, whole: bool) -> list[Missing]:
    """What only the messages themselves tell: an IMU without attitude, a DVL that never saw the ground, mounts."""
    topics = log.settings.topics
    missing = []
    if navigation.imu is not None and np.isnan(navigation.imu.attitude).all():
        missing.append(Missing("attitude", topics.imu, COSTS["attitude"]))
    if whole and navigation.dvl is not None and np.isnan(navigation.dvl.velocity).all():
        missing.append(Missing("dvl", topics.dvl, f"it never saw the ground: {COSTS['dvl']}"))
    frames = {"imu_link": navigation.imu, "dvl_link": navigation.dvl, "pressure_link": navigation.pressure}
    needed = [frame for frame, sensor in frames.items() if sensor is not None] + ["rig"]
    if navigation.mounts:
        missing += [
            Missing(f"mount of {frame}", topics.tf_static, "it is taken to sit in base_link, without a lever arm")
            for frame in needed
            if frame not in navigation.mounts
        ]
    return missing
