"""How long `garbi view LOG` takes from the command to a picture of the log, and how much memory, beside Rerun's own
loader of MCAP (`rerun LOG`), in turn:

    python -m tools.bench.first_picture [--log LOG] [--rounds 5] [--seconds 30] [-o tools/bench/results/first_picture.json]

Both draw into a window on a screen that is not there (Debian's `xvfb`), with the processor where there is no graphics card;
the picture is there when the window shows the laser's green. LOG: made where it is missing, 2 GB of the sample dive.
CPU seconds are those of the process that reads the log, without the viewer's; memory is the most that it held resident.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from garbi_map.view.viewer import viewer_binary
from tools.bench.long_log import write_long

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
PATIENCE = 120.0  # s
LASER = 30  # pixels of the laser's green in a picture of 640 that are a stripe


@contextmanager
def screen() -> Iterator[str]:
    """The name of a display that nobody looks at. Raises FileNotFoundError where there is no Xvfb."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1000x24", "-nolisten", "tcp"]
    process = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            yield f":{answer.readline().strip()}"
    finally:
        process.terminate()
        process.wait()


def shows_laser(client: Any) -> bool:
    """Whether the window shows something as green as the laser."""
    try:
        shot = client.take_screenshot(max_size=640)
    except (TimeoutError, ConnectionError):  # it is busy
        return False
    picture = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return int(((green > 90) & (green > 2 * blue) & (2 * green > 3 * red)).sum()) > LASER


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def port_of(pid: int) -> int | None:
    """Where the viewer listens that a process is, or has started; None where there is none yet."""
    for one in (str(pid), *Path(f"/proc/{pid}/task/{pid}/children").read_text().split()):
        words = Path(f"/proc/{one}/cmdline").read_text().split("\0")
        if "--port" in words:
            return int(words[words.index("--port") + 1])
    return None


def connected(pid: int) -> Any:
    """The viewer of a process that has just been started, when it answers."""
    from rerun.experimental import ViewerClient

    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        port = port_of(pid)
        try:
            if port is not None:
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                return ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
        except OSError:
            pass
        time.sleep(0.02)
    raise TimeoutError("the viewer does not answer")


def used(pid: int) -> tuple[float, float]:
    """CPU seconds, and the most memory that a process held, MB."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), int(status["VmHWM"].split()[0]) / 1024


def measured(command: list[str], display: str, seconds: float) -> dict[str, float]:
    """What a command costs until its window shows the laser, and the memory `seconds` later."""
    quiet = {**os.environ, "DISPLAY": display, "RERUN_ANALYTICS": "0", "RUST_LOG": "error"}
    begin = time.monotonic()
    process = subprocess.Popen(
        command, env=quiet, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        client = connected(process.pid)
        while not shows_laser(client):
            if time.monotonic() - begin > PATIENCE:
                raise TimeoutError(f"{' '.join(command)}: no picture")
        took = time.monotonic() - begin
        cpu, memory = used(process.pid)
        time.sleep(seconds)
        later = used(process.pid)[1]
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()
    return {"seconds": took, "cpu_seconds": cpu, "memory_mb": memory, "memory_later_mb": later}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--seconds", type=float, default=30.0, help="after the picture, until memory is looked at again"
    )
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        log = options.log or Path(folder) / "long.mcap"
        if not log.exists():
            write_long(SAMPLE, log, hours=500 / 3600, gigabytes=2.0, images_every=0.05)
        commands = {
            "garbi view": [sys.executable, "-m", "garbi_map", "view", str(log)],
            "rerun": [str(viewer_binary()), "--port", str(free_port()), str(log)],
        }
        rounds: dict[str, list[dict[str, float]]] = {name: [] for name in commands}
        with screen() as display:
            for _ in range(options.rounds):
                for name, command in commands.items():
                    rounds[name].append(measured(command, display, options.seconds))
                    print(name, {key: round(value, 2) for key, value in rounds[name][-1].items()}, flush=True)
        size = log.stat().st_size
    found = {
        name: {key: round(statistics.median(one[key] for one in all_of), 2) for key in all_of[0]}
        for name, all_of in rounds.items()
    }
    text = json.dumps({"log_bytes": size, "rounds": options.rounds, "median": found}, indent=2)
    print(text)
    if options.output:
        options.output.write_text(text + "\n")


if __name__ == "__main__":
    main()
