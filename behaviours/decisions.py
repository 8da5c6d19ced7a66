"""Every decision, explained, as standard messages in a log that Rerun and Foxglove open."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.moving import Mover
from behaviours.types import AXES, Command, Pose, Proposal
from garbi_map.log import LogWriter
from garbi_map.log.records import Floats
from garbi_map.words import many

OK, WARN, ERROR, STALE = 0, 1, 2, 3
COMMAND, DECISIONS, VERDICT = "/behaviours/command", "/behaviours/decisions", "/behaviours/verdict"
SAFE_SET, VOLUME = "/behaviours/safe_set", "/behaviours/volume"


@dataclass(frozen=True)
class Decision:
    """One tick.

    proposals  of each behaviour, with activation and reason
    merged     what the coordinator made of them; winner, merging: whose it mostly is, in words
    command    what safety let through; changes: what it changed and why; braked: it more than halved the surge
    troubles   what was wrong with the input
    obstacle   m from the bow to what the newest profiles show in its way, inf: they show nothing
    view       what is known of the water ahead, in words
    movers     what moves;  allowed: see `behaviours.safety.Filtered`
    volume     now and then: occupied (n, 3) and some of the free (m, 3) voxels, m in odom
    """

    now_ns: int
    pose: Pose | None
    proposals: list[Proposal]
    merged: Command
    winner: str
    merging: str
    command: Command
    changes: list[str]
    braked: bool
    troubles: list[str]
    obstacle: float
    view: str
    movers: Sequence[Mover] = ()
    allowed: Floats | None = None
    volume: tuple[Floats, Floats] | None = None

    def proposal(self, name: str) -> Proposal | None:
        """What the behaviour of that name proposed."""
        return next((one for one in self.proposals if one.name == name), None)

    def text(self) -> str:
        """All of it in one line."""
        parts = [f"{one.name} {one.activation:.2f}: {one.reason}" for one in self.proposals]
        parts.append(f"coordinator: {self.merging}")
        parts.append("safety: " + ("; ".join(self.changes) or "nothing to change"))
        parts.append(f"view: {self.view}")
        parts += [f"input: {trouble}" for trouble in self.troubles]
        return " | ".join(parts)


class DecisionWriter:
    """Writes decisions to MCAP; a context manager. The same decisions make the same bytes.

    to: a file of their own, or the log of a recording that is under way.
    """

    def __init__(self, to: Path | LogWriter) -> None:
        self._log = to if isinstance(to, LogWriter) else LogWriter(to)
        self._make = self._log.types.types

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._log.__exit__(kind, error, trace)

    def write(self, decision: Decision) -> None:
        """One tick: the command and everything that led to it."""
        self.write_command(decision.now_ns, decision.command)
        self.write_reasons(decision)
        self._write_scene(decision)

    def write_reasons(self, decision: Decision, *more: tuple[int, str, str, dict[str, str]]) -> None:
        """What each part had to say, and who else has; see `parts`."""
        self._write_array(DECISIONS, decision.now_ns, [self._status(*part) for part in (*parts(decision), *more)])

    def write_verdict(
        self, now_ns: int, lines: list[tuple[str, str, str]], moments: list[list[tuple[float, float, bool]]]
    ) -> None:
        """(expectation, what became of it: held, failed, no encounter; in words), and when each was met and when not:
        from, to, s after the first decision."""
        levels = {"held": OK, "failed": ERROR, "no encounter": STALE}
        statuses = []
        for (name, state, words), own in zip(lines, moments, strict=True):
            when = json.dumps([[round(begin, 3), round(end, 3), met] for begin, end, met in own])
            statuses.append(self._status(levels[state], name, words, {"verdict": state, "moments": when}))
        self._write_array(VERDICT, now_ns, statuses)

    def write_metadata(self, name: str, record: dict[str, str]) -> None:
        """What the decisions were made with."""
        self._log.write_metadata(name, record)

    def write_command(self, now_ns: int, command: Command) -> None:
        """The command alone."""
        vector = self._make["geometry_msgs/msg/Vector3"]
        twist = self._make["geometry_msgs/msg/Twist"](
            linear=vector(x=command.surge, y=0.0, z=command.heave),
            angular=vector(x=0.0, y=command.pitch, z=command.yaw),
        )
        message = self._make["geometry_msgs/msg/TwistStamped"](
            header=self._log.header(now_ns, "base_link"), twist=twist
        )
        self._log.write(COMMAND, "geometry_msgs/msg/TwistStamped", message, now_ns)

    def _write_scene(self, decision: Decision) -> None:
        """What was known of the surroundings, for whoever looks at the decision."""
        now = decision.now_ns
        if decision.pose is not None:
            turn = Rotation.from_matrix(decision.pose.rotation).as_quat()
            self._log.write_odometry(now, decision.pose.position, turn)
        if decision.allowed is not None:
            dimension = self._make["std_msgs/msg/MultiArrayDimension"](label="row bound", size=5, stride=5)
            layout = self._make["std_msgs/msg/MultiArrayLayout"](dim=[dimension], data_offset=0)
            message = self._make["std_msgs/msg/Float64MultiArray"](layout=layout, data=decision.allowed.ravel())
            self._log.write(SAFE_SET, "std_msgs/msg/Float64MultiArray", message, now)
        if decision.volume is not None:
            self._log.write(VOLUME, "sensor_msgs/msg/PointCloud2", self._cloud(now, *decision.volume), now)

    def _cloud(self, now_ns: int, occupied: Floats, free: Floats) -> Any:
        states = np.r_[np.ones(len(occupied)), np.zeros(len(free))]
        points = np.c_[np.r_[occupied, free], states].astype(np.float32)
        fields = [
            self._make["sensor_msgs/msg/PointField"](name=name, offset=4 * k, datatype=7, count=1)
            for k, name in enumerate(("x", "y", "z", "occupied"))
        ]
        return self._make["sensor_msgs/msg/PointCloud2"](
            header=self._log.header(now_ns, "odom"), height=1, width=len(points), fields=fields, is_bigendian=False,
            point_step=16, row_step=16 * len(points), data=np.frombuffer(points.tobytes(), np.uint8), is_dense=True,
        )  # fmt: skip

    def _status(self, level: int, name: str, message: str, values: dict[str, str]) -> Any:
        pairs = [self._make["diagnostic_msgs/msg/KeyValue"](key=key, value=value) for key, value in values.items()]
        return self._make["diagnostic_msgs/msg/DiagnosticStatus"](
            level=level, name=name, message=message, hardware_id="garbi", values=pairs
        )

    def _write_array(self, topic: str, now_ns: int, statuses: list[Any]) -> None:
        message = self._make["diagnostic_msgs/msg/DiagnosticArray"](
            header=self._log.header(now_ns, "base_link"), status=statuses
        )
        self._log.write(topic, "diagnostic_msgs/msg/DiagnosticArray", message, now_ns)


def parts(decision: Decision) -> Iterator[tuple[int, str, str, dict[str, str]]]:
    """What each part had to say: level, name, words, figures."""
    feed = {"view": decision.view, "obstacle": _number(decision.obstacle), **_pose(decision.pose)}
    yield WARN if decision.troubles else OK, "feed", "; ".join(decision.troubles) or "all well", feed
    for one in decision.proposals:
        values = {"activation": _number(one.activation), "priority": str(one.priority), "axes": " ".join(one.axes)}
        values |= {key: _number(value) for key, value in one.facts.items()}
        yield OK, f"behaviour/{one.name}", one.reason, values | _values(one.command)
    yield OK, "coordinator", decision.merging, {"winner": decision.winner, **_values(decision.merged)}
    changes = "; ".join(decision.changes)
    yield WARN if changes else OK, "safety", changes or "nothing to change", _values(decision.command)
    for mover in decision.movers:
        place = [*mover.at(decision.now_ns), *mover.velocity, mover.radius]
        figures = dict(zip(("x", "y", "z", "vx", "vy", "vz", "radius"), map(_number, place), strict=True))
        yield WARN, f"moving/{mover.number}", f"seen in {many(mover.passes, 'pass', 'passes')}", figures


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "none"


def _values(command: Command) -> dict[str, str]:
    return {axis: _number(value) for axis, value in zip(AXES, command.array(), strict=True)}


def _pose(pose: Pose | None) -> dict[str, str]:
    if pose is None:
        return {}
    names = ("x", "y", "z")
    return {name: _number(float(value)) for name, value in zip(names, pose.position, strict=True)} | {
        "heading": _number(pose.heading),
        "speed": _number(float(pose.velocity[0])),
        "sway": _number(float(pose.velocity[1])),
    }
