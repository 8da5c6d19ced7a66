"""The disk stalls, fills up or ends in the middle: what could be kept is kept, and the rest is counted and told."""

from __future__ import annotations

import errno
import io
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_parts import Said, Sending, Serial, encoder_line, recorder, sample_images, wait_for
from test_record_sources import running

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import open_log
from garbi_map.record.backlog import FOR_IMAGES, Backlog
from garbi_map.record.disk import Disk, Target
from garbi_map.record.settings import RecordSettings


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the sample log's images."""
    return sample_images(tmp_path_factory.mktemp("images") / "images")


class Stalling(io.FileIO):
    """A file on a disk that takes nothing while `gate` is closed."""

    def __init__(self, path: Path, gate: threading.Event) -> None:
        super().__init__(path, "wb")
        self._gate = gate

    def write(self, data: object, /) -> int:  # type: ignore[override]
        self._gate.wait()
        return super().write(data)  # type: ignore[arg-type]


@contextmanager
def closed(gate: threading.Event) -> Iterator[None]:
    """The disk stalls for the length of a block."""
    gate.clear()
    try:
        yield
    finally:
        gate.set()


class Small(io.FileIO):
    """A file on a disk with room for so many bytes."""

    def __init__(self, path: Path, room: int) -> None:
        super().__init__(path, "wb")
        self._room = room

    def write(self, data: object, /) -> int:  # type: ignore[override]
        if self.tell() + len(memoryview(data)) > self._room:  # type: ignore[arg-type]
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)  # type: ignore[arg-type]


def test_a_disk_that_stalls_for_two_seconds_loses_nothing(images: Path, tmp_path: Path) -> None:
    """It is told meanwhile; every reading and every image is there afterwards."""
    gate, serial, said = threading.Event(), Serial(), Said()
    gate.set()

    def opened(path: Path) -> BinaryIO:
        return io.BufferedWriter(Stalling(path, gate))

    made = recorder(Target(tmp_path / "a.mcap", open_file=opened), said, images, 50.0, {serial.path: ("encoder",)})
    with running(made) as done, Sending(serial.send, encoder_line) as encoder:
        wait_for(lambda: made.counts["encoder"] > 30)
        with closed(gate):
            said.wait_for("disk: it takes nothing")
            time.sleep(1.0)
        time.sleep(0.3)
    log = open_log(done[0].files)
    angles = np.round(log.navigation().encoder.angle * 1e4)  # type: ignore[union-attr]
    assert np.all(np.diff(angles) == 1) and angles[-1] >= encoder.sent - 2
    assert log.image_count == done[0].counts["camera"]
    assert not any("dropped" in line for line in done[0].losses)


def test_when_the_queue_is_full_images_go_first(images: Path, tmp_path: Path) -> None:
    """A disk that takes nothing and a queue of a megabyte: images are dropped, counted and told; no reading is."""
    gate, serial, said = threading.Event(), Serial(), Said()
    gate.set()

    def opened(path: Path) -> BinaryIO:
        return io.BufferedWriter(Stalling(path, gate))

    config = Config(record=RecordSettings(backlog=1))
    target = Target(tmp_path / "a.mcap", open_file=opened)
    made = recorder(target, said, images, 100.0, {serial.path: ("encoder",)}, config)
    with running(made) as done, Sending(serial.send, encoder_line):
        wait_for(lambda: made.counts["encoder"] > 30)
        with closed(gate):
            said.wait_for("disk: too slow: what camera gives is dropped")
        wait_for(lambda: made.counts["encoder"] > 100)
    log = open_log(done[0].files)
    angles = np.round(log.navigation().encoder.angle * 1e4)  # type: ignore[union-attr]
    assert len(angles) > 50 and np.all(np.diff(angles) == 1)
    lost = done[0].counts["camera"] - log.image_count
    assert lost > 0 and f"{lost} of camera dropped, the disk was too slow" in done[0].losses


