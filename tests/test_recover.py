"""`garbi recover`: everything readable comes back as it was, nothing else does, and what is missing is named."""

from __future__ import annotations

import io
import json
import tracemalloc
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from conftest import Garbi
from mcap.reader import make_reader
from mcap.writer import Writer
from sample_log import RIG, START, contents, jpeg_like, write_sample

from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter, open_log
from garbi_map.log.survey import survey
from garbi_map.recover import UNPROVEN, Recovery, recover
from tools.bench.recover import Row, damaged, judge, write_log
from tools.bench.recover import contents as messages_of

COMPRESSIONS = {"none": "", "lz4": "lz4", "zstd": "zstd"}


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    """A sound log of about twenty chunks, not compressed."""
    return write_sample(tmp_path / "sound.mcap", compression="", chunk_size=6_000)


def chunk_of(path: Path, number: int) -> tuple[int, int, int, int]:
    """Offset and length, first and last log time, of a chunk of a sound log."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    index = summary.chunk_indexes[number]
    return index.chunk_start_offset, index.chunk_length, index.message_start_time, index.message_end_time


def overwrite(path: Path, offset: int, data: bytes) -> None:
    """Other bytes at a place of a file."""
    with path.open("rb+") as file:
        file.seek(offset)
        file.write(data)


def topics_between(path: Path, begin: int, end: int) -> Counter[str]:
    """Messages by topic with log times from begin to end, both included, of a sound log."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(starting_at=begin, ending_before=end + 1)
        return Counter(channel.topic for _, channel, _ in found)


def test_a_sound_log_comes_back_identical(sound: Path, tmp_path: Path, garbi: Garbi) -> None:
    """Messages, order, attachment, metadata; exit status 0."""
    out = tmp_path / "out.mcap"
    ended = garbi("recover", sound, "-o", out)
    assert ended.status == 0 and "nothing was lost" in ended.out
    assert messages_of(out) == messages_of(sound)
    assert contents(open_log([out])) == contents(open_log([sound]))
    assert open_log([out]).rig_text == RIG and open_log([out]).metadata == {"dive": {"place": "tank"}}
    assert open_log([out]).losses == []


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_damage_of_every_kind(name: str, tmp_path: Path) -> None:
    """Cut short, bits turned, zeros, chunks swapped, blocks moved, no end: identical or reported, never silently wrong, and
    nearly everything comes back. `python -m tools.bench.recover` tries thousands."""
    log = write_log(tmp_path / "sound.mcap", COMPRESSIONS[name], size=600_000, chunk_size=1 << 14)
    truth, _, others = messages_of(log)
    rows: dict[str, Row] = {}
    for kind, data in damaged(log.read_bytes(), 0.02):
        (tmp_path / "damaged.mcap").write_bytes(data)
        judge(rows.setdefault(kind, Row()), tmp_path / "damaged.mcap", truth, others, other_program=False)
    assert sum(row.wrong_as_sound for row in rows.values()) == 0
    assert sum(row.silent for row in rows.values()) == 0
    shares = {kind: row.share_proven / row.cases for kind, row in rows.items()}
    assert shares["end missing"] == shares["chunks swapped"] == 1
    assert shares["bit turned"] > 0.97 and shares["cut short"] > 0.45 and shares["block of zeros"] > 0.8


def test_what_was_lost_is_told_by_topic_and_time(sound: Path, tmp_path: Path, garbi: Garbi) -> None:
    """A chunk that is gone: its messages are counted exactly, its time is that of the chunk."""
    offset, length, begin, end = chunk_of(sound, 8)
    gone = topics_between(sound, begin, end)
    lost = tmp_path / "lost.mcap"
    lost.write_bytes(sound.read_bytes())
    overwrite(lost, offset, bytes(length))
    ended = garbi("recover", lost, "-o", tmp_path / "out.mcap", "--json")
    told = json.loads(ended.out)
    assert ended.status == 3
    (stretch,) = told["stretches"]
    assert Counter(stretch["lost"]) <= gone
    assert {topic: tally["lost"] for topic, tally in told["topics"].items() if tally["lost"]} == stretch["lost"]
    assert stretch["begin_s"] == pytest.approx((begin - START) * 1e-9)
    assert stretch["end_s"] == pytest.approx((end - START) * 1e-9)
    kept = topics_between(tmp_path / "out.mcap", 0, 1 << 62)
    assert kept + Counter(stretch["lost"]) == topics_between(sound, 0, 1 << 62)


