"""What waits to be written: bounded in bytes. When it is full images are dropped, never navigation for an image's sake."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

from garbi_map.log import LogWriter

FOR_IMAGES = 0.75  # of the bound; the rest is navigation's


@dataclass(frozen=True, slots=True)
class Entry:
    """Something to write: what writes it, its bytes (about), and whose it is."""

    source: str
    size: int
    write: Callable[[LogWriter], None]
    number: int = 0


class Backlog:
    """Entries in from any thread, out in the order in which they came, to one.

    A quarter of the bound is kept for navigation; when even that is full, waiting images make room, the newest first. Only
    when there are none left is navigation dropped, too: with the defaults, after the disk has taken nothing for an hour.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self._images: deque[Entry] = deque()
        self._others: deque[Entry] = deque()
        self._changed = threading.Condition()
        self._number = 0
        self._closed = False
        self.waiting_bytes = self.largest_bytes = 0
        self.dropped: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._images) + len(self._others)

    def put(self, source: str, size: int, write: Callable[[LogWriter], None], image: bool = False) -> bool:
        """Whether it was taken."""
        with self._changed:
            if not self._closed and not self._has_room(size, image):
                self.dropped[source] += 1
                return False
            if self._closed:
                return False
            self._number += 1
            (self._images if image else self._others).append(Entry(source, size, write, self._number))
            self.waiting_bytes += size
            self.largest_bytes = max(self.largest_bytes, self.waiting_bytes)
            self._changed.notify()
        return True

    def _has_room(self, size: int, image: bool) -> bool:
        if image:
            return self.waiting_bytes + size <= FOR_IMAGES * self.most_bytes
        while self._images and self.waiting_bytes + size > self.most_bytes:
            gone = self._images.pop()
            self.dropped[gone.source] += 1
            self.waiting_bytes -= gone.size
        return self.waiting_bytes + size <= self.most_bytes

    def take(self, seconds: float) -> Entry | None:
        """The oldest entry, None where nothing came within so many seconds. `done` says that it is written."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self) or self._closed, seconds) or not len(self):
                return None
            queues = [queue for queue in (self._images, self._others) if queue]
            return min(queues, key=lambda queue: queue[0].number).popleft()

    def done(self, entry: Entry) -> None:
        """What was taken no longer takes room."""
        with self._changed:
            self.waiting_bytes -= entry.size

    def close(self) -> None:
        """Nothing more is taken in; what is there can still be taken out."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def over(self) -> bool:
        """Closed and empty."""
        return self._closed and not len(self)
