"""Who else wants what is recorded, while it is recorded: behaviours, for instance.

A package offers one under the entry points `garbi.subscribers`: a function that takes an `Offer` and gives a `Subscriber`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter
from garbi_map.record.clock import SteadyClock
from garbi_map.record.faults import Faults
from garbi_map.record.lines import Kind
from garbi_map.rig import Rig


@dataclass(frozen=True)
class Recording:
    """What a subscriber may use of the recorder.

    write      write(source, bytes, what) has `what` called with the log's writer, soon, in the writer's thread
    """

    clock: SteadyClock
    faults: Faults
    write: Callable[[str, int, Callable[[LogWriter], None]], bool]


class Subscriber(Protocol):
    """Is told everything that is recorded, from the sources' threads, and returns at once."""

    metadata: dict[str, dict[str, str]]
    """Records for every file of the log."""

    def begin(self, recording: Recording) -> None:
        """Before the first image or reading."""

    def image(self, image: Image) -> None:
        """One image."""

    def reading(self, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...]) -> None:
        """One measurement; values: see `garbi_map.record.lines.Reading`."""

    def status(self) -> str:
        """How it is, in a few words, for the screen."""

    def end(self) -> None:
        """After the last image or reading; what it writes now is still recorded."""


@dataclass(frozen=True)
class Offer:
    """What a subscriber is made from: its own file, and where its results are to be sent, HOST:PORT."""

    file: Path
    send_to: str | None
    config: Config
    rig: Rig | None


def subscriber(name: str, offer: Offer) -> Subscriber:
    """The subscriber that is installed under a name. Raises GarbiError."""
    for found in entry_points(group="garbi.subscribers", name=name):
        made: Subscriber = found.load()(offer)
        return made
    raise GarbiError(f"--{name}: the package of that name is not installed; reinstall garbi")