def test_a_chunk_without_its_head(sound: Path, tmp_path: Path) -> None:
    """Where data are not packed, the messages inside are found, and are not proven."""
    offset, _, _, _ = chunk_of(sound, 8)
    truth = messages_of(sound)[0]
    overwrite(sound, offset, bytes(40))
    recover(sound, tmp_path / "out.mcap")
    proven, unproven, _ = messages_of(tmp_path / "out.mcap")
    assert proven + unproven == truth and unproven.total() > 5


def test_one_wrong_bit_is_found_and_turned(sound: Path, tmp_path: Path) -> None:
    """The checksum of an uncompressed chunk says which bit it was."""
    offset, length, _, _ = chunk_of(sound, 5)
    data = bytearray(sound.read_bytes())
    data[offset + length // 2] ^= 16
    (tmp_path / "bit.mcap").write_bytes(data)
    found = recover(tmp_path / "bit.mcap", tmp_path / "out.mcap")
    assert found.lossless and len(found.repaired) == 1
    assert messages_of(tmp_path / "out.mcap") == messages_of(sound)


def test_what_no_checksum_proves_is_kept_apart(sound: Path, tmp_path: Path) -> None:
    """Of a chunk with a hole, the messages beside the hole are right but not proven: they are under /unproven."""
    offset, length, begin, end = chunk_of(sound, 5)
    overwrite(sound, offset + length // 2, bytes(64))
    before = messages_of(write_sample(tmp_path / "again.mcap", compression="", chunk_size=6_000))[0]
    found = recover(sound, tmp_path / "out.mcap")
    proven, unproven, _ = messages_of(tmp_path / "out.mcap")
    assert not found.lossless
    assert proven <= before and (unproven - before).total() <= 1
    assert 5 < unproven.total() == sum(tally.unproven for tally in found.topics.values())
    assert all(begin <= log_time <= end for _, log_time, _, _ in unproven)
    assert any(topic.startswith(UNPROVEN) for topic in open_log([tmp_path / "out.mcap"]).topics)


def test_a_log_that_was_cut_short(sound: Path, tmp_path: Path, garbi: Garbi) -> None:
    """All whole chunks, the beginning of the last one unproven; how much came after is not known, and that is said."""
    offset, length, _, _ = chunk_of(sound, 10)
    (tmp_path / "cut.mcap").write_bytes(sound.read_bytes()[: offset + length // 2])
    ended = garbi("recover", tmp_path / "cut.mcap", "-o", tmp_path / "out.mcap")
    assert ended.status == 3
    assert "the file ends inside a chunk" in ended.out and "unknown number" in ended.out
    proven, unproven, _ = messages_of(tmp_path / "out.mcap")
    truth = messages_of(sound)[0]
    assert proven <= truth and unproven <= truth and unproven


def test_names_that_come_late(sound: Path, tmp_path: Path) -> None:
    """The chunk that names the topics moved to the end, and no index: nothing is lost."""
    data = sound.read_bytes()
    (first, second), last = (chunk_of(sound, number)[0] for number in (0, 1)), chunk_of(sound, -1)[0]
    (tmp_path / "late.mcap").write_bytes(data[:first] + data[second:last] + data[first:second] + data[last:-100])
    recover(tmp_path / "late.mcap", tmp_path / "out.mcap")
    assert messages_of(tmp_path / "out.mcap")[0] == messages_of(sound)[0]
    assert open_log([tmp_path / "late.mcap"]).topics == open_log([sound]).topics


def test_chunks_that_changed_places_go_back(sound: Path, tmp_path: Path) -> None:
    """The index tells where a chunk was: messages come in the order in which they were written."""
    data = sound.read_bytes()
    (a, b, *_), (c, d, *_) = chunk_of(sound, 3), chunk_of(sound, 9)
    (tmp_path / "swapped.mcap").write_bytes(
        data[:a] + data[c : c + d] + data[a + b : c] + data[a : a + b] + data[c + d :]
    )
    found = recover(tmp_path / "swapped.mcap", tmp_path / "out.mcap")
    assert found.lossless
    assert contents(open_log([tmp_path / "out.mcap"])) == contents(open_log([sound]))


def test_names_from_a_damaged_chunk_are_said_to_be(sound: Path, tmp_path: Path) -> None:
    """The chunk that names the topics is damaged and there is no index: the names are taken, and it is told."""
    offset, length, _, _ = chunk_of(sound, 0)
    data = bytearray(sound.read_bytes()[:-100])
    data[offset + length - 200 : offset + length - 100] = bytes(100)
    (tmp_path / "names.mcap").write_bytes(data)
    found = recover(tmp_path / "names.mcap", tmp_path / "out.mcap")
    assert messages_of(tmp_path / "out.mcap")[0].total() > 0.8 * messages_of(sound)[0].total()
    assert any("/imu/data is from a damaged chunk" in note for note in found.notes)
    log = open_log([tmp_path / "names.mcap"])
    assert contents(log)["imu"] and any("names from a damaged chunk" in line for line in log.losses)


def test_metadata_that_was_changed_is_told(sound: Path, tmp_path: Path) -> None:
    """MCAP gives metadata no checksum, but our logs have one over everything."""
    data = sound.read_bytes().replace(b"tank", b"tonk", 1)
    (tmp_path / "changed.mcap").write_bytes(data)
    found = recover(tmp_path / "changed.mcap", tmp_path / "out.mcap")
    assert not found.lossless and any("metadata" in line for line in found.records_lost)


def test_logs_without_chunks_and_without_checksums(tmp_path: Path) -> None:
    """They come back whole, and it is said that damage in them cannot be seen."""
    for options in ({"use_chunking": False}, {"enable_crcs": False}):
        path = tmp_path / "bare.mcap"
        with path.open("wb") as file:
            writer = Writer(file, **options)
            writer.start("", "test")
            channel = writer.register_channel("talk", "json", writer.register_schema("Talk", "jsonschema", b"{}"))
            for step in range(50):
                writer.add_message(channel, step, b'{"n": %d}' % step, step, step)
            writer.finish()
        (tmp_path / "out.mcap").unlink(missing_ok=True)
        found = recover(path, tmp_path / "out.mcap")
        assert found.lossless and found.topics["talk"].proven == 50
        assert any("damage in them cannot be seen" in note for note in found.notes)


def test_refusals(sound: Path, tmp_path: Path, garbi: Garbi) -> None:
    """Nothing is written over, a directory is not one log, nothing comes of noise: one line each, exit status 1."""
    (tmp_path / "noise.mcap").write_bytes(np.random.default_rng(1).bytes(50_000))
    (tmp_path / "empty.mcap").touch()
    before = sound.read_bytes()
    for log, out, words in (
        (sound, sound, "exists already"),
        (sound, tmp_path / "noise.mcap", "exists already"),
        (tmp_path, tmp_path / "out.mcap", "one MCAP file at a time"),
        (sound, tmp_path / "nowhere" / "out.mcap", "no such folder"),
        (tmp_path / "none.mcap", tmp_path / "out.mcap", "no such file"),
        (tmp_path / "noise.mcap", tmp_path / "out.mcap", "no message in it can be read"),
        (tmp_path / "empty.mcap", tmp_path / "out.mcap", "is empty"),
    ):
        ended = garbi("recover", log, "-o", out)
        assert ended.status == 1 and words in ended.err and ended.err.count("\n") == 1
    assert sound.read_bytes() == before
    assert not list(tmp_path.glob("*out*")) and not list(tmp_path.glob(".*"))


def test_an_output_that_does_not_read_back_is_no_success(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was written is read again by another reader before anything is said."""
    from garbi_map.recover import output

    monkeypatch.setattr(
        output.Output, "message", lambda self, number, message: self.content.message(number, 0, 0, 0, b"")
    )
    with pytest.raises(GarbiError, match="read back"):
        recover(sound, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


class BadDisk(io.BytesIO):
    """A file whose disk does not give some of its bytes."""

    def __init__(self, data: bytes, begin: int, end: int) -> None:
        super().__init__(data)
        self.begin, self.end = begin, end

    def read(self, size: int | None = -1, /) -> bytes:
        begin = self.tell()
        if size and begin < self.end and begin + size > self.begin:
            raise OSError(5, "Input/output error")
        return super().read(size)


def test_a_disk_with_unreadable_sectors(sound: Path) -> None:
    """The survey goes on behind them, at the next chunk."""
    offset, _, _, _ = chunk_of(sound, 6)
    data = sound.read_bytes()
    whole = list(survey(io.BytesIO(data), len(data)))
    found = list(survey(BadDisk(data, offset, offset + 20), len(data)))
    assert {frame for frame in whole if frame.offset > offset + 8192} <= set(found)
    assert any("Input/output error" in frame.why for frame in found)


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """40 MB of images through a few chunks' worth of memory."""
    with LogWriter(tmp_path / "log.mcap") as writer:
        for step in range(400):
            writer.write_image(Image(START + step * 10**8, START + step * 10**8, "jpeg", jpeg_like(step, 100_000)))
    tracemalloc.start()
    found: Recovery = recover(tmp_path / "log.mcap", tmp_path / "out.mcap")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.messages == 400
    assert peak < 16_000_000
