"""What the recorder loses and costs: `python -m tools.bench.record` writes results/record.json and record.md.

The recorder runs in a process of its own; the senders (encoder and IMU, UDP on loopback, 100 Hz each) and whoever kills run
in others. The camera is a film that is played at its rate in a loop: Motion JPEG, which is stored as it comes, or raw
pixels, which are encoded. The CPU time is the recording process's own, all threads, after its begin.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import signal
import socket
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.record.disk import Target
from garbi_map.record.frames import frames_of
from garbi_map.record.lines import Kind, nmea
from garbi_map.record.ports import port_of
from garbi_map.record.recorder import Inputs, Recorder
from garbi_map.record.screen import Screen
from tools.bench.fuzz_lines import Fuzzed, fuzz

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
RESULTS = Path(__file__).parent / "results"
BEGIN = 2.0  # s that are left out of the CPU time
SENSORS: tuple[Kind, Kind] = ("encoder", "imu")


@dataclass(frozen=True)
class Kills:
    """Seconds of the newest message before the kill, by the topic that lost most."""

    kills: int
    unreadable: int
    median_lost_s: float
    largest_lost_s: float
    over_a_second: int


@dataclass(frozen=True)
class Load:
    """dropped: by the recorder; missing: images or readings that never came to it; cpu: share of one core."""

    camera: str
    rate: float
    seconds: float
    images: int
    image_kb: float
    readings: int
    dropped: int
    missing_readings: int
    cpu: float
    stalled_s: float
    largest_queue_mb: float


def main() -> int:
    """Run all three, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each load")
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--no-write", action="store_true")
    parser.add_argument("--lines", type=int, default=1_000_000, help="hostile lines for the parser")
    arguments = parser.parse_args()
    context = get_context("forkserver")
    context.set_forkserver_preload(["garbi_map.record.recorder", "garbi_map.record.screen", "cv2", "simplejpeg"])
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        films = {name: film(folder / f"{name}.avi", name) for name in ("motion jpeg", "raw pixels")}
        before = os.getloadavg()
        loads = [load(context, folder, name, films[name], 50.0, arguments.seconds) for name in films]
        loads.append(load(context, folder, "motion jpeg", films["motion jpeg"], 50.0, arguments.seconds, stall=2.0))
        kills = kill_often(context, folder, films["motion jpeg"], arguments.kills, arguments.seed)
        after = os.getloadavg()
    fuzzed = fuzz(arguments.lines)
    found = {
        "machine": {"cores": os.cpu_count(), "load_before": before, "load_after": after},
        "loads": [asdict(one) for one in loads],
        "kills": asdict(kills),
        "fuzzed": asdict(fuzzed),
    }
    text = table(loads, kills, fuzzed, before, after)
    print(text)
    if not arguments.no_write:
        (RESULTS / "record.json").write_text(json.dumps(found, indent=1) + "\n")
        (RESULTS / "record.md").write_text(text)
    return 0


def film(path: Path, kind: str, count: int = 100) -> Path:
    """The sample log's images, 768x576, as an AVI."""
    import cv2

    from garbi_map.stripe import decode

    if kind == "motion jpeg":
        writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (768, 576))
        writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 90)
    else:
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, 0, 50.0, (768, 576))
    rng = np.random.default_rng(4)
    for number, image in enumerate(open_log([SAMPLE]).images()):
        if number == count:
            break
        pixels = decode(image)
        noise = rng.normal(0, 4, pixels.shape)  # as a real sensor has it: the files are as large as a camera's
        writer.write(np.clip(pixels + noise, 0, 255).astype(np.uint8))
    writer.release()
    return path


def sent_line(kind: Kind, k: int) -> bytes:
    """The k-th reading at 100 Hz; its number is in it."""
    if kind == "encoder":
        return nmea(f"PGRB,ENC,{1 + k * 0.01:.2f},{k * 1e-4:.4f}")
    return nmea(f"PGRB,IMU,{1 + k * 0.01:.2f},{k * 1e-4:.4f},0,0,0,0,9.80665,0,0,0,1")


