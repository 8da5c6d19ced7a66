"""A file is complete or absent, and a folder is written by one process at a time."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from garbi_map.errors import GarbiError


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """A name beside `path` to write to: synced and renamed to `path` when the block ends well, else removed.

    Raises GarbiError where the file system refuses.
    """
    aside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield aside
        with aside.open("rb+") as file:
            os.fsync(file.fileno())
        aside.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise GarbiError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        aside.unlink(missing_ok=True)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are not there. Raises GarbiError where the file system refuses."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GarbiError(f"{folder}: cannot be made a folder: {error.strerror}") from error


def _sync_folder(folder: Path) -> None:
    """So that a name outlives a power cut, too; some file systems cannot."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Holds a lock on a folder, which ends with the process however that ends, and leaves no file.

    Raises GarbiError where another process holds it. File systems without locks on folders lock nothing.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise GarbiError(f"{folder}: another garbi is writing there; wait for it or choose another folder") from error
    except OSError:
        pass
    try:
        yield
    finally:
        os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove what `written_aside` was writing in a folder when its process was killed."""
    for left in folder.glob(".*.part*"):
        named = re.search(r"\.(\d+)\.part", left.name)
        if named and not _is_alive(int(named[1])):
            left.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 file, complete or not at all. Raises GarbiError where the file system refuses."""
    with written_aside(path) as aside:
        aside.write_text(text, encoding="utf-8")
