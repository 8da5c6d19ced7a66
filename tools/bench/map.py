"""`garbi map` as a user runs it, a process of its own, on dives whose truth is known: accuracy, time and memory.

    python -m tools.bench.map [DIVE_FOLDER...] [--without SENSORS]... [--json FILE]

A dive's folder holds dive.mcap, truth_trajectory.tum, truth_seabed.ply and truth_seen.npy; by default the folders in
shared/data/dives beside this checkout or its parent. Other ways to place the same sweeps: tools.bench.drift.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml
from rich.console import Console
from rich.table import Table

from garbi_map.evaluate import CloudErrors, evaluate, read_truth
from garbi_map.log import open_log
from tools.bench.dives import REMOVED, shared_dives


@dataclass(frozen=True)
class Row:
    """One line of the table; seconds from start to end, images decoded and every file written."""

    dive: str
    without: str
    cloud: CloudErrors
    ate_mm: float
    seconds: float
    of_recording: float
    peak_mb: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--without", action="append", choices=list(REMOVED), help="also without these sensors")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    folders = arguments.folders or shared_dives()
    if not folders:
        sys.exit("no dives: name folders that hold dive.mcap and its truth")
    removals = ["nothing", *(arguments.without or [])]
    rows = [bench(folder, without) for folder in folders for without in removals]
    show(rows)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


def bench(folder: Path, without: str) -> Row:
    """The map of one dive against its truth."""
    log = folder / "dive.mcap"
    with tempfile.TemporaryDirectory() as scratch:
        config = Path(scratch) / "config.yaml"
        config.write_text(yaml.safe_dump(config_without(without)))
        begin = time.perf_counter()
        command = [sys.executable, "-m", "garbi_map", "map", str(log), "-o", f"{scratch}/map", "--config", str(config)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - begin
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        found = evaluate(Path(scratch) / "map", read_truth([folder]))
    assert found.cloud is not None and found.trajectory is not None
    recording = open_log([log])
    length = (recording.end_ns - recording.begin_ns) * 1e-9
    return Row(folder.name, without, found.cloud, found.trajectory.ate_rmse_mm, seconds, seconds / length, peak)


def config_without(removed: str) -> dict[str, object]:
    """A configuration that does not read what is removed."""
    topics = {"fixes": ("navsat", "usbl")}
    gone = [topic for name in REMOVED[removed] for topic in topics.get(name, (name,)) if name != "attitude"]
    return {
        "log": {"topics": dict.fromkeys(gone, "")},
        "navigate": {"use_attitude": "attitude" not in REMOVED[removed]},
    }


def show(rows: list[Row]) -> None:
    """The table."""
    table = Table(title="garbi map: cloud to true surface after one rigid alignment, mm")
    for head in ("dive", "without"):
        table.add_column(head)
    for head in ("median", "95 %", "> 10 mm, %", "complete, %", "ATE", "seconds", "of recording", "peak MB"):
        table.add_column(head, justify="right")
    for row in rows:
        cloud = row.cloud
        complete = "" if cloud.complete_percent is None else f"{cloud.complete_percent:.2f}"
        table.add_row(
            row.dive, row.without, f"{cloud.median_mm:.3f}", f"{cloud.p95_mm:.3f}", f"{cloud.beyond10_percent:.3f}",
            complete, f"{row.ate_mm:.2f}", f"{row.seconds:.1f}", f"{row.of_recording:.2f}", f"{row.peak_mb:.0f}",
        )  # fmt: skip
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
