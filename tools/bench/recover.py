"""Damaged logs, and what `garbi recover` and `rerun mcap convert --recover` get back of them.

    python -m tools.bench.recover [--share 0.1] [--only zstd] [--rerun-every 10] [-o tools/bench/results]

A log of about 2 MB is written with each compression and damaged: cut short at 200 places, 1,000 single bits turned, blocks
of zeros, chunks that changed places, the end missing, blocks copied over others. Every message that comes back is
compared by topic, times and the hash of its bytes with those that were written. Results: recover.json, recover.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from garbi_map.errors import GarbiError
from garbi_map.log import LogWriter, open_log
from garbi_map.recover import UNPROVEN, Recovery, recover

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
COMPRESSIONS = {"none": "", "lz4": "lz4", "zstd": "zstd"}
CASES = {"cut short": 200, "bit turned": 1000, "block of zeros": 100, "chunks swapped": 50, "block moved": 100}
PATIENCE = 1  # s of CPU; a program that takes 0.1 s for a sound log and has not ended then hangs
KINDS = (*CASES, "end missing")
FOOTER, MAGIC, DATA_END = 29, 8, 13  # bytes

Key = tuple[str, int, int, bytes]
Contents = Counter[Key]
Damage = Callable[[bytes, np.random.Generator, int, int], bytes]


def write_log(path: Path, compression: Any, size: int = 2_000_000, chunk_size: int = 1 << 16) -> Path:
    """The first megabytes of the sample log, in many chunks, with a metadata record."""
    log = open_log([SAMPLE])
    written = 0
    with LogWriter(path, compression=compression, chunk_size=chunk_size) as writer:
        writer.attach("rig.yaml", "application/yaml", (log.rig_text or "").encode())
        writer.write_metadata("dive", {"place": "a tank", "pilot": "nobody"})
        for topic, raw in log.messages({name for name in log.topics if name not in ("/tf", "/truth/seabed")}):
            type_name = log.topics[topic].type
            message = writer.types.deserialize_cdr(raw.data, type_name)
            writer.write(topic, type_name, message, raw.log_time, raw.publish_time)
            written += len(raw.data)
            if written > size:
                break
    return path


def cut_short(data: bytes, random: np.random.Generator, number: int, of: int) -> bytes:
    """The file ends early, at places evenly apart."""
    return data[: max(1, len(data) * (number + 1) // (of + 1))]


def bit_turned(data: bytes, random: np.random.Generator, number: int, of: int) -> bytes:
    """One bit, anywhere."""
    damaged = bytearray(data)
    damaged[random.integers(len(data))] ^= 1 << int(random.integers(8))
    return bytes(damaged)


def zeros(data: bytes, random: np.random.Generator, number: int, of: int) -> bytes:
    """A sector, a page or a cluster that was never written."""
    length = (512, 4096, 65536)[number % 3]
    start = int(random.integers(max(len(data) - length, 1))) // 512 * 512
    return data[:start] + bytes(length) + data[start + length :]


def swapped(data: bytes, random: np.random.Generator, number: int, of: int) -> bytes:
    """Two chunks in each other's place; every other time the index is missing as well."""
    chunks = chunk_places(data)
    first, second = sorted(int(n) for n in random.choice(len(chunks), 2, replace=False))
    (a, b), (c, d) = chunks[first], chunks[second]
    mixed = data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]
    return mixed if number % 2 else mixed[: -FOOTER - MAGIC]


def moved(data: bytes, random: np.random.Generator, number: int, of: int) -> bytes:
    """A block copied over another place."""
    source, target, length = (int(n) for n in random.integers(0, len(data) - 200_000, 3))
    damaged = bytearray(data)
    damaged[target : target + length % 150_000] = data[source : source + length % 150_000]
    return bytes(damaged)


def ends(data: bytes) -> Iterator[bytes]:
    """The last magic, the footer, the index, and the end of the data are missing, one after the other."""
    with_end = data.rindex(b"\x0f\x04" + bytes(7))
    for length in (MAGIC, FOOTER + MAGIC, len(data) - with_end - DATA_END, len(data) - with_end):
        yield data[:-length]


DAMAGES: dict[str, Damage] = {
    "cut short": cut_short,
    "bit turned": bit_turned,
    "block of zeros": zeros,
    "chunks swapped": swapped,
    "block moved": moved,
}


