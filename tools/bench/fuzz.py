"""A million hostile inputs to everything that reads what somebody else wrote.

    python -m tools.bench.fuzz [--count 1000000] [--only NAME] [-o tools/bench/results]

Each parser gets noise, valid input with bytes, words, blocks or lines changed, and input that is built to be believed (a
sound checksum around nonsense). It may give a result or say in its own kind of error that it cannot; anything else, a
minute without an end, or memory beyond the bound is a failure. Results: fuzz.json, fuzz.md.
"""

from __future__ import annotations

import argparse
import json
import resource
import signal
import struct
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from behaviours.expectations import parse_plan
from garbi_map.calibrate.files import read_camera_info
from garbi_map.calibrate.targets import parse_target
from garbi_map.config import Config, load_config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter, Mount, chunks, open_log, salvage
from garbi_map.log.chunks import DAMAGE
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, decode_image, decoders
from garbi_map.log.types import standard_types
from garbi_map.recover import recover
from garbi_map.rig import parse_rig
from garbi_map.stripe.decode import UnusableImage, decode

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
START = 1_790_000_000_000_000_000
MOST_MEMORY = 2 << 30  # bytes that all of it may take
PATIENCE = 60  # s
WORDS = (
    0,
    1,
    2,
    7,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    1 << 40,
    (1 << 63) - 1,
    (1 << 64) - 1,
)
SCALARS = ("-1", "0", "1e308", ".nan", ".inf", "-.inf", "[]", "{}", "''", "null", "true", "0x7fffffffffffffff", "a b", "2001-01-01",
           "1:30", "!!binary aGk=", "&a [1]", "*a", "99999999999999999999", "[1, 2, 3]", "{a: 1}", "~", "é", "\"\\0\"")  # fmt: skip

Random = np.random.Generator
Make = Callable[[Random], bytes]


@dataclass
class Parser:
    """name, what reads, errors it may raise, inputs it takes, share of all inputs, another way to make one."""

    name: str
    read: Callable[[bytes], object]
    errors: tuple[type[BaseException], ...]
    valid: list[bytes]
    share: float
    built: Make | None = None


@dataclass
class Outcome:
    """What became of a parser's inputs. peak_mb: resident memory of the whole program at the end."""

    inputs: int = 0
    taken: int = 0
    refused: int = 0
    failed: int = 0
    slowest_s: float = 0.0
    cpu_s: float = 0.0
    peak_mb: float = 0.0
    failures: Counter[str] = field(default_factory=Counter)


def noise(random: Random) -> bytes:
    """Any bytes."""
    return random.bytes(int(random.integers(0, 400)))


def changed(data: bytes, random: Random) -> bytes:
    """Valid input with a few bytes, words or blocks changed, taken out or repeated."""
    found = bytearray(data)
    for _ in range(int(random.integers(1, 6))):
        if not found:
            break
        place, length = (int(n) for n in random.integers(0, len(found), 2))
        length = min(length, 64)
        kind = random.integers(6)
        if kind == 0:
            found[place] = int(random.integers(256))
        elif kind == 1:
            found[place] ^= 1 << int(random.integers(8))
        elif kind == 2:
            width = int(random.choice([2, 4, 8]))
            place -= place % 4
            word = WORDS[int(random.integers(len(WORDS)))] & ((1 << 8 * width) - 1)
            found[place : place + width] = word.to_bytes(width, "little")
        elif kind == 3:
            del found[place : place + length]
        elif kind == 4:
            found[place:place] = found[place : place + length]
        else:
            del found[place:]
    return bytes(found)


def edited(data: bytes, random: Random) -> bytes:
    """Valid text with values, lines and indentation changed."""
    lines = data.decode().splitlines()
    for _ in range(int(random.integers(1, 4))):
        if not lines:
            break
        place, other = (int(n) for n in random.integers(0, len(lines), 2))
        kind = random.integers(5)
        if kind == 0 and ":" in lines[place]:
            lines[place] = f"{lines[place].partition(':')[0]}: {SCALARS[int(random.integers(len(SCALARS)))]}"
        elif kind == 1:
            del lines[place]
        elif kind == 2:
            lines.insert(place, lines[other])
        elif kind == 3:
            lines[place] = " " * int(random.integers(4)) + lines[place].strip()
        else:
            return changed("\n".join(lines).encode(), random)
    return "\n".join(lines).encode()


