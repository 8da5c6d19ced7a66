"""Which topic of a foreign log is what: guessed from types, names and what the messages say."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import yaml

from garbi_map.importing.plausible import judge
from garbi_map.importing.probe import Probe, probe
from garbi_map.log import Frames, Log, LogSettings, Scale, Topics
from garbi_map.log.decode import IMAGE_TYPES
from garbi_map.log.navigation import TRANSFORMS, read_mounts
from garbi_map.words import many

CONTRACT = {
    "image": IMAGE_TYPES,
    "encoder": ("sensor_msgs/msg/JointState",),
    "imu": ("sensor_msgs/msg/Imu",),
    "pressure": ("sensor_msgs/msg/FluidPressure",),
    "dvl": ("geometry_msgs/msg/TwistWithCovarianceStamped", "marine_acoustic_msgs/msg/Dvl", "dvl_msgs/msg/DVL"),
    "navsat": ("sensor_msgs/msg/NavSatFix",),
    "usbl": ("geometry_msgs/msg/PoseWithCovarianceStamped",),
    "odometry": ("nav_msgs/msg/Odometry",),
}
"""Types that are as good as a name."""
NAMES = {
    "image": r"image|camera|cam\b|video",
    "encoder": r"laser|encoder|joint|motor|servo|slit|mirror|galvo|alpha|angle",
    "imu": r"imu|mti|xsens|ahrs|vectornav|microstrain",
    "pressure": r"pressure|baro|ctd|paro|bar30",
    "depth": r"depth|ctd|paro",
    "attitude": r"attitude|orientation|ahrs|compass|heading",
    "dvl": r"dvl|doppler|bottom|velocity",
    "navsat": r"gps|gnss|fix|navsat",
    "usbl": r"usbl|lbl|acoustic",
    "odometry": r"odom|pose|filtered|slam|ekf|navigation",
}
AVOID = r"cmd|command|setpoint|desired|target|reference|truth|debug|overlay|thermal|sonar|disparity|mask"
ORDER = ("image", "encoder", "imu", "pressure", "depth", "dvl", "navsat", "usbl", "odometry", "attitude")
SENSOR_FRAMES = {"imu": "imu_link", "dvl": "dvl_link", "pressure": "pressure_link", "depth": "pressure_link"}
LEAST = 3


@dataclass(frozen=True)
class Candidate:
    """A topic that could play a role; the higher the score, the likelier. scale: from its unit to SI."""

    role: str
    topic: str
    type: str
    score: int
    remark: str
    scale: float = 1.0
    frame: str = ""
    attitude: bool = False


@dataclass(frozen=True)
class Suggestion:
    """chosen: role -> the likeliest topic; others: what else could play a role; found: what the log has of the rest
    ("tf_static", "camera_info"); remarks: for a reader."""

    chosen: dict[str, Candidate]
    others: list[Candidate]
    found: dict[str, str]
    frames: dict[str, str]
    remarks: list[str] = field(default_factory=list)

    def settings(self) -> LogSettings:
        """How the log is to be read; what was not found is left out."""
        topics = dict.fromkeys(Topics.model_fields, "")
        topics |= {role: one.topic for role, one in self.chosen.items()} | self.found
        scale = {role: one.scale for role, one in self.chosen.items() if role in Scale.model_fields}
        return LogSettings(topics=Topics(**topics), scale=Scale(**scale), frames=Frames(**self.frames))

    def to_yaml(self) -> str:
        """A configuration with the reasons as comments."""
        settings = self.settings()
        lines = [*(f"# {_line(text)}" for text in self.remarks), "log:", "  topics:"]
        for role, topic in settings.topics.model_dump().items():
            one = self.chosen.get(role)
            why = one.remark if one else "" if topic else "nothing fits"
            lines.append(f"    {role}: {_text(topic)}" + (f"  # {_line(why)}" if why else ""))
        scales = [f"    {role}: {scale!r}" for role, scale in settings.scale.model_dump().items() if scale != 1.0]
        frames = [f"    {ours}: {_text(theirs)}" for ours, theirs in self.frames.items()]
        lines += ["  scale:", *scales] if scales else []
        lines += ["  frames:", *frames] if frames else []
        for one in self.others:
            lines.append(f"# or {one.role}: {_line(_text(one.topic))} ({_line(one.remark)})")
        return "\n".join(lines) + "\n"


def suggest_topics(log: Log, seconds: float = 20.0) -> Suggestion:
    """Guess every role's topic from the first seconds of a log, opened with whatever settings."""
    probes = probe(log, seconds)
    length = max((log.end_ns - log.begin_ns) * 1e-9, 1e-3)
    ranked: dict[str, list[Candidate]] = {}
    for one in probes:
        ranked.setdefault(one.role, []).append(_candidate(one, log.topics[one.topic].count, length))
    chosen: dict[str, Candidate] = {}
    used: set[str] = set()
    others: list[Candidate] = []
    for role in ORDER:
        if (role == "depth" and "pressure" in chosen) or (role == "attitude" and _has_attitude(chosen)):
            continue
        likely = sorted((c for c in ranked.get(role, []) if c.score >= LEAST), key=lambda c: -c.score)
        free = [candidate for candidate in likely if candidate.topic not in used]
        if free:
            chosen[role] = free[0]
            used.add(free[0].topic)
            others += free[1:]
    found = _the_rest(log, chosen.get("image"))
    frames, remarks = _frames(log, chosen, found)
    remarks += [
        f"no {role}: {what}"
        for role, what in (("image", "nothing to map"), ("encoder", "the rig file must give laser.fixed_angle"))
        if role not in chosen
    ]
    return Suggestion(chosen, others, found, frames, remarks)


