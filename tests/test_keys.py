"""A recording is known by its content, and a long one without reading all of it."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from garbi_map import keys
from garbi_map.errors import GarbiError
from garbi_map.keys import recording_key


def test_names_and_order_do_not_matter_and_content_does(tmp_path: Path) -> None:
    """Two files under other names, given the other way round; a single other bit is another recording."""
    for name, content in {"a": b"one", "b": b"two", "c": b"two", "d": b"one", "e": b"onf"}.items():
        (tmp_path / name).write_bytes(content)
    made = recording_key([tmp_path / "a", tmp_path / "b"])
    assert made == recording_key([tmp_path / "c", tmp_path / "d"])
    assert made != recording_key([tmp_path / "e", tmp_path / "b"])
    assert made != recording_key([tmp_path / "a"])


class Endless(io.BufferedReader):
    """Zeros, of which it counts how many were read."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO())
        self.taken = 0

    def read(self, size: int | None = -1, /) -> bytes:
        assert size is not None and size >= 0
        self.taken += size
        return bytes(size)


def test_a_long_log_is_known_from_a_thousandth_of_it() -> None:
    """32 GB: less than 20 MB are read, and the length counts."""
    first, longer = Endless(), Endless()
    assert keys._content(first, 32 << 30) != keys._content(longer, (32 << 30) + 1)
    assert first.taken == longer.taken < 20_000_000


@pytest.mark.parametrize("place", [0, 1 << 25, (1 << 27) - 1])
def test_both_ends_and_what_is_between_tell_large_files_apart(tmp_path: Path, place: int) -> None:
    """Sparse files of 128 MB that differ in a block at the beginning, within, and in the last byte."""
    made = []
    for content in (b"", bytes([7]) * (1 << 20)):
        path = tmp_path / f"{len(content)}.mcap"
        with path.open("wb") as file:
            file.truncate(1 << 27)
            file.seek(place)
            file.write(content[: (1 << 27) - place])
        made.append(recording_key([path]))
    assert made[0] != made[1]


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    """It says which."""
    with pytest.raises(GarbiError, match=r"gone\.mcap: cannot be read"):
        recording_key([tmp_path / "gone.mcap"])
