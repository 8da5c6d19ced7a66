"""A log, its names and its attachments are somebody else's: they are shown, never run, and never become paths."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import simplejpeg
from conftest import Garbi
from mcap.reader import make_reader
from mcap.writer import Writer
from sample_log import START, write_sample

from garbi_map.log import Image, open_log
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, decode_image
from garbi_map.log.types import standard_types
from garbi_map.recover import recover
from garbi_map.stripe.decode import UnusableImage, decode

SCRIPT = "<script>alert(1)</script>"
HOSTILE_NAMES = ("/[red]x[/nope]", "/\x1b[2J\x1b]0;owned\x07", f"/{SCRIPT}", "/a\nb", "/\u202etxt", "")
UP = "../../../out_of_here"


def hostile(path: Path) -> Path:
    """A log whose topics, types, attachments and metadata have hostile names, and its copy cut short."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=500)
        writer.start("ros2", "test")
        for name in HOSTILE_NAMES:
            schema = writer.register_schema(f"pkg/msg/{name}", "ros2msg", b"")
            channel = writer.register_channel(name, "cdr", schema)
            for step in range(20):
                writer.add_message(channel, START + step * 10**7, bytes(30), START + step * 10**7)
        writer.add_attachment(START, START, UP, "text/plain", b"not here")
        writer.add_attachment(START, START, "/tmp/out_of_here", "text/plain", b"not here")
        writer.add_metadata(UP, {SCRIPT: "\x1b[2J"})
        writer.finish()
    return path


@pytest.mark.parametrize("cut", [0, 900])
def test_names_are_shown_not_obeyed_by_the_terminal(cut: int, tmp_path: Path, garbi: Garbi) -> None:
    """Markup, control characters and newlines in names: check, map and recover print what they are, and nothing else."""
    log = hostile(tmp_path / "log.mcap")
    log.write_bytes(log.read_bytes()[: -cut or None])
    for command in (
        ("check", log),
        ("map", log, "-o", tmp_path / "map"),
        ("recover", log, "-o", tmp_path / "out.mcap"),
    ):
        ended = garbi(*command)
        said = ended.out + ended.err
        assert "fault of garbi's own" not in said and "Traceback" not in said
        assert not any(ord(letter) < 32 and letter != "\n" for letter in said)
        assert "\u202e" not in said


def test_attachments_never_become_paths(tmp_path: Path, garbi: Garbi) -> None:
    """Names that lead out of the folder stay names."""
    folder = tmp_path / "a" / "b" / "c"
    folder.mkdir(parents=True)
    log = hostile(folder / "log.mcap")
    before = set(tmp_path.rglob("*"))
    found = recover(log, folder / "out.mcap")
    garbi("check", log)
    assert set(found.attachments) == {UP, "/tmp/out_of_here"}
    assert set(tmp_path.rglob("*")) - before == {folder / "out.mcap"}
    assert not Path("/tmp/out_of_here").exists()
    with (folder / "out.mcap").open("rb") as file:
        assert {one.name for one in make_reader(file).iter_attachments()} == set(found.attachments)


def test_a_rosbag2_listing_does_not_lead_out_of_its_folder(tmp_path: Path, garbi: Garbi) -> None:
    """metadata.yaml that names files elsewhere."""
    bag = tmp_path / "bag"
    bag.mkdir()
    write_sample(tmp_path / "secret.mcap")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [../secret.mcap]}")
    ended = garbi("check", bag)
    assert ended.status == 1 and "missing" in ended.err


def test_pickles_in_a_map_folder_are_not_opened(tmp_path: Path) -> None:
    """The sweeps that a run keeps are arrays; what would run code is refused."""
    from garbi_map.sweep.store import SweepStore

    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (tmp_path / "owned",)  # type: ignore[return-value]

    np.savez(tmp_path / "000000.npz", stamp_ns=np.array([Evil()], dtype=object))
    store = SweepStore.__new__(SweepStore)
    store.folder = tmp_path
    with pytest.raises((ValueError, pickle.UnpicklingError)):
        store.load(0)
    assert not (tmp_path / "owned").exists()


def png(width: int, height: int, chunk_length: int | None = None) -> bytes:
    """A few hundred bytes of PNG that claim a size."""
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes, length: int | None = None) -> bytes:
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data) if length is None else length) + kind + data + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels, chunk_length) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    """A small JPEG whose header says another size."""
    data = bytearray(simplejpeg.encode_jpeg(np.zeros((8, 8, 3), np.uint8)))
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = height.to_bytes(2, "big") + width.to_bytes(2, "big")
    return bytes(data)


@pytest.mark.parametrize(
    "data",
    [png(7000, 7000), png(1 << 30, 1 << 30), png(100, 100, 0x7FFFFFFF), png(100, 100, 0xFFFFFFF0), jpeg(65000, 65000)],
    ids=["more than it can hold", "endless", "a huge chunk", "a chunk round the end", "endless JPEG"],
)
def test_image_bombs_cost_no_memory(data: bytes) -> None:
    """What a header claims is compared with what there is before anything is allocated."""
    import resource

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UnusableImage):
        decode(Image(START, START, "png", data))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize("count", [0x7FFFFFFF, 0xFFFFFFFF, 1 << 20])
def test_sequence_lengths_cost_no_memory(count: int) -> None:
    """A CDR sequence that claims billions of bytes, strings or transforms, in a few bytes."""
    import tracemalloc

    types = standard_types()
    header = b"\0\1\0\0" + bytes(8) + (1).to_bytes(4, "little") + b"\0\0\0\0"
    bodies = {
        IMAGE_TYPES[0]: header + (5).to_bytes(4, "little") + b"jpeg\0\0\0\0" + count.to_bytes(4, "little"),
        "sensor_msgs/msg/JointState": header + count.to_bytes(4, "little") + bytes(64),
        "tf2_msgs/msg/TFMessage": b"\0\1\0\0" + count.to_bytes(4, "little") + bytes(64),
    }
    tracemalloc.start()
    for name, data in bodies.items():
        with pytest.raises(BAD_MESSAGE):
            types.deserialize_cdr(memoryview(data), name)
    with pytest.raises(BAD_MESSAGE):
        decode_image(types, IMAGE_TYPES[0], memoryview(bodies[IMAGE_TYPES[0]]), 0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10_000_000


def test_chunks_that_claim_more_than_they_hold(tmp_path: Path) -> None:
    """A gigabyte of claimed data in a hundred bytes, packed and not: the log is refused without the gigabyte."""
    import struct
    import tracemalloc
    import zlib

    tracemalloc.start()
    for name in (b"", b"zstd", b"lz4"):
        for size in (1 << 29, 1 << 40, (1 << 64) - 1):
            body = zlib.compress(bytes(100))
            head = struct.pack("<QQQII", 0, 1, size, 1, len(name)) + name + struct.pack("<Q", len(body))
            chunk = struct.pack("<BQ", 6, len(head) + len(body)) + head + body
            (tmp_path / "bomb.mcap").write_bytes(b"\x89MCAP0\r\n" + chunk)
            with pytest.raises(Exception, match="no message"):
                open_log([tmp_path / "bomb.mcap"])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 16 << 20
