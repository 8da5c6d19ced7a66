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
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from behaviours.expectations import parse_plan
from garbi_map.calibrate.files import read_camera_info
from garbi_map.calibrate.targets import parse_target
from garbi_map.config import load_config
from garbi_map.errors import GarbiError
from garbi_map.importing import suggest_topics
from garbi_map.importing.tables import (
    encoder_of,
    read_angles,
    read_dvl,
    read_imu,
    read_mount_file,
    read_odometry,
    read_pressure,
)
from garbi_map.log import Image, chunks, open_log, salvage
from garbi_map.log.chunks import DAMAGE
from garbi_map.log.decode import BAD_MESSAGE, IMAGE_TYPES, decode_image, decoders
from garbi_map.log.types import standard_types
from garbi_map.record.lines import BadLine, parse_line
from garbi_map.recover import recover
from garbi_map.rig import parse_rig
from garbi_map.stripe.decode import UnusableImage, decode
from tools.bench.fuzz_inputs import (
    SAMPLE,
    Random,
    believed,
    camera_info,
    changed,
    configurations,
    edited,
    messages_of_every_type,
    mounts,
    noise,
    pictures,
    plan,
    raw_image,
    sensor_lines,
    small_log,
    summed,
    tables,
    targets,
)
from tools.bench.recover import chunk_places

MOST_MEMORY = 2 << 30  # bytes that all of it may take
PATIENCE = 60  # s
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


def parsers(folder: Path) -> list[Parser]:
    """Everything that reads what somebody else wrote."""
    types = standard_types()
    messages = messages_of_every_type(folder)
    logs = [small_log(folder, compression) for compression in ("", "lz4", "zstd")]
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
        list(salvage.messages(found, range(100), head.begin, head.end))
        chunks.unpack_chunk(memoryview(data))

    def read_suggested(data: bytes) -> None:
        path.write_bytes(data)
        (folder / "topics.yaml").write_text(suggest_topics(open_log([path])).to_yaml())
        load_config(folder / "topics.yaml")

    def file_of(read: Callable[[Path], object]) -> Callable[[bytes], object]:
        def reading(data: bytes) -> object:
            (folder / "file.yaml").write_bytes(data)
            return read(folder / "file.yaml")

        return reading

    def text_of(read: Callable[[str, str], object]) -> Callable[[bytes], object]:
        return lambda data: read(data.decode(errors="replace"), "here")

    logs_chunks = [log[start + 9 : end] for log in logs for start, end in chunk_places(log)][:9]
    bodies = [one for group in messages.values() for one in group]
    found = [
        Parser("log", read_log, (GarbiError,), logs, 0.006, lambda r: believed(r, bodies)),
        Parser(
            "garbi recover",
            read_recovered,
            (GarbiError,),
            logs,
            0.015,
            lambda r: believed(r, bodies),
        ),
        Parser("chunk", read_chunk, DAMAGE, logs_chunks, 0.10),
        Parser("image file", lambda data: decode(Image(0, 0, "jpeg", data)), (UnusableImage,), pictures(), 0.08),
        Parser("rig.yaml", text_of(parse_rig), (GarbiError,), [(open_log([SAMPLE]).rig_text or "").encode()], 0.02),
        Parser("target.yaml", text_of(parse_target), (GarbiError,), targets(), 0.03),
        Parser("behaviours and expectations", text_of(parse_plan), (GarbiError,), [plan()], 0.03),
        Parser("configuration", file_of(load_config), (GarbiError,), configurations(), 0.03),
        Parser("recorder's lines", parse_line, (BadLine,), sensor_lines(), 0.05, summed),
        Parser("camera_info", file_of(read_camera_info), (GarbiError,), [camera_info()], 0.02),
        Parser("topics suggested", read_suggested, (GarbiError,), logs, 0.006, lambda r: believed(r, bodies)),
        Parser("table", file_of(_read_tables), (GarbiError,), tables(), 0.05),
        Parser("mounts.yaml", file_of(read_mount_file), (GarbiError,), [mounts()], 0.02),
    ]
    share = (1 - sum(parser.share for parser in found)) / 9
    for by_type in decoders(types, "laser_joint", set()).values():
        for name, read in by_type.items():
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
    raw = raw_image()
    found.append(
        Parser(
            "message Image", lambda d: decode_image(types, IMAGE_TYPES[1], memoryview(d), 0), BAD_MESSAGE, [raw], share
        )
    )
    return found


def _read_tables(path: Path) -> None:
    """As whatever its heading says it is."""
    heading = path.read_bytes().partition(b"\n")[0]
    for name, read in (
        (b"rate", lambda one: read_imu(one, None)),
        (b"depth", read_pressure),
        (b"velocity", read_dvl),
        (b"x_m", read_odometry),
    ):
        if name in heading:
            read(path)
            return
    encoder_of(read_angles(path))


def _viewing(read: Callable[[memoryview], object]) -> Callable[[bytes], object]:
    return lambda data: read(memoryview(data))


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
