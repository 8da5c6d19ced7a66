"""What is expected of the decisions on a log: stated in YAML, judged on the decisions alone.

A replay is open loop: the motion is somebody else's. Reaction times count from the first profile that shows the obstacle.
An expectation holds, fails, or met nothing that it speaks of: no encounter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from behaviours.decisions import Decision
from behaviours.settings import BehaviourSettings
from garbi_map.errors import GarbiError
from garbi_map.plain_yaml import parse_yaml, read_text
from garbi_map.settings import Settings

Verdict = tuple[str, str, str]  # name, "held" | "failed" | "no encounter", in words
Span = Annotated[tuple[float, float] | None, Field(description="s after the begin of the log; none: all of it")]
STOPPED = 0.02  # m/s
CLEAR = 1.0  # s without an obstacle in the way after which the way is clear


class Expectation(Settings):
    """One line of the list."""

    between: Span = None

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        """(state, in words) of the decisions within `between`."""
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
        worst, count = 0.0, 0
        times, surges, near = _series(decisions, self.distance)
        last_near = -np.inf
        for i in np.flatnonzero(near):
            if times[i] - last_near > CLEAR:
                count += 1
                stopped = np.flatnonzero((np.arange(len(times)) >= i) & (surges <= STOPPED))
                worst = max(worst, times[stopped[0]] - times[i] if len(stopped) else np.inf)
            last_near = times[i]
        if not count:
            return "no encounter", f"nothing came nearer than {self.distance} m"
        words = f"{count} times something came nearer than {self.distance} m; the slowest stop took {worst:.2f} s"
        return ("held" if worst <= self.within_time + 1e-9 else "failed"), words


class Holds(Expectation):
    """While something is in the way nearer than `distance`, the vehicle stays stopped."""

    kind: Literal["holds"]
    share: float = Field(0.9, ge=0, le=1)
    after: float = Field(0.6, ge=0, description="s since it came near, from which on the vehicle has to stand")
    distance: float = Field(1.0, gt=0, description="m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        times, surges, near = _series(decisions, self.distance)
        held, began, last = [], -np.inf, -np.inf
        for k in np.flatnonzero(near):
            if times[k] - last > CLEAR:
                began = times[k]
            last = times[k]
            if times[k] - began >= self.after:
                held.append(surges[k] <= STOPPED)
        if not held:
            return "no encounter", f"nothing stayed nearer than {self.distance} m"
        share = float(np.mean(held))
        return ("held" if share >= self.share else "failed"), f"stopped {100 * share:.0f} % of the time it was near"


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


class FalseStops(Expectation):
    """Share of the time without anything in the way in which safety or avoidance stops the vehicle all the same."""

    kind: Literal["false_stops"]
    most: float = Field(0.05, ge=0, le=1)
    distance: float = Field(2.0, gt=0, description="m: farther things are not in the way")
    settle: float = Field(6.0, ge=0, description="s after the begin, and after something was near, that do not count")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        times, surges, near = _series(decisions, self.distance)
        wanted = np.array([_wants_ahead(one) for one in decisions])
        lately = np.array([(near & (times <= t) & (times > t - self.settle)).any() for t in times])
        counted = wanted & ~lately & (times > times[0] + self.settle) if len(times) else wanted
        if not counted.any():
            return "no encounter", "there was no time without something in the way"
        share = float((surges[counted] <= STOPPED).mean())
        return ("held" if share <= self.most else "failed"), f"stopped {100 * share:.1f} % of the free time"


class Away(Expectation):
    """While something is nearer than `distance`, avoidance proposes to back off from it."""

    kind: Literal["away"]
    share: float = Field(0.9, ge=0, le=1)
    distance: float = Field(0.8, gt=0, description="m")

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        proposals = [one.proposal("avoidance") for one in decisions if one.obstacle < self.distance]
        found = [one.command.surge < 0.0 for one in proposals if one is not None]
        if not found:
            return "no encounter", f"nothing came nearer than {self.distance} m"
        share = float(np.mean(found))
        return ("held" if share >= self.share else "failed"), f"away from it {100 * share:.0f} % of the time"


class Target(Expectation):
    """The holding behaviour recognises its target."""

    kind: Literal["target"]
    share: float = Field(0.9, ge=0, le=1)

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        proposals = [one.proposal("hold") for one in decisions]
        found = [one.facts.get("target", 0.0) > 0.5 for one in proposals if one is not None]
        if not found:
            return "no encounter", "the holding behaviour did not run"
        share = float(np.mean(found))
        return ("held" if share >= self.share else "failed"), f"recognised {100 * share:.0f} % of the time"


class Says(Expectation):
    """Some decision says this."""

    kind: Literal["says"]
    text: str

    def judge(self, decisions: list[Decision]) -> tuple[str, str]:
        count = sum(self.text in one.text() for one in decisions)
        return ("held" if count else "failed"), f"{self.text!r} is said in {count} of {len(decisions)} decisions"


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
