"""`garbi map` on dives whose truth is known, beside other ways to place the same sweeps, all in one run.

    python -m tools.bench.map [DIVE_FOLDER...] [--without dvl] [--only-this] [--json FILE]

A dive's folder holds dive.mcap, truth_trajectory.tum, truth_seabed.ply and truth_seen.npy. By default the folders beside
this checkout, shared/data/dives/*.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from garbi_map.config import load_config
from garbi_map.dive import Dive
from garbi_map.evaluate import CloudErrors, Truth, compare_cloud, evaluate, read_truth, rigid_alignment
from garbi_map.navigate import Trajectory, navigate
from garbi_map.pipeline import open_dive, sweeps_of
from garbi_map.progress import Silent
from garbi_map.sweep.store import SweepStore
from tools.bench.baselines import gicp, placed, stock_kiss_icp

_NOTHING = {"dvl": "", "pressure": "", "imu": "", "navsat": "", "usbl": "", "odometry": ""}
WITHOUT: dict[str, dict[str, Any]] = {
    "": {},
    "dvl": {"log": {"topics": {"dvl": ""}}},
    "dvl, pressure, attitude": {
        "log": {"topics": {"dvl": "", "pressure": ""}},
        "navigate": {"use_attitude": False},
    },
    "all but images": {"log": {"topics": _NOTHING}},
}


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    dive: str
    without: str
    method: str
    cloud: CloudErrors
    ate_mm: float
    seconds: float | None = None
    of_recording: float | None = None
    peak_mb: float | None = None


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--without", action="append", choices=list(WITHOUT), help="also without these sensors")
    parser.add_argument("--only-this", action="store_true", help="leave the other methods out")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    folders = arguments.folders or sorted((Path(__file__).resolve().parents[3] / "shared/data/dives").glob("*/"))
    if not folders:
        sys.exit("no dives: name folders that hold dive.mcap and its truth")
    rows: list[Row] = []
    for folder in folders:
        for without in ["", *(arguments.without or [])]:
            rows += bench(folder, without, arguments.only_this)
    show(rows)
    if arguments.json:
        arguments.json.write_text(json.dumps([{**row.__dict__, "cloud": row.cloud.__dict__} for row in rows], indent=1))


def bench(folder: Path, without: str, only_this: bool) -> list[Row]:
    """All methods on one dive; `garbi map` as a process of its own, start-up and every output included."""
    truth = read_truth([folder])
    with tempfile.TemporaryDirectory() as scratch:
        config = Path(scratch) / "config.yaml"
        config.write_text(yaml.safe_dump(WITHOUT[without]))
        dive = open_dive([folder / "dive.mcap"], load_config(config), None)
        length = (dive.log.end_ns - dive.log.begin_ns) * 1e-9
        made, seconds, peak = run_map(folder / "dive.mcap", Path(scratch) / "map", config)
        found = evaluate(made, truth)
        assert found.cloud is not None and found.trajectory is not None
        ate = found.trajectory.ate_rmse_mm
        rows = [Row(folder.name, without, "this map", found.cloud, ate, seconds, seconds / length, peak)]
        if not only_this:
            store = sweeps_of(dive, Path(scratch) / "sweeps", 2, Silent())
            rows += others(folder.name, without, dive, store, truth)
    return rows


def run_map(log: Path, out: Path, config: Path) -> tuple[Path, float, float]:
    """`garbi map` in a process: folder, seconds, peak memory MB."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "garbi_map", "map", str(log), "-o", str(out), "--config", str(config)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - begin
    return out, seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def others(name: str, without: str, dive: Dive, store: SweepStore, truth: Truth) -> list[Row]:
    """The baselines, with the same stripes and angles."""
    assert truth.trajectory is not None
    mount = dive.navigation.mount("rig")
    dead_reckoning = navigate(dive.navigation, dive.config.navigate, store.stamps()).trajectory
    ways = {
        "dead reckoning": dead_reckoning,
        "stock kiss-icp": stock_kiss_icp(store, mount),
        "GICP per sweep": gicp(store, dead_reckoning, mount),
        "true poses": truth.trajectory,
    }
    return [score(name, without, way, store, trajectory, dive, truth) for way, trajectory in ways.items()]


def score(
    name: str, without: str, way: str, store: SweepStore, trajectory: Trajectory, dive: Dive, truth: Truth
) -> Row:
    """All points of the store by a trajectory, against the truth."""
    assert truth.trajectory is not None and truth.surface is not None
    stamps = store.stamps()
    true = truth.trajectory
    stamps = stamps[(stamps >= true.stamp_ns[0]) & (stamps <= true.stamp_ns[-1])]
    made = trajectory.at(stamps)
    rotation, shift = rigid_alignment(made, true.at(stamps))
    off = true.at(stamps).position - rotation.apply(made.position) - shift
    points = rotation.apply(placed(store, trajectory, dive.navigation.mount("rig"))) + shift
    cloud = compare_cloud(points, *truth.surface, truth.seen)
    return Row(name, without, way, cloud, 1e3 * float(np.sqrt((off**2).sum(axis=1).mean())))


def show(rows: list[Row]) -> None:
    """The table; the ratio is to the true poses' median of the same dive."""
    table = Table(title="cloud to true surface after one rigid alignment, mm")
    for head in ("dive", "without", "method", "median", "95 %", "> 10 mm, %", "complete, %", "ratio", "ATE"):
        table.add_column(head, justify="left" if head in ("dive", "without", "method") else "right")
    for head in ("seconds", "of recording", "peak MB"):
        table.add_column(head, justify="right")
    floor = {row.dive: row.cloud.median_mm for row in rows if row.method == "true poses"}
    for row in rows:
        cloud = row.cloud
        ratio = f"{cloud.median_mm / floor[row.dive]:.2f}" if row.dive in floor else ""
        extra = ["", "", ""]
        if row.seconds is not None and row.of_recording is not None and row.peak_mb is not None:
            extra = [f"{row.seconds:.1f}", f"{row.of_recording:.2f}", f"{row.peak_mb:.0f}"]
        figures = [f"{cloud.median_mm:.3f}", f"{cloud.p95_mm:.3f}", f"{cloud.beyond10_percent:.3f}"]
        complete = "" if cloud.complete_percent is None else f"{cloud.complete_percent:.2f}"
        table.add_row(row.dive, row.without, row.method, *figures, complete, ratio, f"{row.ate_mm:.2f}", *extra)
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
