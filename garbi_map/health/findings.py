"""What is wrong with a log, or may be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """kind: a name that programs can look for; text: what it is and what to do, one line; begin, end: s since the log's
    begin, between the first and last sample that show it."""

    kind: str
    text: str
    begin: float
    end: float


def spans(times: Iterable[float], flags: Iterable[bool]) -> list[tuple[float, float]]:
    """Runs of flagged samples, (time of the first, of the last)."""
    found: list[tuple[float, float]] = []
    running = False
    for time, flag in zip(times, flags, strict=True):
        if flag:
            found[-1:] = [(found[-1][0], time)] if running else [*found[-1:], (time, time)]
        running = flag
    return found


def told(runs: list[tuple[float, float]], most: int = 3) -> str:
    """Runs in words: "at 3.0 s, 10.0 to 20.0 s and 4 more"."""
    words = [f"at {a:.1f} s" if a == b else f"{a:.1f} to {b:.1f} s" for a, b in runs[:most]]
    return ", ".join(words) + (f" and {len(runs) - most} more" if len(runs) > most else "")