def damaged(data: bytes, share: float = 1.0, kinds: Sequence[str] = KINDS) -> Iterator[tuple[str, bytes]]:
    """(what happened, the damaged file), a share of all cases of each kind."""
    for kind, damage in DAMAGES.items():
        if kind not in kinds:
            continue
        random = np.random.default_rng(7)
        count = max(2, round(share * CASES[kind]))
        for number in range(count):
            yield kind, damage(data, random, number, count)
    for one in ends(data) if "end missing" in kinds else ():
        yield "end missing", one


def chunk_places(data: bytes) -> list[tuple[int, int]]:
    """(begin, end) of each chunk record of a sound log."""
    from io import BytesIO

    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None
    indexes: list[ChunkIndex] = summary.chunk_indexes
    return [(one.chunk_start_offset, one.chunk_start_offset + one.chunk_length) for one in indexes]


def _key(topic: str, log_time: int, publish_time: int, data: Any) -> Key:
    return topic, log_time, publish_time, blake2b(data, digest_size=12).digest()


def contents(path: Path) -> tuple[Contents, Contents, list[Any]]:
    """Messages, unproven messages (their topics without the prefix), and all else, of a sound log, by another reader than
    ours."""
    proven: Contents = Counter()
    unproven: Contents = Counter()
    others: list[Any] = []
    topics: dict[int, str] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Attachment | Metadata):
                others.append(record)
            for inner in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else ():
                if isinstance(inner, Message):
                    topic = topics[inner.channel_id]
                    found = unproven if topic.startswith(UNPROVEN) else proven
                    key = _key(topic.removeprefix(UNPROVEN), inner.log_time, inner.publish_time, inner.data)
                    found[key] += 1
                elif isinstance(inner, Channel):
                    topics[inner.id] = inner.topic
    return proven, unproven, others


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))


def rerun_contents(log: Path, out: Path) -> Contents | None:
    """What `rerun mcap convert --recover` gives, None where it gives nothing."""
    from rerun.chunk import RrdReader

    out.unlink(missing_ok=True)
    command = [str(files("rerun_cli") / "rerun"), "mcap", "convert", "--recover", "-d", "raw", "-o", str(out), str(log)]
    environment = {**os.environ, "RERUN_ANALYTICS": "0"}
    try:
        ended = subprocess.run(command, capture_output=True, env=environment, preexec_fn=_limit)
        if ended.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
            return HUNG
        found: Contents = Counter()
        for chunk in RrdReader(out).stream():
            batch = chunk.to_record_batch()
            if "McapMessage:data" not in batch.schema.names:
                continue
            data = batch.column("McapMessage:data")
            blobs = data.flatten().flatten().to_numpy()
            ends = data.flatten().offsets.to_numpy() - data.flatten().offsets[0].as_py()
            logged = batch.column("message_log_time").cast("int64").to_numpy()
            published = batch.column("message_publish_time").cast("int64").to_numpy()
            for row in range(len(batch)):
                blob = blobs[ends[row] : ends[row + 1]].tobytes()
                found[_key(chunk.entity_path, int(logged[row]), int(published[row]), blob)] += 1
    except (ValueError, RuntimeError, OSError):
        return None
    return found


HUNG: Contents = Counter()
HEADINGS = {
    "cases": "cases",
    "identical": "identical",
    "reported": "not identical, reported",
    "silent": "not identical, not reported",
    "nothing": "refused: nothing readable",
    "share_proven": "right messages, proven",
    "share": "right messages, with unproven",
    "wrong_as_sound": "wrong messages given as sound",
    "wrong_told": "wrong messages among the unproven",
    "compared": "cases given to both",
    "share_compared": "right messages of those",
    "rerun_share": "rerun: right messages",
    "below": "cases with fewer right messages than rerun",
    "rerun_wrong": "rerun: wrong messages given as sound",
    "rerun_nothing": "rerun: nothing readable",
    "rerun_hung": "rerun: hung",
}


@dataclass
class Row:
    """What came back of the logs of one compression and one kind of damage; shares of all messages, summed over cases.

    wrong_as_sound   messages that were never written, given as sound; wrong_told: the same, given as unproven
    silent           cases that are neither identical nor reported
    compared         cases that the other program was given, too; share_compared: our share of those
    below            of those, in which fewer right messages come back than from the other program
    """

    cases: int = 0
    identical: int = 0
    reported: int = 0
    silent: int = 0
    nothing: int = 0
    share_proven: float = 0.0
    share: float = 0.0
    wrong_as_sound: int = 0
    wrong_told: int = 0
    seconds: float = 0.0
    compared: int = 0
    share_compared: float = 0.0
    rerun_nothing: int = 0
    rerun_hung: int = 0
    rerun_share: float = 0.0
    rerun_wrong: int = 0
    below: int = 0