def send(ports: list[int], over: Any) -> None:
    """In a process of its own: both sensors at 100 Hz, until told."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    begin, k = time.monotonic(), 0
    while not over.wait(max(begin + k * 0.01 - time.monotonic(), 0.0)):
        for kind, port in zip(SENSORS, ports, strict=True):
            made.sendto(sent_line(kind, k), ("127.0.0.1", port))
        k += 1


@contextmanager
def sending(context: ForkServerContext) -> Iterator[list[int]]:
    """Ports that are sent to for the length of a block."""
    ports = []
    for _ in SENSORS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            ports.append(probe.getsockname()[1])
    over = context.Event()
    sender = context.Process(target=send, args=(ports, over), daemon=True)
    sender.start()
    try:
        yield ports
    finally:
        over.set()
        sender.join()


class Stalling(io.FileIO):
    """A disk that takes nothing from one moment to another, s of the monotonic clock."""

    def __init__(self, path: Path, begin: float, end: float) -> None:
        super().__init__(path, "wb")
        self._begin, self._end = begin, end

    def write(self, data: Any, /) -> int:
        now = time.monotonic()
        if self._begin <= now < self._end:
            time.sleep(self._end - now)
        return super().write(data)


def record(
    camera: Path, rate: float, ports: list[int], out: Path, seconds: float | None, stall: float, told: Any
) -> None:
    """In a process of its own; `told` gets what it cost."""
    opened = [(port_of(f"udp://127.0.0.1:{port}"), (kind,)) for port, kind in zip(ports, SENSORS, strict=True)]
    middle = time.monotonic() + BEGIN + 2.0
    target = Target(out, open_file=lambda path: io.BufferedWriter(Stalling(path, middle, middle + stall)))
    sys.stderr = io.StringIO()  # a terminal that nobody looks at
    with Screen(tty=True) as screen:
        recorder = Recorder(Inputs(frames_of(str(camera), rate, loop=True), opened), target, Config(), lambda _: None)
        cost: dict[str, float] = {}

        def measure() -> None:
            cost["cpu"], cost["at"] = time.process_time(), time.monotonic()

        timer = threading.Timer(BEGIN, measure)
        timer.start()
        done = recorder.run(seconds, screen.show)
    spent = (time.process_time() - cost["cpu"]) / (time.monotonic() - cost["at"]) if cost else 0.0
    told.put((done.counts, recorder.backlog.dropped.total(), spent, recorder.backlog.largest_bytes))


def load(
    context: ForkServerContext, folder: Path, name: str, camera: Path, rate: float, seconds: float, stall: float = 0.0
) -> Load:
    """One recording, whole, and what is in the log."""
    out, told = folder / "load.mcap", context.Queue()
    with sending(context) as ports:
        child = context.Process(target=record, args=(camera, rate, ports, out, seconds, stall, told))
        child.start()
        counts, dropped, cpu, queue = told.get()
        child.join()
    log = open_log([out])
    navigation = log.navigation()
    assert navigation.encoder is not None and navigation.imu is not None
    numbers = [np.round(navigation.encoder.angle * 1e4), np.round(navigation.imu.rate[:, 0] * 1e4)]
    missing = sum(int(found[-1] - found[0]) + 1 - len(found) for found in numbers)
    assert log.image_count == counts["camera"] - dropped
    readings = sum(map(len, numbers))
    size = statistics.mean(len(image.data) for image in log.images()) / 1e3
    out.unlink()
    return Load(name, rate, seconds, log.image_count, size, readings, dropped, missing, cpu, stall, queue / 1e6)


def kill_often(context: ForkServerContext, folder: Path, camera: Path, kills: int, seed: int) -> Kills:
    """Recordings at 25 images/s, each killed at a random moment of its first six seconds."""
    rng, lost, unreadable, told = random.Random(seed), list[float](), 0, context.Queue()
    with sending(context) as ports:
        for number in range(kills):
            out = folder / f"kill_{number}.mcap"
            child = context.Process(target=record, args=(camera, 25.0, ports, out, None, 0.0, told))
            child.start()
            while not out.exists() or out.stat().st_size < 1000:
                time.sleep(0.005)
            begun = time.time_ns()
            time.sleep(rng.uniform(0.3, 6.0))
            assert child.pid is not None
            os.kill(child.pid, signal.SIGKILL)
            killed = time.time_ns()
            child.join()
            try:
                lost.append((killed - oldest_end(out, begun)) * 1e-9)
            except Exception as error:
                unreadable += 1
                print(f"kill {number}: {type(error).__name__}: {error}", file=sys.stderr)
            out.unlink()
    return Kills(kills, unreadable, statistics.median(lost), max(lost), sum(one > 1.0 for one in lost))


def oldest_end(path: Path, begun: int) -> int:
    """Of images, encoder and IMU the newest message each; the oldest of these, arrival, ns; of what has none, the time at
    which the log was begun."""
    log = open_log([path])
    navigation = log.navigation()
    image = max((image.arrival_ns for image in log.images()), default=begun)
    sensors = [record for record in (navigation.encoder, navigation.imu) if record is not None]
    return min([image, *(int(one.arrival_ns.max()) for one in sensors), *([] if len(sensors) == 2 else [begun])])


def table(loads: list[Load], kills: Kills, fuzzed: Fuzzed, before: tuple[float, ...], after: tuple[float, ...]) -> str:
    """As Markdown."""
    rows = [
        "# What the recorder loses and costs",
        "",
        f"`python -m tools.bench.record` on {os.cpu_count()} cores that others use, too: load average {before[0]:.1f} "
        f"before, {after[0]:.1f} after. Images 768x576, encoder and IMU 100 Hz each over UDP. CPU is the recording "
        "process's, all threads; drawing the screen and judging an image, twice a second each, are included.",
        "",
        "| camera | images/s | recorded | dropped | readings missing | queue at most | CPU of one core |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for one in loads:
        stalled = f", disk stalls {one.stalled_s:g} s" if one.stalled_s else ""
        recorded = f"{one.images} images of {one.image_kb:.0f} kB, {one.readings} readings"
        rows.append(
            f"| {one.camera}{stalled} | {one.rate:g} | {recorded} | {one.dropped} | "
            f"{one.missing_readings} | {one.largest_queue_mb:.1f} MB | {100 * one.cpu:.1f} % |"
        )
    rows += [
        "",
        "| kill -9 while recording 25 images/s | |",
        "| --- | --- |",
        f"| kills at random moments | {kills.kills} |",
        f"| logs that cannot be read | {kills.unreadable} |",
        f"| lost before the kill, median / largest | {kills.median_lost_s:.2f} / {kills.largest_lost_s:.2f} s |",
        f"| more than a second | {kills.over_a_second} |",
        "",
        f"{fuzzed.inputs:,} hostile inputs to the parser of sensors' lines: {fuzzed.readings:,} readings, "
        f"{sum(fuzzed.refused.values()):,} lines refused for {len(fuzzed.refused)} reasons, {fuzzed.exceptions} other "
        f"exceptions, {fuzzed.gained_mb:.0f} MB of memory gained.",
    ]
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    sys.exit(main())
