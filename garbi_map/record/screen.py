"""The recording on the terminal: a table that is drawn again and again; where there is no terminal, a line now and then."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from garbi_map.record.status import Status

DRAW, LINE = 0.5, 10.0  # s


class Screen:
    """A context manager; `say` prints a line that stays, `show` the state. On stderr."""

    def __init__(self, tty: bool | None = None) -> None:
        self._tty = sys.stderr.isatty() if tty is None else tty
        self._live: Any = None
        self._drawn = time.monotonic() - (DRAW if self._tty else 0.0)

    def __enter__(self) -> Self:
        if self._tty:
            from rich.console import Console
            from rich.live import Live

            self._live = Live(console=Console(stderr=True, force_terminal=True), auto_refresh=False, transient=True)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            with suppress(OSError):
                self._live.stop()

    def say(self, line: str) -> None:
        """A line that stays, from any thread."""
        stamped = f"{time.strftime('%H:%M:%S')} {line}"
        with suppress(OSError):  # the terminal may be gone; the recording goes on
            if self._live is not None:
                self._live.console.print(stamped, markup=False, highlight=False)
            else:
                print(stamped, file=sys.stderr, flush=True)

    def show(self, status: Status) -> None:
        """The state; drawn when it is time to."""
        now = time.monotonic()
        if now - self._drawn < (DRAW if self._tty else LINE):
            return
        self._drawn = now
        with suppress(OSError):
            if self._live is not None:
                self._live.update(drawn(status), refresh=True)
            else:
                print(line(status), file=sys.stderr, flush=True)


def line(status: Status) -> str:
    """All of it in one line."""
    parts = [f"{source.name} {source.trouble or f'{source.rate:.1f} Hz'}" for source in status.sources]
    parts.append(_dropped(status))
    parts.append(f"{status.written_bytes / 1e6:.0f} MB written, {_left(status)}")
    parts += [status.look.words()] if status.look else []
    return f"{_clock(status.seconds)} " + "; ".join([*parts, *status.others])


def drawn(status: Status) -> Any:
    """A rich renderable."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"recording {status.file} {_clock(status.seconds)}", title_justify="left", title_style="bold")
    for name in ("source", "Hz", "count", "dropped", "state"):
        table.add_column(name, justify="left" if name in ("source", "state") else "right")
    for source in status.sources:
        table.add_row(
            source.name,
            f"{source.rate:.1f}",
            f"{source.count}",
            Text(f"{source.dropped}", "bold red" if source.dropped else ""),
            Text(source.trouble, "bold red") if source.trouble else Text("well", "green"),
        )
    share = 100 * status.waiting_bytes / status.most_waiting_bytes
    queue = f"queue {status.waiting_bytes / 1e6:.1f} MB, {share:.0f} %"
    stalled = f"  the disk takes nothing since {status.stalled:.1f} s" if status.stalled > 1.0 else ""
    lines = [Text(queue + stalled, "bold red" if stalled or share > 50 else "")]
    lines.append(Text(f"disk  {status.written_bytes / 1e6:.0f} MB written, {_left(status)}"))
    if status.look is not None:
        lines.append(Text(f"image {status.look.words()}"))
    return Group(table, *lines, *(Text(one) for one in status.others))


def _dropped(status: Status) -> str:
    return f"{sum(source.dropped for source in status.sources)} dropped, {status.waiting_bytes / 1e6:.1f} MB wait"


def _left(status: Status) -> str:
    left = status.seconds_left
    more = f", {_clock(left)} left" if left < 1e7 else ""
    return f"{status.free_bytes / 1e9:.1f} GB free{more}"


def _clock(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
