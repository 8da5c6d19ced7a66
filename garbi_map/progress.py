"""How long work shows where it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """What the pipeline tells whoever watches it."""

    def stage(self, name: str, total: int | None = None) -> None:
        """A stage begins; total: how many steps it has, where that is known."""

    def advance(self, steps: int = 1) -> None:
        """The stage has come on."""

    def note(self, text: str) -> None:
        """What the stage is at, in a few words."""


Show = Callable[[object], None]
"""Takes a part of the result as it comes, to be looked at; returns at once."""


def unseen(_: object) -> None:
    """Nobody looks."""


class Silent:
    """Shows nothing."""

    def stage(self, name: str, total: int | None = None) -> None:
        """Nothing."""

    def advance(self, steps: int = 1) -> None:
        """Nothing."""

    def note(self, text: str) -> None:
        """Nothing."""


def counted(items: Iterable[T], progress: Progress) -> Iterator[T]:
    """The items, each of them a step."""
    for item in items:
        yield item
        progress.advance()
