"""By how much `--view` slows `garbi map` and `garbi replay`: each with and without, in turn, until its output is there.

    python -m tools.bench.live_view [--log logs/sample.mcap] [--rounds 3] [-o tools/bench/results/live_view.json]

The viewer draws on a screen that is not there (Debian's `xvfb`), with the processor where there is no graphics card, which
wall time shows; CPU seconds are those of garbi without its viewer.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tools.bench.first_picture import SAMPLE, screen, used

PATIENCE = 1800.0  # s


def measured(command: list[str], output: Path, display: str) -> tuple[float, float]:
    """Wall and CPU seconds of a command until its output is there."""
    quiet = {**os.environ, "DISPLAY": display, "RERUN_ANALYTICS": "0", "RUST_LOG": "off"}
    begin = time.monotonic()
    process = subprocess.Popen(
        command, env=quiet, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    cpu = 0.0
    try:
        while not output.exists():
            if process.poll() is not None or time.monotonic() - begin > PATIENCE:
                raise RuntimeError(f"{' '.join(command)}: no {output.name}")
            cpu = used(process.pid)[0]
            time.sleep(0.02)
        return time.monotonic() - begin, cpu
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.wait()


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=Path, default=SAMPLE)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    garbi = [sys.executable, "-m", "garbi_map"]
    found: dict[str, dict[str, list[float]]] = {}
    with screen() as display, tempfile.TemporaryDirectory() as scratch:
        for turn in range(options.rounds):
            for view in (False, True) if turn % 2 == 0 else (True, False):
                folder = Path(scratch) / f"{turn}{view}"
                works = {
                    "map": (["map", str(options.log), "-o", str(folder)], folder / "report.html"),
                    "replay": (["replay", str(options.log), "-o", f"{folder}.mcap"], Path(f"{folder}.mcap")),
                }
                for name, (words, output) in works.items():
                    wall, cpu = measured([*garbi, *words, *(["--view"] if view else [])], output, display)
                    of = found.setdefault(name + (" --view" if view else ""), {"wall": [], "cpu": []})
                    of["wall"].append(round(wall, 2))
                    of["cpu"].append(round(cpu, 2))
                    print(name, "--view" if view else "", f"{wall:.1f} s, {cpu:.1f} s CPU", flush=True)
    slower = {
        name: {
            kind: round(statistics.median(found[f"{name} --view"][kind]) / statistics.median(found[name][kind]) - 1, 3)
            for kind in ("wall", "cpu")
        }
        for name in ("map", "replay")
    }
    text = json.dumps({"log": options.log.name, "seconds": found, "slower": slower}, indent=2)
    print(text)
    if options.output:
        options.output.write_text(text + "\n")


if __name__ == "__main__":
    main()
