"""What is expected of the decisions on a log: stated in YAML, judged on the decisions alone.

A replay is open loop: the motion is somebody else's. Reaction times count from the first profile that shows the obstacle.
An expectation holds, fails, or met nothing that it speaks of: no encounter.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from behaviours.decisions import Decision
from behaviours.settings import BehaviourSettings
from garbi_map.errors import GarbiError
from garbi_map.plain_yaml import parse_yaml, read_text
from garbi_map.settings import Settings

Verdict = tuple[str, str, str]  # name, "held" | "failed" | "no encounter", in words
Moment = tuple[float, float, bool]  # s after the first decision, from and to; whether it went as expected
Marks = NDArray[np.int8]  # for each decision 1: as expected, -1: not, 0: not spoken of
Span = Annotated[tuple[float, float] | None, Field(description="s after the begin of the log; none: all of it")]
STOPPED = 0.02  # m/s
CLEAR = 1.0  # s without an obstacle in the way after which the way is clear


class Expectation(Settings):
    """One line of the list."""

    between: Span = None

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        """(state, in words) of the decisions within `between`."""
        raise NotImplementedError

    def marks(self, decisions: list[Decision]) -> Marks:
        """Which of the decisions within `between` went as expected."""
        raise NotImplementedError

    def within(self, decisions: list[Decision]) -> list[Decision]:
        """Those of the span."""
        if self.between is None or not decisions:
            return decisions
        begin = decisions[0].now_ns
        low, high = (begin + round(1e9 * second) for second in self.between)
        return [one for one in decisions if low <= one.now_ns <= high]


class Stops(Expectation):
    """Surge is gone this soon after a profile shows something in the way nearer than `distance`."""

    kind: Literal["stops"]
    within_time: float = Field(0.6, gt=0, alias="within", description="s")
    distance: float = Field(1.0, gt=0, description="from the bow, m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        stops = self._stops(decisions)
        if not stops:
            return "no encounter", f"nothing came nearer than {self.distance} m"
        worst = max(took for _, _, took in stops)
        words = f"{len(stops)} times something came nearer than {self.distance} m; the slowest stop took {worst:.2f} s"
        return ("held" if self._soon(worst) else "failed"), words

    def marks(self, decisions: list[Decision]) -> Marks:
        marks = np.zeros(len(decisions), np.int8)
        for first, stopped, took in self._stops(decisions):
            marks[first : stopped + 1] = _mark(self._soon(took))
        return marks

    def _soon(self, took: float) -> bool:
        return took <= self.within_time + 1e-9

    def _stops(self, decisions: list[Decision]) -> list[tuple[int, int, float]]:
        """First decision at which something is near, first at which the vehicle stands, and the s between them."""
        times, surges, near = _series(decisions, self.distance)
        found, last_near = [], -np.inf
        for i in np.flatnonzero(near):
            if times[i] - last_near > CLEAR:
                stopped = np.flatnonzero((np.arange(len(times)) >= i) & (surges <= STOPPED))
                end = (int(stopped[0]), float(times[stopped[0]] - times[i])) if len(stopped) else (len(times), np.inf)
                found.append((int(i), *end))
            last_near = times[i]
        return found


class Holds(Expectation):
    """While something is in the way nearer than `distance`, the vehicle stays stopped."""

    kind: Literal["holds"]
    share: float = Field(0.9, ge=0, le=1)
    after: float = Field(0.6, ge=0, description="s since it came near, from which on the vehicle has to stand")
    distance: float = Field(1.0, gt=0, description="m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        share = _share(self.marks(decisions))
        if share is None:
            return "no encounter", f"nothing stayed nearer than {self.distance} m"
        return ("held" if share >= self.share else "failed"), f"stopped {100 * share:.0f} % of the time it was near"

    def marks(self, decisions: list[Decision]) -> Marks:
        times, surges, near = _series(decisions, self.distance)
        marks = np.zeros(len(decisions), np.int8)
        began, last = -np.inf, -np.inf
        for k in np.flatnonzero(near):
            if times[k] - last > CLEAR:
                began = times[k]
            last = times[k]
            if times[k] - began >= self.after:
                marks[k] = _mark(surges[k] <= STOPPED)
        return marks


class Resumes(Expectation):
    """After a stop the vehicle goes on, this soon after the way is clear."""

    kind: Literal["resumes"]
    within_time: float = Field(5.0, gt=0, alias="within", description="s")
    distance: float = Field(1.0, gt=0, description="m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        times, surges, near = _series(decisions, self.distance)
        if not near.any():
            return "no encounter", "nothing was in the way"
        last = float(times[near][-1])
        after = np.flatnonzero((times > last) & (surges > STOPPED))
        if times[-1] - last < self.within_time:
            return "no encounter", "the way did not clear before the log ended"
        took = times[after[0]] - last if len(after) else np.inf
        return ("held" if took <= self.within_time else "failed"), f"went on {took:.2f} s after it was last seen"

    def marks(self, decisions: list[Decision]) -> Marks:
        times, surges, near = _series(decisions, self.distance)
        marks = np.zeros(len(decisions), np.int8)
        state, _ = self.judge(decisions)
        if state != "no encounter":
            last = int(np.flatnonzero(near)[-1])
            after = np.flatnonzero((times > times[last]) & (surges > STOPPED))
            marks[last : (after[0] if len(after) else len(times)) + 1] = _mark(state == "held")
        return marks


class FalseStops(Expectation):
    """Share of the time without anything in the way in which safety or avoidance stops the vehicle all the same."""

    kind: Literal["false_stops"]
    most: float = Field(0.05, ge=0, le=1)
    distance: float = Field(2.0, gt=0, description="m: farther things are not in the way")
    settle: float = Field(6.0, ge=0, description="s after the begin, and after something was near, that do not count")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        free = _share(self.marks(decisions))
        if free is None:
            return "no encounter", "there was no time without something in the way"
        share = 1.0 - free
        return ("held" if share <= self.most else "failed"), f"stopped {100 * share:.1f} % of the free time"

    def marks(self, decisions: list[Decision]) -> Marks:
        times, surges, near = _series(decisions, self.distance)
        wanted = np.array([_wants_ahead(one) for one in decisions], bool)
        lately = np.array([(near & (times <= t) & (times > t - self.settle)).any() for t in times], bool)
        counted = wanted & ~lately & (times > times[0] + self.settle) if len(times) else wanted
        return np.where(counted, np.where(surges > STOPPED, 1, -1), 0).astype(np.int8)


class Away(Expectation):
    """While something is nearer than `distance`, avoidance proposes to back off from it."""

    kind: Literal["away"]
    share: float = Field(0.9, ge=0, le=1)
    distance: float = Field(0.8, gt=0, description="m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        share = _share(self.marks(decisions))
        if share is None:
            return "no encounter", f"nothing came nearer than {self.distance} m"
        return ("held" if share >= self.share else "failed"), f"away from it {100 * share:.0f} % of the time"

    def marks(self, decisions: list[Decision]) -> Marks:
        proposals = [one.proposal("avoidance") if one.obstacle < self.distance else None for one in decisions]
        return np.array([0 if one is None else _mark(one.command.surge < 0.0) for one in proposals], np.int8)


class Target(Expectation):
    """The holding behaviour recognises its target."""

    kind: Literal["target"]
    share: float = Field(0.9, ge=0, le=1)

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        share = _share(self.marks(decisions))
        if share is None:
            return "no encounter", "the holding behaviour did not run"
        return ("held" if share >= self.share else "failed"), f"recognised {100 * share:.0f} % of the time"

    def marks(self, decisions: list[Decision]) -> Marks:
        proposals = [one.proposal("hold") for one in decisions]
        found = [0 if one is None else _mark(one.facts.get("target", 0.0) > 0.5) for one in proposals]
        return np.array(found, np.int8)


class Says(Expectation):
    """Some decision says this."""

    kind: Literal["says"]
    text: str

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        count = int(self.marks(decisions).sum())
        return ("held" if count else "failed"), f"{self.text!r} is said in {count} of {len(decisions)} decisions"

    def marks(self, decisions: list[Decision]) -> Marks:
        return np.array([self.text in one.text() for one in decisions], np.int8)


AnyExpectation = Annotated[Stops | Holds | Resumes | FalseStops | Away | Target | Says, Field(discriminator="kind")]


class Plan(Settings):
    """What `--behaviours` names and the log's record `garbi.expectations` holds: behaviours and what is expected."""

    behaviours: BehaviourSettings = BehaviourSettings()
    expectations: tuple[AnyExpectation, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _named(cls, value: object) -> object:
        """`- stops: {within: 0.6}` is the way to write it."""
        if not isinstance(value, dict) or not isinstance(value.get("expectations"), list):
            return value
        listed = []
        for item in value["expectations"]:
            if isinstance(item, str):
                item = {item: {}}
            if isinstance(item, dict) and len(item) == 1 and "kind" not in item:
                ((kind, fields),) = item.items()
                fields = {} if fields is None else fields
                item = {"kind": kind, **fields} if isinstance(fields, dict) else {"kind": kind, "": fields}
            listed.append(item)
        return {**value, "expectations": listed}

    def judge(self, decisions: list[Decision]) -> list[Verdict]:
        """What became of each expectation."""
        return [(one.kind, *one.judge(one.within(decisions))) for one in self.expectations]

    def moments(self, decisions: list[Decision]) -> list[list[Moment]]:
        """When each expectation was met, and when not."""
        return [_moments(decisions, one.within(decisions), one.marks) for one in self.expectations]


def exit_status(verdicts: list[Verdict]) -> int:
    """0 all held, 4 one failed, 5 none failed but one met nothing."""
    states = {state for _, state, _ in verdicts}
    return 4 if "failed" in states else 5 if "no encounter" in states else 0


def parse_plan(text: str, where: str) -> Plan:
    """Raises GarbiError that names the place, the key and what is wrong with it."""
    try:
        return Plan.model_validate(parse_yaml(text, where) or {})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise GarbiError(f"{where}: {key or 'top level'}: {first['msg']}") from error


def load_plan(path: Path) -> Plan:
    """The plan of a YAML file. Raises GarbiError."""
    return parse_plan(read_text(path), str(path))


def _moments(
    decisions: list[Decision], spoken_of: list[Decision], marks_of: Callable[[list[Decision]], Marks]
) -> list[Moment]:
    """Runs of equal marks, each from its first decision to the one after its last."""
    marks = marks_of(spoken_of)
    if not len(marks):
        return []
    seconds = np.array([one.now_ns - decisions[0].now_ns for one in spoken_of]) * 1e-9
    edges = np.flatnonzero(np.diff(marks)) + 1
    firsts, ends = np.r_[0, edges], np.r_[edges, len(marks) - 1]
    runs = zip(seconds[firsts].tolist(), seconds[ends].tolist(), marks[firsts].tolist(), strict=True)
    return [(begin, end, mark > 0) for begin, end, mark in runs if mark]


def _mark(good: bool | np.bool_) -> int:
    return 1 if good else -1


def _share(marks: Marks) -> float | None:
    """Of the decisions that are spoken of, the share that went as expected; None where there are none."""
    spoken_of = marks[marks != 0]
    return float((spoken_of > 0).mean()) if len(spoken_of) else None


def _series(decisions: list[Decision], distance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,) s, surges (n,) m/s, and whether something shown is nearer than the distance (n,)."""
    times = np.array([one.now_ns for one in decisions], np.int64)
    seconds = (times - (times[0] if len(times) else 0)) * 1e-9
    return (
        seconds,
        np.array([one.command.surge for one in decisions]),
        np.array([one.obstacle < distance for one in decisions], bool),
    )


def _wants_ahead(decision: Decision) -> bool:
    return any(one.command.surge > STOPPED for one in decision.proposals if one.name != "avoidance")