def _candidate(one: Probe, count: int, length: float) -> Candidate:
    verdict = judge(one.role, one.values)
    score = verdict.score + (3 if one.type in CONTRACT.get(one.role, ()) else 0)
    score += 2 if re.search(NAMES[one.role], one.topic, re.IGNORECASE) else 0
    score -= 4 if re.search(AVOID, one.topic, re.IGNORECASE) else 0
    joints = f"joints {', '.join(sorted(one.joints)[:6])}: laser.joint of the rig file" if len(one.joints) > 1 else ""
    told = [
        one.type.rpartition("/")[2],
        many(count, "message"),
        f"{count / length:.3g} Hz",
        one.picture,
        verdict.remark,
        joints,
    ]
    values = one.values
    attitude = (
        one.role == "imu" and bool(len(values)) and bool((values[:, 10] != -1).any() and (values[:, 6:10] != 0).any())
    )
    return Candidate(
        one.role, one.topic, one.type, score, ", ".join(filter(None, told)), verdict.scale, one.frame, attitude
    )


def _has_attitude(chosen: Mapping[str, Candidate]) -> bool:
    return "imu" in chosen and chosen["imu"].attitude


def _the_rest(log: Log, image: Candidate | None) -> dict[str, str]:
    """The topics that their type alone tells: static transforms, and what the camera says of itself."""
    found: dict[str, str] = {}
    for name, about in log.topics.items():
        if about.type == TRANSFORMS and "static" in name:
            found.setdefault("tf_static", name)
        if about.type == "sensor_msgs/msg/CameraInfo" and _near(name, image):
            found.setdefault("camera_info", name)
    return found


def _near(name: str, image: Candidate | None) -> bool:
    """Whether a topic belongs to the same camera."""
    return image is not None and name.split("/")[:2] == image.topic.split("/")[:2]


def _frames(log: Log, chosen: Mapping[str, Candidate], found: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """What the log calls the sensors' frames, where its transforms know them."""
    if "tf_static" not in found:
        return {}, ["no static transforms: every sensor is taken to sit in base_link"]
    known = read_mounts(log, found["tf_static"])
    if not known:
        return {}, [f"no static transform leads to {log.settings.base_frame}: set log.base_frame"]
    frames = {
        SENSOR_FRAMES[role]: one.frame
        for role, one in chosen.items()
        if role in SENSOR_FRAMES and one.frame.lstrip("/") in known and one.frame != SENSOR_FRAMES[role]
    }
    names = ", ".join(sorted(known)[:12])
    return frames, [] if "rig" in known else [f"no frame is called rig: set log.frames.rig to one of {names}"]


def _text(value: str) -> str:
    """A YAML scalar on one line, whatever is in it."""
    return yaml.safe_dump(value, default_style='"', width=2**31, allow_unicode=False).strip()


def _line(text: str) -> str:
    """Text from an untrusted log, fit for a comment."""
    return "".join(letter if letter.isprintable() else " " for letter in text)[:300]