def believed(random: Random, valid: list[bytes]) -> bytes:
    """A log whose checksums are right and whose records are nonsense."""
    records = b""
    for _ in range(int(random.integers(1, 12))):
        opcode = int(random.choice([1, 3, 4, 5, 5, 5, 6, 9, 12, 0x80, int(random.integers(256))]))
        content = valid[int(random.integers(len(valid)))][:200] if random.integers(2) else noise(random)
        if opcode == 5:
            content = struct.pack("<HIQQ", int(random.integers(12)), 0, START, START) + content
        stated = WORDS[int(random.integers(len(WORDS)))] if random.integers(10) == 0 else len(content)
        records += struct.pack("<BQ", opcode, stated) + content
    size = WORDS[int(random.integers(len(WORDS)))] if random.integers(10) == 0 else len(records)
    head = struct.pack("<QQQII", START, START, size, zlib.crc32(records), 0) + struct.pack("<Q", len(records))
    return (
        chunks.MAGIC
        + struct.pack("<BQ", 6, len(head) + len(records))
        + head
        + records
        + b"\x0f"
        + struct.pack("<QI", 4, 0)
    )


def small_log(folder: Path, compression: str) -> bytes:
    """A log of every topic in a few kilobytes."""
    path = folder / "small.mcap"
    with LogWriter(path, compression=compression, chunk_size=2_000) as log:  # type: ignore[arg-type]
        log.attach("rig.yaml", "application/yaml", b"camera: {}")
        log.write_metadata("dive", {"place": "tank"})
        log.write_mounts(START, {"rig": Mount(), "imu_link": Mount()})
        for step in range(12):
            stamp = START + step * 20_000_000
            log.write_image(Image(stamp, stamp, "jpeg", bytes(range(200))))
            log.write_encoder(stamp, 0.1 * step)
            log.write_imu(stamp, [0, 0, 0], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3))
            log.write_pressure(stamp, 1e5)
            log.write_dvl(stamp, [0, 0, 0])
            log.write_navsat(stamp, 41.0, 2.0, 0.0, np.eye(3))
            log.write_usbl(stamp, [0, 0, 0], np.eye(3))
            log.write_odometry(stamp, [0, 0, 0], [0, 0, 0, 1])
    return path.read_bytes()


def _messages(folder: Path) -> dict[str, list[bytes]]:
    """type -> messages of it."""
    (folder / "m.mcap").write_bytes(small_log(folder, ""))
    log = open_log([folder / "m.mcap"])
    found: dict[str, list[bytes]] = {}
    for topic, raw in log.messages(set(log.topics)):
        found.setdefault(log.topics[topic].type, []).append(bytes(raw.data))
    return {name: messages[:3] for name, messages in found.items()}


def _pictures() -> list[bytes]:
    import cv2

    picture = (np.add.outer(np.arange(48), np.arange(64)) % 256).astype(np.uint8)
    coloured = np.dstack([picture, picture.T.copy().reshape(48, 64), picture])
    return [cv2.imencode(kind, one)[1].tobytes() for kind in (".jpg", ".png") for one in (picture, coloured)]


