"""Work while it runs: shown by a thread of its own, which the work never waits for."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from garbi_map.errors import GarbiError
from garbi_map.view.viewer import Viewer, open_in, viewer

if TYPE_CHECKING:
    from pathlib import Path

    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

_WAITING = 4
"""Things that wait to be sent at most; what comes while so many wait is not shown."""
_REST = 25.0
"""Times as long as it has worked the thread rests: it shares the interpreter with the work."""


class Live:
    """Takes things to show and returns at once; a thread sends what it can, the rest is dropped and counted.

    send    called in the thread with the recording and each thing; dropped: things that were not shown
    """

    def __init__(self, recording: RecordingStream, send: Callable[[RecordingStream, Any], None]) -> None:
        self.dropped = 0
        self._recording, self._send = recording, send
        self._things: queue.Queue[Any] = queue.Queue(_WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)
        self._thread.start()

    def show(self, thing: Any) -> None:
        """Show something if there is time for it."""
        try:
            self._things.put_nowait(thing)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Send what waits, and end."""
        self._ended.set()
        self._thread.join(timeout=10.0)

    def _run(self) -> None:
        while not (self._ended.is_set() and self._things.empty()):
            try:
                thing = self._things.get(timeout=0.1)
            except queue.Empty:
                continue
            begin = time.thread_time()
            try:
                self._send(self._recording, thing)
            except Exception:  # whatever a view does wrong, the work goes on
                self.dropped += 1
            self._ended.wait(_REST * (time.thread_time() - begin))


@contextmanager
def live(
    name: str,
    layout: Callable[[], Blueprint],
    sender: Callable[[], Callable[[RecordingStream, Any], None]],
    finished: Path | None = None,
) -> Iterator[Live]:
    """A viewer that shows work as it goes: what `sender` makes sends each thing. When the block has ended well, it opens
    `finished` where there is such a file, and this returns when the user closes it. A viewer that ends early is told of when
    the work is done.

    Raises GarbiError where there is no display."""
    done = False
    try:
        with viewer(None, web=False) as opened:
            from garbi_map.view.stream import recording_for, spare_pandas

            spare_pandas()
            with recording_for(opened, "work", name, layout()) as recording:
                shown = Live(recording, sender())
                try:
                    yield shown
                finally:
                    shown.close()
                done = True
            _stay(opened, finished)
    except GarbiError as error:
        if not done:
            raise
        print(f"garbi: {error}", file=sys.stderr)  # the work is done, whatever became of its viewer


@contextmanager
def watched(name: str, folder: Path) -> Iterator[Callable[[object], None]]:
    """What takes the parts of a map as they come, and shows them; the finished map at the end."""

    def layout() -> Blueprint:
        from garbi_map.view.blueprint import work_blueprint

        return work_blueprint()

    def sender() -> Callable[[RecordingStream, object], None]:
        from garbi_map.view.live_map import WorkSender

        return WorkSender()

    with live(name, layout, sender, folder / "map.rrd") as shown:
        yield shown.show


def _stay(opened: Viewer, finished: Path | None) -> None:
    if finished is not None and finished.exists() and opened.open:
        open_in(opened, finished)
    with suppress(KeyboardInterrupt):
        opened.process.wait()
