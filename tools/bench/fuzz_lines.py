"""Hostile lines for the recorder's parser: sound ones with bytes changed, cut, doubled and joined, and plain noise."""

from __future__ import annotations

import random
import resource
import time
from collections import Counter
from dataclasses import dataclass

from garbi_map.record.lines import LONGEST, BadLine, LineSplitter, nmea, parse_line

SOUND = [
    nmea("PGRB,ENC,12.3456,0.349066"),
    nmea("PGRB,IMU,12.35,0.01,-0.02,0.03,0.1,0.2,9.81,0,0,0,1"),
    nmea("PGRB,PRS,,151325.0"),
    nmea("PGRB,DVL,1,0.1,0.2,0.3,0.0001"),
    nmea("YXXDR,A,-12.5,D,LASER,P,1.5,B,DEPTH"),
    b":BI,  100, -200,   50,    3,A\r\n",
    b"wrz,0.120,-0.400,2.000,y,1.30,1.855,1e-07;0;1.4;0;1.2;0;0.2;0;1e+09,7,14,123.00,1*50\r\n",
    b'{"sensor": "imu", "time": 12.35, "rate": [0, 0, 0.01], "force": [0, 0, 9.81], "attitude": [0, 0, 0, 1]}\n',
    b'{"sensor": "dvl", "velocity": null}\n',
]
TELLING = [b"*", b",", b"$", b"{", b"[", b'"', b"nan", b"1e999", b"-", b"\x00", b"\xff", b"\n", b"9" * 400, b"[" * 400]


@dataclass(frozen=True)
class Fuzzed:
    """inputs, the readings that came out, lines refused by reason, other exceptions, MB of memory gained, lines a second."""

    inputs: int
    readings: int
    refused: dict[str, int]
    exceptions: int
    gained_mb: float
    per_second: float


def fuzz(count: int, seed: int = 1) -> Fuzzed:
    """Changed inputs, each through the splitter and the parser as a port hands it over."""
    rng, splitter = random.Random(seed), LineSplitter()
    refused: Counter[str] = Counter()
    readings = exceptions = 0
    before, begin = _resident_mb(), time.process_time()
    for _ in range(count):
        for line in splitter.split(_hostile(rng)):
            try:
                readings += len(parse_line(line))
            except BadLine as reason:
                refused[str(reason)] += 1
            except Exception as error:
                exceptions += 1
                print(f"{type(error).__name__}: {error}: {line!r}")
    spent = time.process_time() - begin
    return Fuzzed(count, readings, dict(refused.most_common()), exceptions, _resident_mb() - before, count / spent)


def _hostile(rng: random.Random) -> bytes:
    if rng.random() < 0.1:
        return rng.randbytes(rng.randrange(2 * LONGEST))
    data = bytearray(rng.choice(SOUND))
    for _ in range(rng.randrange(4)):
        at = rng.randrange(len(data) + 1)
        what = rng.randrange(4)
        if what == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif what == 1:
            data[at : at + rng.randrange(8)] = b""
        elif what == 2:
            data[at:at] = rng.choice(TELLING)
        else:
            data[at:at] = rng.choice(SOUND)[: rng.randrange(60)]
    if data.startswith(b"$") and rng.random() < 0.5:  # past the checksum
        body = bytes(data).strip(b"$\r\n").rpartition(b"*")[0].decode("ascii", "replace")
        if body.isascii():
            return nmea(body)
    return bytes(data)


def _resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
