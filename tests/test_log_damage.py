"""A damaged log gives what is sound in it and names what is not; it never gives anything else."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from sample_log import RIG, contents, write_sample

from garbi_map.errors import GarbiError
from garbi_map.log import LogSettings, open_log
from garbi_map.log.survey import survey

COMPRESSIONS = ("zstd", "lz4", "")


@pytest.fixture(scope="module", params=COMPRESSIONS, ids=["zstd", "lz4", "none"])
def original(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, dict]:
    """The bytes of a sound log of about twenty chunks, and what is in it."""
    path = write_sample(tmp_path_factory.mktemp("sound") / "log.mcap", compression=request.param, chunk_size=6_000)
    log = open_log([path], LogSettings())
    found = contents(log)
    assert log.losses == []
    return path.read_bytes(), found


def read_damaged(path: Path, damaged: bytes, truth: dict) -> float:
    """Read a damaged log and compare; the share of its messages that was recovered."""
    path.write_bytes(damaged)
    try:
        log = open_log([path], LogSettings())
        found = contents(log)
    except GarbiError as error:
        assert "\n" not in str(error)
        return 0.0
    total = recovered = 0
    for role, rows in truth.items():
        got = found.get(role, {})
        assert got.items() <= rows.items(), f"{role}: something that was never recorded"
        total, recovered = total + len(rows), recovered + len(got)
    assert log.rig_text in (RIG, None)
    if recovered < total or log.rig_text is None:
        assert log.losses, "something is missing and nobody says so"
    return recovered / total


def test_truncated_anywhere(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """A log that was cut short gives all its whole chunks."""
    data, truth = original
    shares = [
        read_damaged(tmp_path / "cut.mcap", data[:length], truth)
        for length in np.linspace(1, len(data) - 1, 30).astype(int)
    ]
    assert shares == sorted(shares)
    lengths = np.linspace(1, len(data) - 1, 30) / len(data)
    assert np.all(np.array(shares) > lengths - 0.25)


def test_bit_flips(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """A flipped bit costs a chunk at most."""
    data, truth = original
    random = np.random.default_rng(1)
    for position in random.integers(8, len(data), 40):
        damaged = bytearray(data)
        damaged[position] ^= 1 << random.integers(8)
        assert read_damaged(tmp_path / "flip.mcap", bytes(damaged), truth) > 0.8


def test_bit_flips_without_an_index(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """The same where the log was also cut: nothing but the records themselves to go by."""
    data, truth = original
    random = np.random.default_rng(2)
    end = len(data) * 3 // 4
    for position in random.integers(8, end, 40):
        damaged = bytearray(data[:end])
        damaged[position] ^= 1 << random.integers(8)
        share = read_damaged(tmp_path / "flip.mcap", bytes(damaged), truth)
        # the first chunk holds the names of the topics
        assert share > 0.4 or position < 8_000


def test_zeroed_blocks(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """A block of zeros costs the chunks it lies in."""
    data, truth = original
    random = np.random.default_rng(3)
    for length in (512, 4096, 16_384):
        for position in random.integers(0, len(data) - length, 12):
            damaged = data[:position] + bytes(length) + data[position + length :]
            share = read_damaged(tmp_path / "zero.mcap", damaged, truth)
            assert share > 1 - (length + 20_000) / len(data)


def test_swapped_halves(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """Blocks that changed places never give wrong data."""
    data, truth = original
    for cut in np.linspace(1000, len(data) - 1000, 10).astype(int):
        read_damaged(tmp_path / "swap.mcap", data[:8] + data[cut:] + data[8:cut], truth)


def test_moved_blocks(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """Blocks copied over others, so that whole records stand where they do not belong, never give wrong data."""
    data, truth = original
    random = np.random.default_rng(6)
    for _ in range(60):
        damaged = bytearray(data)
        for _ in range(3):
            source, target, length = (int(n) for n in random.integers(0, len(data) - 10_000, 3))
            length %= 9_000
            damaged[target : target + length] = data[source : source + length]
        read_damaged(tmp_path / "moved.mcap", bytes(damaged), truth)


def test_random_bytes(tmp_path: Path) -> None:
    """Noise behind the magic is no log, in one line."""
    for seed in range(20):
        noise = np.random.default_rng(seed).bytes(20_000)
        (tmp_path / "noise.mcap").write_bytes(b"\x89MCAP0\r\n" + noise)
        with pytest.raises(GarbiError, match="holds no message"):
            open_log([tmp_path / "noise.mcap"], LogSettings())


@pytest.mark.parametrize("opcode", [0, 2, 4, 7, 9, 0x0E, 0x16, 0x46, 0x86])
def test_a_chunk_that_is_called_something_else(original: tuple[bytes, dict], tmp_path: Path, opcode: int) -> None:
    """A garbled opcode and no index: what is behind it is still read, and the chunk is named as lost."""
    data, truth = original
    places = [frame.offset for frame in survey(io.BytesIO(data), len(data)) if frame.opcode == Opcode.CHUNK]
    damaged = bytearray(data[:-100])
    damaged[places[8]] = opcode
    assert read_damaged(tmp_path / "opcode.mcap", bytes(damaged), truth) > 0.85
    losses = open_log([tmp_path / "opcode.mcap"]).losses
    assert any(f"byte {places[8]}:" in line for line in losses)


def test_attachments_behind_damage_are_found(original: tuple[bytes, dict], tmp_path: Path) -> None:
    """The header overwritten so that the attachment behind it is not the next record: it is found by its shape."""
    data, truth = original
    (attachment,) = [f.offset for f in survey(io.BytesIO(data), len(data)) if f.opcode == Opcode.ATTACHMENT]
    read_damaged(tmp_path / "begin.mcap", data[:8] + bytes(attachment - 8) + data[attachment:-100], truth)
    assert open_log([tmp_path / "begin.mcap"]).rig_text == RIG
