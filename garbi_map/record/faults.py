"""What goes wrong while recording: told at once in one line, counted, and not told again and again."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable

AGAIN = 10.0  # s before the same fault is told again
MOST = 200  # different faults that are told apart: some quote what came in


class Faults:
    """Takes faults from any thread; `say` is given a line for each that is new or comes again after a while."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._lock = say, threading.Lock()
        self._told: dict[tuple[str, str], float] = {}
        self._since: Counter[tuple[str, str]] = Counter()
        self._down: dict[str, str] = {}
        self.counts: Counter[tuple[str, str]] = Counter()

    def tell(self, who: str, what: str, detail: str = "") -> None:
        """who: the source; what: the fault, by which it is counted; detail: of this time."""
        key, now = (who, what), time.monotonic()
        with self._lock:
            if len(self.counts) >= MOST and key not in self.counts:
                key = (who, "something else")
            self.counts[key] += 1
            self._since[key] += 1
            if now - self._told.get(key, -AGAIN) < AGAIN:
                return
            times, self._since[key], self._told[key] = self._since[key], 0, now
        often = f" ({times} times)" if times > 1 else ""
        self._say(f"{who}: {what}{detail}{often}")

    def down(self, who: str, what: str, detail: str = "") -> None:
        """A fault that lasts until `up`."""
        self._down[who] = what
        self.tell(who, what, detail)

    def up(self, who: str, line: str) -> None:
        """What lasted is over."""
        if who not in self._down:
            return
        with self._lock:
            self._told.pop((who, self._down.pop(who, "")), None)
        self._say(f"{who}: {line}")

    def lasting(self, who: str) -> str | None:
        """What is wrong with a source now."""
        return self._down.get(who)

    def note(self, line: str) -> None:
        """Something to know, that is no loss."""
        self._say(line)

    def lines(self) -> list[str]:
        """One line for each fault, with how often it came."""
        with self._lock:
            return [f"{who}: {what}" + (f", {n} times" if n > 1 else "") for (who, what), n in self.counts.items()]
