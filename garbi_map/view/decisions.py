"""The log that `garbi replay` writes, tick by tick. Its messages are standard ones; what they say is known by its names."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from garbi_map.log import Log

TOPIC = "/behaviours/decisions"
VERDICT, SAFE_SET, VOLUME = "/behaviours/verdict", "/behaviours/safe_set", "/behaviours/volume"
AXES = ("surge", "heave", "yaw", "pitch")
_LONGEST = 1e9
"""s that a log can last."""


@dataclass(frozen=True)
class Said:
    """What one part says: level 0 all well, larger is worse; in words; its figures by name, NaN where there is none."""

    level: int
    words: str
    values: dict[str, str]

    def number(self, name: str) -> float:
        """A figure, NaN where it is missing or no number."""
        try:
            return float(self.values.get(name, "nan"))
        except ValueError:
            return float("nan")

    def command(self) -> NDArray[np.float64]:
        """(4,) surge, heave m/s, yaw, pitch rad/s; zero where there is none."""
        return np.nan_to_num(np.array([self.number(axis) for axis in AXES]))


@dataclass
class Tick:
    """One decision: parts by name; pose in odom (3,), (4,) xyzw; allowed (k, 5); volume (n, 4) x y z occupied; each
    None where the log does not tell."""

    stamp_ns: int
    parts: dict[str, Said] = field(default_factory=dict)
    position: NDArray[np.float64] | None = None
    quaternion: NDArray[np.float64] | None = None
    allowed: NDArray[np.float64] | None = None
    volume: NDArray[np.float32] | None = None

    def named(self, prefix: str) -> dict[str, Said]:
        """The parts whose name begins with this, by the rest of it."""
        return {name.removeprefix(prefix): said for name, said in self.parts.items() if name.startswith(prefix)}


def read_ticks(log: Log) -> Iterator[Tick]:
    """The decisions as a stream. What cannot be read is counted in the log's losses."""
    from garbi_map.log.decode import BAD_MESSAGE
    from garbi_map.log.types import log_types

    types = log_types(())
    usable = {TOPIC: _statuses, log.settings.topics.odometry: _pose, SAFE_SET: _allowed, VOLUME: _volume}
    tick: Tick | None = None
    bad = 0
    for topic, message in log.messages(set(usable)):
        try:
            content = types.deserialize_cdr(message.data, log.topics[topic].type)
            if tick is None or message.log_time != tick.stamp_ns:
                if tick is not None and tick.parts:
                    yield tick
                tick = Tick(message.log_time)
            usable[topic](tick, content)
        except BAD_MESSAGE:
            bad += 1
    if tick is not None and tick.parts:
        yield tick
    if bad:
        log.lose(f"{TOPIC}: {bad} messages are not readable")


def read_verdicts(log: Log) -> dict[str, Said]:
    """What became of each expectation; its state is the figure `verdict`."""
    from garbi_map.log.decode import BAD_MESSAGE
    from garbi_map.log.types import log_types

    types = log_types(())
    tick = Tick(0)
    for topic, message in log.messages({VERDICT}):
        try:
            _statuses(tick, types.deserialize_cdr(message.data, log.topics[topic].type))
        except BAD_MESSAGE:
            log.lose(f"{VERDICT}: not readable")
    return tick.parts


def spans_of(log: Log) -> dict[str, tuple[float, float]]:
    """The seconds that an expectation speaks of, by the name that its verdict has; one that is not here: all of them."""
    import json

    try:
        listed = json.loads(log.metadata["garbi.behaviours"]["json"])["expectations"]
        named: dict[str, Any] = {}
        for number, one in enumerate(listed):
            named[one["kind"] if one["kind"] not in named else f"{one['kind']} {number + 1}"] = one.get("between")
        return {name: (float(span[0]), float(span[1])) for name, span in named.items() if span}
    except (KeyError, TypeError, ValueError, IndexError):
        return {}


def moments_of(said: Said) -> list[tuple[float, float, bool]] | None:
    """When an expectation was met and when not: from, to, s after the first decision; None where the log does not tell."""
    import json

    try:
        moments = [(float(begin), float(end), bool(met)) for begin, end, met in json.loads(said.values["moments"])]
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    return moments if all(0.0 <= begin <= end < _LONGEST for begin, end, _ in moments) else None


def _statuses(tick: Tick, content: Any) -> None:
    for number, status in enumerate(content.status):
        level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
        name = status.name if status.name not in tick.parts else f"{status.name} {number + 1}"
        tick.parts[name] = Said(level, status.message, {pair.key: pair.value for pair in status.values})


def _pose(tick: Tick, content: Any) -> None:
    at, turn = content.pose.pose.position, content.pose.pose.orientation
    tick.position, tick.quaternion = np.array([at.x, at.y, at.z]), np.array([turn.x, turn.y, turn.z, turn.w])


def _allowed(tick: Tick, content: Any) -> None:
    tick.allowed = np.asarray(content.data, float).reshape(-1, 5)


def _volume(tick: Tick, content: Any) -> None:
    tick.volume = np.frombuffer(bytes(content.data), np.float32).reshape(-1, 4)
