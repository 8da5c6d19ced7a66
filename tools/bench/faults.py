"""`garbi map`'s registration on a dive whose sensors or clocks are made to fail, one fault at a time, beside the dive as
it is: how much the map suffers and what the report says of it.

    python -m tools.bench.faults DIVE_FOLDER [--fault NAME...] [--json FILE]

The folder holds dive.mcap and its truth, see tools.bench.map.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.log.records import Navigation
from garbi_map.navigate import navigate
from garbi_map.outputs import drift_notes
from garbi_map.register import register
from tools.bench.dives import recorded
from tools.bench.scores import Scorer

Fault = tuple[str, Callable[[Any], dict[str, NDArray[Any]]]]
"""A sensor of Navigation, and which columns of its record become what."""
BEGIN, LENGTH = 0.4, 0.15
"""Where in the dive a fault lies that does not last: share of its time."""


def during(record: Any) -> NDArray[np.bool_]:
    """Which of a sensor's stamps (n,) lie in the fault."""
    t = record.stamp_ns
    share = (t - t[0]) / (t[-1] - t[0])
    return np.asarray((share > BEGIN) & (share < BEGIN + LENGTH))


def late(seconds: float, sensor: str) -> Fault:
    """Stamps of a sensor that are late by so much."""
    return sensor, lambda record: {"stamp_ns": record.stamp_ns + round(seconds * 1e9)}


def silent(seconds: float, sensor: str) -> Fault:
    """A sensor that says nothing for so long."""

    def fault(record: Any) -> dict[str, NDArray[Any]]:
        t = (record.stamp_ns - record.stamp_ns[0]) * 1e-9
        keep = (t < BEGIN * t[-1]) | (t > BEGIN * t[-1] + seconds)
        return {name: column[keep] for name, column in vars(record).items()}

    return sensor, fault


def clipping(imu: Any) -> dict[str, NDArray[Any]]:
    """An IMU whose gyro ends at 60 % of what the dive holds, and whose accelerometer at 90 % of its samples."""
    most, strongest = 0.6 * np.abs(imu.rate).max(), np.quantile(np.abs(imu.specific_force).max(axis=1), 0.9)
    return {
        "rate": np.clip(imu.rate, -most, most),
        "specific_force": np.clip(imu.specific_force, -strongest, strongest),
    }


def no_lock(dvl: Any) -> dict[str, NDArray[Any]]:
    """A DVL that loses the bottom: invalid for a seventh of the dive."""
    return {"velocity": np.where(during(dvl)[:, None], np.nan, dvl.velocity)}


def water_lock(dvl: Any) -> dict[str, NDArray[Any]]:
    """A DVL that takes the water, which flows at 30 cm/s, for the bottom, and does not say so."""
    return {"velocity": dvl.velocity + np.where(during(dvl)[:, None], [0.2, 0.2, 0.05], 0.0)}


def outliers(dvl: Any) -> dict[str, NDArray[Any]]:
    """A DVL with one ping in seven off by up to 2 m/s."""
    random = np.random.default_rng(1)
    wrong = random.random((len(dvl.stamp_ns), 1)) < 1 / 7
    return {"velocity": dvl.velocity + wrong * random.uniform(-2, 2, dvl.velocity.shape)}


def iron(imu: Any) -> dict[str, NDArray[Any]]:
    """A compass 20 degrees off for a seventh of the dive."""
    turn = Rotation.from_euler("z", np.where(during(imu), np.radians(20.0), 0.0)[:, None])
    return {"attitude": (turn * Rotation.from_quat(imu.attitude)).as_quat()}


FAULTS: dict[str, Fault] = {
    "as it is": ("imu", lambda imu: {}),
    "IMU 50 ms late": late(0.05, "imu"),
    "IMU 50 ms early": late(-0.05, "imu"),
    "DVL 50 ms late": late(0.05, "dvl"),
    "pressure 50 ms late": late(0.05, "pressure"),
    "encoder 15 ms late": late(0.015, "encoder"),
    "IMU silent for 3 s": silent(3.0, "imu"),
    "DVL silent for 5 s": silent(5.0, "dvl"),
    "pressure silent for 5 s": silent(5.0, "pressure"),
    "encoder silent for 2 s": silent(2.0, "encoder"),
    "IMU at the end of its range": ("imu", clipping),
    "DVL without bottom lock": ("dvl", no_lock),
    "DVL locked to the water": ("dvl", water_lock),
    "DVL, 1 ping in 7 wrong": ("dvl", outliers),
    "compass 20 degrees off": ("imu", iron),
}


@dataclass(frozen=True)
class Row:
    """One line of the table: the fault, the map's errors, what the report says that it does not say of the dive as it is."""

    fault: str
    median_mm: float
    p95_mm: float
    ate_mm: float
    said: list[str]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fault", action="append", choices=list(FAULTS))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = [run(arguments.folder, name) for name in arguments.fault or FAULTS]
    table = Table(title=f"{arguments.folder.name}: cloud to true surface after one rigid alignment, mm")
    for head in ("fault", "median", "95 %", "ATE", "what the report says"):
        table.add_column(head, justify="right" if head in ("median", "95 %", "ATE") else "left")
    usual = set(rows[0].said) if rows[0].fault == "as it is" else set()
    for row in rows:
        said = "\n".join(line for line in row.said if row.fault == "as it is" or line not in usual)
        table.add_row(row.fault, f"{row.median_mm:.3f}", f"{row.p95_mm:.3f}", f"{row.ate_mm:.2f}", said)
    Console(width=180).print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps([row.__dict__ for row in rows], indent=1))


def run(folder: Path, name: str) -> Row:
    """One fault: from the sweeps to the trajectory, scored against the truth."""
    config = Config()
    with tempfile.TemporaryDirectory() as scratch:
        dive = recorded(folder, Path(scratch), config)
        log, store = spoilt(dive.navigation, FAULTS[name]), dive.copied(Path(scratch) / "own")
        navigated = navigate(log, config.navigate, store.stamps())
        made = register(store, log, navigated, config.registration, config.navigate, scanner=dive.scanner)
        score = Scorer(dive, config).score(made.trajectory, store=store)
        said = [*navigated.report["notes"], *drift_notes(made)]
    return Row(name, score.cloud.median_mm, score.cloud.p95_mm, score.ate_mm, said)


def spoilt(log: Navigation, fault: Fault) -> Navigation:
    """The navigation with the fault."""
    sensor, change = fault
    record = getattr(log, sensor)
    if record is None:
        sys.exit(f"the dive has no {sensor}")
    return replace(log, **{sensor: replace(record, **change(record))})


if __name__ == "__main__":
    main()