def parsers(folder: Path) -> list[Parser]:
    """Everything that reads what somebody else wrote."""
    types = standard_types()
    messages = _messages(folder)
    logs = [small_log(folder, compression) for compression in ("", "lz4", "zstd")]
    log_text = open_log([SAMPLE]).rig_text or ""
    path, out = folder / "log.mcap", folder / "out.mcap"

    def read_log(data: bytes) -> None:
        path.write_bytes(data)
        log = open_log([path])
        log.verify()
        log.navigation()
        for _ in log.images():
            pass
        log.log_times()

    def read_recovered(data: bytes) -> None:
        path.write_bytes(data)
        out.unlink(missing_ok=True)
        recover(path, out)

    def read_chunk(data: bytes) -> None:
        found = salvage.decoded_part(memoryview(data))
        list(salvage.definitions(found))
        try:
            head = chunks.chunk_head(memoryview(data), whole=False)
        except DAMAGE:
            return
        list(salvage.messages(found, range(100), head))
        chunks.unpack_chunk(memoryview(data))

    def file_of(read: Callable[[Path], object]) -> Callable[[bytes], object]:
        def reading(data: bytes) -> object:
            (folder / "file.yaml").write_bytes(data)
            return read(folder / "file.yaml")

        return reading

    def text_of(read: Callable[[str, str], object]) -> Callable[[bytes], object]:
        return lambda data: read(data.decode(errors="replace"), "here")

    logs_chunks = [log[start + 9 : end] for log in logs for start, end in _chunk_places(log)][:9]
    rig, plan = log_text.encode(), _plan()
    bodies = [one for group in messages.values() for one in group]
    found = [
        Parser("log", read_log, (GarbiError,), logs, 0.02, lambda r: believed(r, bodies)),
        Parser(
            "garbi recover",
            read_recovered,
            (GarbiError,),
            logs,
            0.015,
            lambda r: believed(r, bodies),
        ),
        Parser("chunk", read_chunk, DAMAGE, logs_chunks, 0.10),
        Parser("image file", lambda data: decode(Image(0, 0, "jpeg", data)), (UnusableImage,), _pictures(), 0.08),
        Parser("rig.yaml", text_of(parse_rig), (GarbiError,), [rig], 0.02),
        Parser("target.yaml", text_of(parse_target), (GarbiError,), _targets(), 0.06),
        Parser("behaviours and expectations", text_of(parse_plan), (GarbiError,), [plan], 0.05),
        Parser("configuration", file_of(load_config), (GarbiError,), _configurations(), 0.04),
        Parser("camera_info", file_of(read_camera_info), (GarbiError,), [_camera_info()], 0.02),
    ]
    share = (1 - sum(parser.share for parser in found)) / 9
    for by_type in decoders(types, "laser_joint", set()).values():
        for name, (_, read) in by_type.items():
            if name in messages:
                one = Parser(f"message {name.rpartition('/')[2]}", _viewing(read), BAD_MESSAGE, messages[name], share)
                found.append(one)
    picture = messages[IMAGE_TYPES[0]]
    found.append(
        Parser(
            "message CompressedImage",
            lambda d: decode_image(types, IMAGE_TYPES[0], memoryview(d), 0),
            BAD_MESSAGE,
            picture,
            share,
        )
    )
    raw = _raw_image(types)
    found.append(
        Parser(
            "message Image", lambda d: decode_image(types, IMAGE_TYPES[1], memoryview(d), 0), BAD_MESSAGE, [raw], share
        )
    )
    return found


def _viewing(read: Callable[[memoryview], object]) -> Callable[[bytes], object]:
    return lambda data: read(memoryview(data))


def _chunk_places(data: bytes) -> list[tuple[int, int]]:
    from tools.bench.recover import chunk_places

    return chunk_places(data)


def _raw_image(types: object) -> bytes:
    from typing import Any

    store: Any = types
    header = store.types["std_msgs/msg/Header"](
        stamp=store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2), frame_id="c"
    )
    data = np.arange(60, dtype=np.uint8)
    message = store.types[IMAGE_TYPES[1]](
        header=header, height=6, width=10, encoding="mono8", is_bigendian=0, step=10, data=data
    )
    return bytes(store.serialize_cdr(message, IMAGE_TYPES[1]))


def _plan() -> bytes:
    for log in sorted(SAMPLE.parent.glob("behaviour_*.mcap")):
        for record in open_log([log]).metadata.values():
            for text in record.values():
                if "expectations" in text:
                    return text.encode()
    return b"expectations:\n- stops: {within: 0.6}\n"


def _targets() -> list[bytes]:
    return [
        b"kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.03\n",
        b"kind: charuco\nsquares: [10, 7]\nsquare: 0.03\nmarker: 0.022\ndictionary: DICT_4X4_250\n",
        b"kind: apriltag\ntags: [5, 4]\ntag: 0.05\ngap: 0.015\nfamily: tag36h11\n",
        b"kind: two_planes\nsquares: [5, 4]\nsquare: 0.04\npitch: 0.07\nplanes:\n- origin: [-0.36, -0.16, 0]\n  u: [1, 0, 0]\n"
        b"  v: [0, 1, 0]\n- origin: [0, -0.16, -0.04]\n  u: [0, 0, -1]\n  v: [0, 1, 0]\n",
    ]


