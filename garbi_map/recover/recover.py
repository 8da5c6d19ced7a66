"""Everything that can be read of a damaged log into a new one, in one pass, with what was lost."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from garbi_map.aside import written_aside
from garbi_map.errors import GarbiError
from garbi_map.log.chunks import CHUNK_HEAD, DAMAGE, MAGIC, RECORD, read_at, reason
from garbi_map.log.index import Index
from garbi_map.log.summary import index_from_summary
from garbi_map.log.survey import Frame, survey
from garbi_map.progress import Progress, Silent
from garbi_map.recover.ledger import Ledger
from garbi_map.recover.output import verify
from garbi_map.recover.report import Recovery
from garbi_map.recover.source import UNPROVEN, Source

__all__ = ["UNPROVEN", "recover"]

MEGABYTE = 1 << 20


def recover(source: Path, target: Path, progress: Progress | None = None) -> Recovery:
    """Write everything that can be read of the MCAP file `source` to a new one, `target`.

    Proven messages (their chunk's checksum holds, or the recorder wrote none) keep their topic; those that are only
    plausible, from a chunk whose checksum fails, are written under /unproven, so that nothing takes them for sound.
    Memory does not grow with the log, but for its index.

    Raises GarbiError where nothing can be read, the target exists or cannot be written, or does not read back as written.
    """
    _refuse(source, target)
    watched = progress or Silent()
    with source.open("rb") as file:
        size = source.stat().st_size
        index, index_damage = _sound_index(source, file, size)
        with written_aside(target) as aside:
            with aside.open("wb") as out:
                watched.stage("Salvaging", max(size // MEGABYTE, 1))
                megabytes = _Megabytes(watched)
                read = Source(file, size, index, out)
                for frame in _in_order(file, size, read.ledger):
                    read.take(frame)
                    megabytes.add(frame.length)
                read.finish()
            content = read.output.content
            if not any(content.counts.values()):
                raise GarbiError(f"{source}: no message in it can be read; nothing was written")
            watched.stage("Verifying", max(size // MEGABYTE, 1))
            verify(aside, content, _Megabytes(watched).add)
    return read.ledger.report(source, target, size, index_damage)


class _Megabytes:
    """Bytes to steps of a progress bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._bytes = progress, 0

    def add(self, count: int) -> None:
        steps = (self._bytes + count) // MEGABYTE - self._bytes // MEGABYTE
        self._bytes += count
        if steps:
            self._progress.advance(steps)


def _sound_index(path: Path, file: BinaryIO, size: int) -> tuple[Index | None, str]:
    """The log's own index where it can be trusted, else why not."""
    try:
        return index_from_summary(path, file, size), ""
    except DAMAGE as error:
        return None, reason(error)


def _in_order(file: BinaryIO, size: int, ledger: Ledger) -> Iterable[Frame]:
    """The records of a file; where chunks changed places, as its own index tells, in the order in which they were."""
    index = ledger.index
    if index is None:
        return survey(file, size)
    announced = {piece.offset: (piece.begin, piece.end) for piece in index.pieces}
    places = {times: offset for offset, times in announced.items()}

    def place(frame: Frame) -> int:
        if frame.opcode != Opcode.CHUNK:
            return frame.offset
        times = _times(file, frame)
        return frame.offset if announced.get(frame.offset) == times else places.get(times, frame.offset)

    if all(place(frame) == frame.offset for frame in survey(file, size)):
        return survey(file, size)
    ledger.moved = True
    return sorted(survey(file, size), key=place)


def _times(file: BinaryIO, frame: Frame) -> tuple[int, int]:
    """First and last log time that a chunk's head states."""
    return CHUNK_HEAD.unpack(read_at(file, frame.offset + RECORD.size, CHUNK_HEAD.size))[:2]


def _refuse(source: Path, target: Path) -> None:
    """Raises GarbiError for what is no log to recover, and rather than write over anything."""
    if source.is_dir():
        files = sorted(path.name for path in source.glob("*.mcap"))
        hint = f"give its files one by one: {', '.join(files[:4])}" if files else "there is no .mcap file in it"
        raise GarbiError(f"{source}: a directory; recover reads one MCAP file at a time, {hint}")
    if not source.exists():
        raise GarbiError(f"{source}: no such file")
    if target.exists():
        raise GarbiError(f"{target}: exists already; choose another name, recover writes over nothing")
    if not target.parent.is_dir():
        raise GarbiError(f"{target.parent}: no such folder")
    try:
        with source.open("rb") as file:
            if not file.read(len(MAGIC)):
                raise GarbiError(f"{source}: the file is empty")
    except OSError as error:
        raise GarbiError(f"{source}: cannot be read: {error.strerror}") from error
