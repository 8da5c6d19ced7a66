"""What a recovery gave and what was lost: the model first, then its words."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from garbi_map.words import many


@dataclass
class Stretch:
    """A part of a file that could not be read or is not proven.

    offset, length   bytes
    why              in a few words
    begin_s, end_s   s since the log's first message; None where nothing tells
    lost             topic -> messages that were there and are gone; None where nothing tells how many
    unproven         topic -> messages that were kept although no checksum proves them
    """

    offset: int
    length: int
    why: str
    begin_s: float | None = None
    end_s: float | None = None
    lost: dict[str, int] | None = None
    unproven: dict[str, int] = field(default_factory=dict)

    def line(self) -> str:
        """One line: when, where, why, what."""
        where = f"byte {self.offset:,}, {self.length:,} bytes"
        parts = [f"lost {_counted(self.lost)}"] if self.lost else []
        if self.lost is None:
            parts = ["lost an unknown number of messages"]
        if self.unproven:
            parts.append(f"kept unproven {_counted(self.unproven)}")
        return f"{_when(self.begin_s, self.end_s)} ({where}): {self.why}; {', '.join(parts) or 'no message lost'}"


@dataclass(frozen=True)
class TopicTally:
    """Messages of a topic: proven, kept unproven, lost (None: more than `lost_at_least`, nothing tells how many)."""

    type: str
    proven: int
    unproven: int
    lost: int | None
    lost_at_least: int


@dataclass(frozen=True)
class Recovery:
    """What became of a log.

    begin_ns, end_ns  log times of the first and last message written
    stretches         what was damaged, in the order of the file
    records_lost      attachments and metadata that are gone, one line each
    repaired          chunks in which one wrong bit was found and turned, one line each
    notes             what was odd and cost nothing, one line each
    """

    source: str
    output: str
    bytes: int
    begin_ns: int
    end_ns: int
    topics: dict[str, TopicTally]
    attachments: tuple[str, ...]
    metadata: tuple[str, ...]
    stretches: tuple[Stretch, ...]
    records_lost: tuple[str, ...]
    repaired: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def messages(self) -> int:
        """Messages written, those that are not proven among them."""
        return sum(tally.proven + tally.unproven for tally in self.topics.values())

    @property
    def lossless(self) -> bool:
        """Everything that was in the log is in the output."""
        counted = all(tally.lost == 0 and not tally.unproven for tally in self.topics.values())
        return counted and not self.stretches and not self.records_lost

    def as_dict(self) -> dict[str, Any]:
        """Everything, as JSON can hold it."""
        return {**asdict(self), "messages": self.messages, "lossless": self.lossless}


def _when(begin_s: float | None, end_s: float | None) -> str:
    if begin_s is None and end_s is None:
        return "at an unknown time"
    if end_s is None:
        return f"after {begin_s:.2f} s"
    return f"before {end_s:.2f} s" if begin_s is None else f"{begin_s:.2f} to {end_s:.2f} s"


def _counted(messages: dict[str, int]) -> str:
    total = many(sum(messages.values()), "message")
    return f"{total} ({', '.join(f'{topic} {count:,}' for topic, count in sorted(messages.items()))})"