@settings(max_examples=100, deadline=None)
@given(puts=st.lists(st.tuples(st.integers(1, 400), st.booleans(), st.booleans()), max_size=60))
def test_the_backlog_is_bounded_in_order_and_kind_to_navigation(puts: list[tuple[int, bool, bool]]) -> None:
    """Never more bytes than stated; out in the order of in; a reading is refused only when no image is left to drop."""
    backlog, kept, written = Backlog(1000), [], []
    for number, (size, image, take) in enumerate(puts):
        taken = backlog.put(str(number), size, lambda log: None, image)
        assert backlog.waiting_bytes <= (FOR_IMAGES * 1000 if image and taken else 1000)
        if not taken and not image:
            assert not backlog._images
        kept += [number] if taken else []
        if take and (entry := backlog.take(0)) is not None:
            written.append(int(entry.source))
            backlog.done(entry)
    backlog.close()
    while not backlog.over:
        entry = backlog.take(0)
        assert entry is not None
        backlog.done(entry)
        written.append(int(entry.source))
    assert written == sorted(written) and set(written) <= set(kept)
    assert backlog.waiting_bytes == 0
    assert len(written) + backlog.dropped.total() == len(puts)


def test_a_full_disk_keeps_what_there_is(images: Path, tmp_path: Path) -> None:
    """The system refuses in the middle of a chunk: the recording ends, says so, and the log is readable without index."""

    def opened(path: Path) -> BinaryIO:
        return io.BufferedWriter(Small(path, 400_000))

    said = Said()
    done = recorder(Target(tmp_path / "a.mcap", open_file=opened), said, images, 50.0).run()
    assert "No space left on device; the recording ends, what is written is kept" in said.text
    assert any("No space left" in line for line in done.losses)
    log = open_log(done.files)
    assert len(list(log.images())) > 5
    assert any("no index" in line for line in log.losses)


def test_with_the_reserve_a_full_disk_ends_in_a_complete_log(
    images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the last megabytes are gone the index is written."""
    begin = time.monotonic()
    monkeypatch.setattr(Disk, "free_bytes", lambda _: 10**9 if time.monotonic() - begin < 1.0 else 10**7)
    done = recorder(tmp_path / "a.mcap", Said(), images, 50.0).run()
    assert any("full but for the reserve of 64 MB" in line for line in done.losses)
    log = open_log(done.files)
    assert len(list(log.images())) > 5 and log.losses == []


@pytest.mark.parametrize("split", [{"split_seconds": 0.5}, {"split_bytes": 200_000}])
def test_the_files_of_a_split_recording_are_one_log(images: Path, tmp_path: Path, split: dict[str, float]) -> None:
    """Each is a log by itself; together they hold everything."""
    serial = Serial()
    made = recorder(Target(tmp_path / "a.mcap", **split), Said(), images, 50.0, {serial.path: ("encoder",)})  # type: ignore[arg-type]
    with running(made) as done, Sending(serial.send, encoder_line):
        wait_for((tmp_path / "a_002.mcap").exists)
        time.sleep(0.2)
    files = done[0].files
    assert len(files) >= 3 and files[1].name == "a_001.mcap"
    log = open_log(files)
    angles = np.round(log.navigation().encoder.angle * 1e4)  # type: ignore[union-attr]
    assert len(angles) > 50 and np.all(np.diff(angles) == 1)
    assert len(list(log.images())) == done[0].counts["camera"]
    for file in files[:-1]:
        assert "garbi.clocks" in open_log([file]).metadata


@pytest.mark.parametrize(
    ("name", "words"),
    [("there.mcap", "is there already"), ("no/a.mcap", "no such directory"), ("a.bag", "ends in .mcap")],
)
def test_a_log_that_cannot_be_begun_is_refused(images: Path, tmp_path: Path, name: str, words: str) -> None:
    """In one line, and what is there is left alone."""
    (tmp_path / "there.mcap").write_bytes(b"precious")
    with pytest.raises(GarbiError, match=words):
        recorder(tmp_path / name, Said(), images).run(1.0)
    assert (tmp_path / "there.mcap").read_bytes() == b"precious"


def test_a_split_row_is_not_overwritten_either(images: Path, tmp_path: Path) -> None:
    """Any file of it is in the way, and `force` removes all of them."""
    (tmp_path / "a_007.mcap").write_bytes(b"precious")
    with pytest.raises(GarbiError, match=r"a_007.mcap: is there already"):
        Target(tmp_path / "a.mcap", split_seconds=1.0).check()
    forced = Target(tmp_path / "a.mcap", split_seconds=1.0, force=True)
    forced.check()
    forced.clear()
    assert not (tmp_path / "a_007.mcap").exists()


def test_a_directory_that_cannot_be_written_to_is_told(
    images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a system says it that does not let root do everything."""
    monkeypatch.setattr("garbi_map.record.disk.os.access", lambda path, mode: False)
    with pytest.raises(GarbiError, match="cannot be written to; choose another directory"):
        recorder(tmp_path / "a.mcap", Said(), images).run(1.0)
