"""Run the behaviours on a recorded log: the same log makes the same decisions, to the byte."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from behaviours.decisions import Decision, DecisionWriter
from behaviours.expectations import Plan, Verdict, exit_status, parse_plan
from behaviours.feed import Feed
from behaviours.log_feed import LogFeed
from behaviours.pilot import Pilot
from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Log
from garbi_map.rig import Rig

RECORD = "garbi.expectations"


@dataclass(frozen=True)
class Replayed:
    """What a replay came to: decisions made, verdicts, what was left out of the log."""

    decisions: int
    seconds: float
    verdicts: list[Verdict]
    losses: list[str]

    @property
    def status(self) -> int:
        """Exit status: 0 held, 4 failed, 5 no encounter."""
        return exit_status(self.verdicts)


def plan_of(log: Log, given: Plan | None) -> Plan:
    """The plan that was given, else the one that the log carries, else avoidance alone."""
    if given is not None:
        return given
    record = log.metadata.get(RECORD)
    if record is None:
        return Plan()
    text = record.get("yaml")
    if text is None:
        raise GarbiError(f"the log's record {RECORD} has no entry 'yaml'")
    return parse_plan(text, f"the log's record {RECORD}")


def decide_all(feed: LogFeed, plan: Plan) -> Iterator[Decision]:
    """A decision per period, from the first to the last thing in the log."""
    pilot = Pilot(plan.behaviours, feed.rig, feed.mount)
    period = round(plan.behaviours.feed.period * 1e9)
    now = feed.begin_ns + period
    while True:
        yield pilot.decide(feed.until(now))
        if feed.over(now):
            return
        now += period


def replay(
    log: Log,
    plan: Plan,
    config: Config,
    output: Path | None,
    rig: Rig | None = None,
    workers: int = 2,
    show: Callable[[Decision], None] = lambda _: None,
) -> Replayed:
    """Decide along the log; write the decisions to `output`, where one is given; `show` is given each as it is made."""
    feed = LogFeed(log, plan.behaviours.feed, config.stripe, rig, workers)
    decisions: list[Decision] = []

    def decided() -> Iterator[Decision]:
        for decision in decide_all(feed, plan):
            yield decision
            show(decision)
            decisions.append(replace(decision, movers=(), allowed=None, volume=None))  # hours of them are kept

    if output is None:
        for _ in decided():
            pass
        verdicts = plan.judge(decisions)
    else:
        with DecisionWriter(output) as writer:
            writer.write_metadata("garbi.behaviours", {"json": plan.model_dump_json()})
            for decision in decided():
                writer.write(decision)
            verdicts = plan.judge(decisions)
            writer.write_verdict(decisions[-1].now_ns, verdicts, plan.moments(decisions))
    seconds = (decisions[-1].now_ns - decisions[0].now_ns) * 1e-9
    return Replayed(len(decisions), seconds, verdicts, [*log.losses, *feed.losses.lines()])


__all__ = ["Feed", "Replayed", "decide_all", "plan_of", "replay"]