def _configurations() -> list[bytes]:
    """A section each, as the whole takes long to parse."""
    import yaml

    whole = Config().model_dump(mode="json")
    return [
        yaml.safe_dump({name: section}, sort_keys=False).encode()
        for name, section in whole.items()
        if len(str(section)) < 1500
    ]


def _camera_info() -> bytes:
    return (
        b"image_width: 768\nimage_height: 576\ncamera_name: c\ncamera_matrix:\n  data: [800, 0, 384, 0, 800, 288, 0, 0, 1]\n"
        b"distortion_model: plumb_bob\ndistortion_coefficients:\n  data: [0.1, 0, 0, 0, 0]\n"
    )


def make(parser: Parser, random: Random) -> bytes:
    """One input."""
    kind = random.integers(10)
    if kind == 0:
        return noise(random)
    if kind < 4 and parser.built is not None:
        return parser.built(random)
    valid = parser.valid[int(random.integers(len(parser.valid)))]
    textual = parser.name.endswith(".yaml") or parser.name in (
        "configuration",
        "camera_info",
        "behaviours and expectations",
    )
    return edited(valid, random) if textual and kind < 8 else changed(valid, random)


def _too_long(*_: object) -> None:
    raise TimeoutError("no end after a minute")


def feed(parser: Parser, count: int, random: Random) -> Outcome:
    """Give a parser so many inputs."""
    outcome = Outcome()
    signal.signal(signal.SIGALRM, _too_long)
    for _ in range(count):
        data = make(parser, random)
        begin = time.process_time()
        signal.alarm(PATIENCE)
        outcome.inputs += 1
        try:
            parser.read(data)
            outcome.taken += 1
        except TimeoutError as error:
            outcome.failed += 1
            outcome.failures[f"{error}: {data[:80]!r}"] += 1
        except parser.errors as error:
            outcome.refused += 1
            if isinstance(error, GarbiError) and "\n" in str(error):
                outcome.failures[f"more than a line: {str(error)[:80]!r}"] += 1
        except Exception as error:
            outcome.failed += 1
            last = traceback.extract_tb(error.__traceback__)[-1]
            own = [
                f
                for f in traceback.extract_tb(error.__traceback__)
                if "garbi_map" in f.filename or "behaviours" in f.filename
            ]
            where = f"{Path((own or [last])[-1].filename).name}:{(own or [last])[-1].lineno}"
            outcome.failures[f"{type(error).__name__} at {where}: {str(error)[:80]}"] += 1
        finally:
            signal.alarm(0)
        spent = time.process_time() - begin
        outcome.cpu_s += spent
        outcome.slowest_s = max(outcome.slowest_s, spent)
    outcome.peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return outcome


def table(outcomes: dict[str, Outcome]) -> str:
    """Markdown."""
    lines = [
        "| parser | inputs | read | refused | failed | slowest, s CPU | peak of the program, MB |",
        "| --- " * 7 + "|",
    ]
    lines += [
        f"| {name} | {o.inputs:,} | {o.taken:,} | {o.refused:,} | {o.failed:,} | {o.slowest_s:.3f} | {o.peak_mb:.0f} |"
        for name, o in outcomes.items()
    ]
    total = sum(o.inputs for o in outcomes.values())
    lines.append(f"| all | {total:,} | | | {sum(o.failed for o in outcomes.values()):,} | | |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Feed all parsers, print and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--count", type=int, default=1_000_000)
    options.add_argument("--only", default="", help="parsers whose names hold this")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    given = options.parse_args()
    outcomes: dict[str, Outcome] = {}
    given.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        found = [parser for parser in parsers(Path(scratch)) if given.only in parser.name]
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY + (4 << 30), resource.RLIM_INFINITY))
        for number, parser in enumerate(found):
            random = np.random.default_rng([given.seed, number])
            outcomes[parser.name] = feed(parser, max(1, round(given.count * parser.share)), random)
            print(parser.name, outcomes[parser.name], flush=True)
            plain = {name: vars(outcome) for name, outcome in outcomes.items()}
            (given.output / "fuzz.json").write_text(json.dumps(plain, indent=2) + "\n")
            (given.output / "fuzz.md").write_text(f"# Hostile input\n\n{table(outcomes)}")
    print(table(outcomes))


if __name__ == "__main__":
    main()
