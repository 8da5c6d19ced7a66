"""The thread that brings everything to the disk: one file, or a row of them."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from garbi_map.errors import GarbiError
from garbi_map.log import LogWriter, Topics
from garbi_map.record.backlog import Backlog, Entry
from garbi_map.record.clock import SteadyClock
from garbi_map.record.faults import Faults
from garbi_map.record.settings import RecordSettings

MB = 1_000_000
STALLED = 1.0  # s


@dataclass(frozen=True)
class Target:
    """Where to: a file, or with a bound on size (bytes) or length (s), the row of files name_000, name_001, ...

    open_file: see LogWriter.
    """

    path: Path
    split_bytes: int | None = None
    split_seconds: float | None = None
    force: bool = False
    open_file: Callable[[Path], BinaryIO] = lambda path: path.open("wb")

    @property
    def splits(self) -> bool:
        """Whether there may be more files than one."""
        return self.split_bytes is not None or self.split_seconds is not None

    def file(self, number: int) -> Path:
        """The name of a file of the row."""
        return self.path.with_name(f"{self.path.stem}_{number:03d}{self.path.suffix}") if self.splits else self.path

    def check(self) -> None:
        """Raises GarbiError where a file is in the way, or where nothing can be written."""
        if self.path.suffix != ".mcap":
            raise GarbiError(f"{self.path}: a log's name ends in .mcap")
        for path in self._there():
            if not self.force:
                raise GarbiError(f"{path}: is there already; choose another name, or --force to overwrite it")
        if not self.path.parent.is_dir():
            raise GarbiError(f"{self.path.parent}: no such directory")
        if not os.access(self.path.parent, os.W_OK):
            raise GarbiError(f"{self.path.parent}: cannot be written to; choose another directory")

    def clear(self) -> None:
        """Remove what `force` allows to be overwritten."""
        for path in self._there():
            path.unlink()

    def _there(self) -> list[Path]:
        if self.splits:
            return sorted(self.path.parent.glob(f"{self.path.stem}_[0-9][0-9][0-9]*.mcap"))
        return [self.path] if self.path.exists() else []


class Disk(threading.Thread):
    """Takes from the backlog and writes. Each file is a log by itself: `begin` writes what comes first, `end` what comes
    last.

    files  those that hold something, complete but the last
    full   in words, why nothing more is written; None as long as it is
    bytes  of all files, flushed;  free: bytes left on that disk then
    """

    def __init__(
        self,
        target: Target,
        topics: Topics,
        settings: RecordSettings,
        backlog: Backlog,
        clock: SteadyClock,
        faults: Faults,
        begin: Callable[[LogWriter], None],
        end: Callable[[LogWriter], None],
    ) -> None:
        super().__init__(name="garbi disk", daemon=True)
        self.target, self.topics, self.settings = target, topics, settings
        self.backlog, self.clock, self.faults = backlog, clock, faults
        self._begin, self._end = begin, end
        self.files: list[Path] = []
        self.full: str | None = None
        self._before = self.bytes = self.free = 0
        self.alive_ns = self._flushed_ns = self._opened_ns = clock.now()
        self._log: LogWriter | None = None
        self._finished = threading.Event()
        self._syncer = threading.Thread(target=self._keep_syncing, name="garbi sync", daemon=True)

    def open(self) -> None:
        """Open the first file. Raises GarbiError."""
        self.target.check()
        self.target.clear()
        self._next()
        self._syncer.start()

    def run(self) -> None:
        """Until the backlog is closed and empty, or the disk is full."""
        reserve = self.settings.disk_reserve * MB
        try:
            while not self.backlog.over:
                entry = self.backlog.take(self.settings.flush / 2)
                if entry is not None:
                    self._write(entry)
                self.alive_ns = self.clock.now()
                if self.alive_ns - self._flushed_ns > self.settings.flush * 1e9:
                    self._flush()
                    if self.full is None and self.free < reserve:
                        left = f"{self.settings.disk_reserve} MB"
                        self._end_early(f"{self.target.path}: the disk is full but for the reserve of {left}")
                    if self.full is not None and self.backlog.waiting_bytes > reserve / 2:
                        break
            self._close()
        except GarbiError as error:
            self._end_early(str(error))
            if self._log is not None:
                self._log.abandon()
        finally:
            self._finished.set()

    def _write(self, entry: Entry) -> None:
        assert self._log is not None
        try:
            entry.write(self._log)
        except GarbiError:
            raise
        except Exception as error:  # one message that cannot be serialised must not end the recording
            self.faults.tell(entry.source, f"a message could not be written ({type(error).__name__}: {error})")
        self.backlog.done(entry)

    def _flush(self) -> None:
        assert self._log is not None
        self._log.flush()
        self._flushed_ns, self.bytes = self.clock.now(), self._before + self._log.size
        self.free = self.free_bytes()
        split = self.target
        if (split.split_bytes is not None and self._log.size >= split.split_bytes) or (
            split.split_seconds is not None and self._flushed_ns - self._opened_ns >= split.split_seconds * 1e9
        ):
            self._close()
            self._next()

    def _end_early(self, why: str) -> None:
        """Nothing more is taken in. With the reserve there is room for the index; a log without one is readable, too."""
        self.backlog.close()
        self.full = why
        self.faults.tell("disk", f"{why}; the recording ends, what is written is kept")

    def _next(self) -> None:
        path = self.target.file(len(self.files))
        self._log = LogWriter(
            path,
            self.topics,
            compression=self.settings.compression,
            in_place=True,
            open_file=self.target.open_file,
        )
        self._begin(self._log)
        self._log.flush()
        self.files.append(path)
        self._opened_ns = self._flushed_ns = self.clock.now()
        self.free = self.free_bytes()

    def _close(self) -> None:
        if self._log is not None:
            self._end(self._log)
            self._log.close()
            self._log = None
            self._before += self.files[-1].stat().st_size
            self.bytes = self._before

    def _keep_syncing(self) -> None:
        """fsync, apart from the writing, which goes on meanwhile."""
        while not self._finished.wait(self.settings.sync):
            log = self._log
            try:
                if log is not None:
                    log.sync()
            except GarbiError as error:
                self.faults.tell("disk", str(error))
            except ValueError:
                pass  # closed meanwhile, which syncs

    def stalled(self, now_ns: int) -> float:
        """s for which the disk has not taken anything, if things wait; else 0."""
        return max((now_ns - self.alive_ns) * 1e-9, 0.0) if len(self.backlog) else 0.0

    def free_bytes(self) -> int:
        """On the target's disk."""
        try:
            return shutil.disk_usage(self.target.path.parent).free
        except OSError:
            return 0
