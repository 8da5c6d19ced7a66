"""Names for results, which change with everything that a result depends on: input, rig, configuration and code."""

from __future__ import annotations

import hashlib
from functools import cache
from io import BufferedReader
from pathlib import Path

from garbi_map import __version__
from garbi_map.errors import GarbiError

_WHOLE = 1 << 26
"""Bytes up to which a file is read from end to end."""
_BLOCKS, _BLOCK = 256, 1 << 16
"""How many blocks of a larger one are, and their bytes: each holds stamps and checksums of that recording only."""


def digest_of(*parts: str | bytes) -> str:
    """A name for a content: 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "big"))
        digest.update(data)
    return digest.hexdigest()[:16]


def recording_key(paths: list[Path]) -> str:
    """A name for the content of a recording, whatever its files are called and in whatever order they are given.

    Of large files as much is looked at as tells two recordings apart, so that a stretch of a long log is mapped without
    reading all of it.
    Raises GarbiError where a file cannot be read.
    """
    contents = []
    for path in paths:
        for file in sorted(path.iterdir()) if path.is_dir() else [path]:
            try:
                with file.open("rb") as opened:
                    contents.append(_content(opened, file.stat().st_size))
            except OSError as error:
                raise GarbiError(f"{file}: cannot be read: {error.strerror}") from error
    return digest_of(*sorted(contents))


def _content(opened: BufferedReader, size: int) -> bytes:
    """A digest of a file of so many bytes: of all, or of its length and of blocks spread over it, the ends among them."""
    if size <= _WHOLE:
        return hashlib.file_digest(opened, "sha256").digest()
    digest = hashlib.sha256(size.to_bytes(8, "big"))
    for k in range(_BLOCKS):
        opened.seek(k * (size - _BLOCK) // (_BLOCKS - 1))
        digest.update(opened.read(_BLOCK))
    return digest.digest()


@cache
def code_key() -> str:
    """A name for this very code: a stage that was programmed otherwise is done again."""
    package = Path(__file__).parent
    return digest_of(__version__, *(file.read_bytes() for file in sorted(package.rglob("*.py"))))
