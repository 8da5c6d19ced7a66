"""The state of a recording at one moment, for the screen and for the log."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from garbi_map.record.quality import Look

AVERAGED_NS = 2_000_000_000
OFTEN_NS = 100_000_000


@dataclass(frozen=True)
class SourceStatus:
    """rate: Hz over the last seconds; trouble: what is wrong now, None if nothing."""

    name: str
    rate: float
    count: int
    dropped: int
    trouble: str | None


@dataclass(frozen=True)
class Status:
    """stalled: s since the disk took anything while something waits; bytes_rate: written per second.

    look: at an image of late; others: what subscribers say of themselves
    """

    seconds: float
    file: str
    sources: list[SourceStatus]
    waiting_bytes: int
    most_waiting_bytes: int
    written_bytes: int
    bytes_rate: float
    free_bytes: int
    stalled: float
    look: Look | None
    others: list[str]

    @property
    def seconds_left(self) -> float:
        """Until the disk is full."""
        return self.free_bytes / self.bytes_rate if self.bytes_rate > 0 else float("inf")


class Meter:
    """Counts what one source gives. One thread counts, another looks."""

    def __init__(self, now_ns: int) -> None:
        self.count = self.bytes = 0
        self.first_ns: int | None = None
        self.last_ns = now_ns
        self._marks: deque[tuple[int, int, int]] = deque([(now_ns, 0, 0)])

    def add(self, arrival_ns: int, size: int) -> None:
        """One more."""
        self.count += 1
        self.bytes += size
        self.first_ns = arrival_ns if self.first_ns is None else self.first_ns
        self.last_ns = arrival_ns

    def rates(self, now_ns: int) -> tuple[float, float]:
        """Hz and bytes per second, over the last seconds."""
        marks = self._marks
        while len(marks) > 1 and now_ns - marks[0][0] > AVERAGED_NS:
            marks.popleft()
        then, count, size = marks[0]
        if now_ns - marks[-1][0] > OFTEN_NS:
            marks.append((now_ns, self.count, self.bytes))
        seconds = max(now_ns - then, 1) * 1e-9
        return (self.count - count) / seconds, (self.bytes - size) / seconds

    def usual_gap(self) -> float:
        """s between two of them, on average; 0 before there are two."""
        return 0.0 if self.first_ns is None or self.count < 2 else (self.last_ns - self.first_ns) * 1e-9 / self.count

    def silence(self, now_ns: int) -> float:
        """s since the last one, or since the begin."""
        return (now_ns - self.last_ns) * 1e-9
