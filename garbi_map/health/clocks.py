"""Whether the clocks of a log can be believed: jitter, jumps, and topics that disagree about the time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.health.findings import Finding, spans, told
from garbi_map.health.sample import Stretch, of_role
from garbi_map.log.records import Floats, Stamps

LEAST = 3  # messages of a stretch that say something
JITTER = 0.5  # of the usual interval: more is told
JUMP = 0.1  # s
APART = 0.5  # s between the clocks of two topics


@dataclass(frozen=True)
class Clock:
    """A topic's stamps in the samples.

    rate     Hz, the inverse of the median interval between stamps
    jitter   95th percentile of how far intervals are from the median, as a share of it
    latency  s, median of arrival minus stamp; 0 where the log keeps one time only
    """

    role: str
    rate: float
    jitter: float
    latency: float


def check_clocks(found: list[Stretch], roles: list[str], reorder: float) -> tuple[list[Clock], list[Finding]]:
    """Each role's clock, and what is wrong with it; reorder: s by which messages may be late without harm."""
    clocks, findings = [], []
    for role in roles:
        places = list(of_role(found, role, LEAST))
        if not places:
            continue
        steps = np.concatenate([np.diff(np.unique(said.stamp_ns)) for _, said in places]) * 1e-9
        if not len(steps):
            continue
        usual = float(np.median(steps))
        jitter = float(np.percentile(np.abs(steps - usual), 95)) / usual
        offsets = np.array([np.median(said.arrival_ns - said.stamp_ns) for _, said in places]) * 1e-9
        times = [stretch.time for stretch, _ in places]
        clocks.append(Clock(role, 1 / usual, jitter, float(np.median(offsets))))
        findings += _jumps(role, times, offsets)
        findings += _backwards(role, times, [_is_backwards(said.stamp_ns, reorder) for _, said in places])
        if jitter > JITTER:
            text = f"{role}: intervals vary by {jitter:.0%} of the usual {usual * 1e3:.3g} ms; are stamps those of arrival?"
            findings.append(Finding("jitter", text, times[0], times[-1]))
    findings += _apart(clocks, found)
    return clocks, findings


def _jumps(role: str, times: list[float], offsets: Floats) -> list[Finding]:
    """The stamps against the recorder's clock: a step between two samples that stays is a clock that was set."""
    found = []
    usual = 1.4826 * float(np.median(np.abs(np.diff(offsets)))) if len(offsets) > 2 else 0.0
    for place in np.flatnonzero(np.abs(np.diff(offsets)) > max(JUMP, 8 * usual)):
        by = offsets[place] - offsets[place + 1]
        text = f"{role}: its clock jumps by {by:+.3g} s between {times[place]:.1f} and {times[place + 1]:.1f} s"
        found.append(Finding("clock_jump", text, times[place], times[place + 1]))
    return found


def _is_backwards(stamps: Stamps, reorder: float) -> bool:
    """Whether stamps repeat, or go back by more than what is sorted."""
    late = np.maximum.accumulate(stamps) - stamps
    return len(np.unique(stamps)) < len(stamps) or bool((late > reorder * 1e9).any())


def _backwards(role: str, times: list[float], flags: list[bool]) -> list[Finding]:
    runs = spans(times, flags)
    if not runs:
        return []
    text = f"{role}: stamps repeat or go back {told(runs)}; such messages are left out"
    return [Finding("stamps_go_back", text, runs[0][0], runs[-1][1])]


def _apart(clocks: list[Clock], found: list[Stretch]) -> list[Finding]:
    """A topic that runs on another clock than the images."""
    latency = {clock.role: clock.latency for clock in clocks}
    reference = latency.get("image")
    if reference is None:
        return []
    return [
        Finding(
            "clocks_apart",
            f"{role}: its stamps are {reference - by:+.3g} s from those of the images, as their arrivals tell; "
            f"synchronise the clocks",
            found[0].time,
            found[-1].time,
        )
        for role, by in latency.items()
        if role != "image" and abs(by - reference) > APART
    ]