def judge(row: Row, log: Path, truth: Contents, others: list[Any], other_program: bool = True) -> Recovery | None:
    """Recover one damaged log and add what came of it to a row."""
    out = log.with_name("recovered.mcap")
    out.unlink(missing_ok=True)
    total = truth.total()
    row.cases += 1
    begin = time.process_time()
    found: Recovery | None = None
    proven: Contents = Counter()
    unproven: Contents = Counter()
    try:
        found = recover(log, out)
        row.seconds += time.process_time() - begin
        proven, unproven, kept = contents(out)
        identical = proven == truth and not unproven and sorted(map(repr, kept)) == sorted(map(repr, others))
        row.identical += identical
        row.reported += not identical and not found.lossless
        row.silent += not identical and found.lossless
    except GarbiError:
        row.seconds += time.process_time() - begin
        row.nothing += 1
    right_proven, right = (proven & truth).total(), ((proven + unproven) & truth).total()
    row.share_proven += right_proven / total
    row.share += right / total
    row.wrong_as_sound += (proven - truth).total()
    row.wrong_told += (unproven - truth).total()
    if other_program:
        theirs = rerun_contents(log, log.with_suffix(".rrd"))
        row.compared += 1
        row.share_compared += right / total
        row.rerun_nothing += theirs is None
        row.rerun_hung += theirs is HUNG
        right_theirs = ((theirs or Counter()) & truth).total()
        row.rerun_share += right_theirs / total
        row.rerun_wrong += ((theirs or Counter()) - truth).total()
        row.below += right < right_theirs
    return found


Rows = dict[str, dict[str, Row]]
"""compression -> kind of damage -> row"""


def measure(options: argparse.Namespace, scratch: Path, keep: Callable[[Rows], None]) -> Rows:
    """keep is given the rows so far, now and then."""
    rows: Rows = {}
    for name in options.only:
        sound = write_log(scratch / f"{name}.mcap", COMPRESSIONS[name])
        truth, _, others = contents(sound)
        log = scratch / "damaged.mcap"
        for number, (kind, data) in enumerate(damaged(sound.read_bytes(), options.share, options.kinds)):
            log.write_bytes(data)
            row = rows.setdefault(name, {}).setdefault(kind, Row())
            judge(row, log, truth, others, other_program=row.cases % options.rerun_every == 0)
            if number % 100 == 99:
                keep(rows)
    keep(rows)
    return rows


def table(rows: Rows) -> str:
    """Markdown: what garbi recover gives, then the other program beside it."""
    ours = [
        "cases",
        "identical",
        "reported",
        "silent",
        "nothing",
        "share_proven",
        "share",
        "wrong_as_sound",
        "wrong_told",
    ]
    theirs = ["compared", "share_compared", "rerun_share", "below", "rerun_wrong", "rerun_nothing", "rerun_hung"]
    return f"{_table(rows, ours)}\n{_table(rows, theirs)}"


def _table(rows: Rows, columns: list[str]) -> str:
    lines = [
        f"| log | damage | {' | '.join(HEADINGS[column] for column in columns)} |",
        "| --- " * (len(columns) + 2) + "|",
    ]
    for name, kinds in rows.items():
        for kind, row in kinds.items():
            values = (getattr(row, column) for column in columns)
            of = row.compared if "compared" in columns else row.cases
            cells = (f"{100 * v / max(of, 1):.2f} %" if isinstance(v, float) else str(v) for v in values)
            lines.append(f"| {name} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--share", type=float, default=1.0, help="share of the cases")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument(
        "--only", nargs="+", default=list(COMPRESSIONS), choices=list(COMPRESSIONS), help="compressions"
    )
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, help="of damage")
    parser.add_argument("--rerun-every", type=int, default=1, help="give rerun only every so many-th case")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    results = options.output / "recover.json"
    before = json.loads(results.read_text()) if results.exists() else {}

    def keep(found: Rows) -> None:
        earlier = {name: {kind: Row(**row) for kind, row in kinds.items()} for name, kinds in before.items()}
        rows = earlier | {name: earlier.get(name, {}) | kinds for name, kinds in found.items()}
        plain = {name: {kind: vars(row) for kind, row in kinds.items()} for name, kinds in rows.items()}
        results.write_text(json.dumps(plain, indent=2) + "\n")
        (options.output / "recover.md").write_text(f"# Damaged logs, recovered\n\n{table(rows)}")

    with tempfile.TemporaryDirectory() as scratch:
        print(table(measure(options, Path(scratch), keep)))


if __name__ == "__main__":
    main()
