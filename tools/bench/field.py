"""`garbi calibrate field` on dives whose truth is known, with rig files that are right and others that are not.

    python -m tools.bench.field [--dives NAMES] [--cases NAMES] [--keep DIR] [-o DIR]

A dive is one of shared/data/dives or one of field_scenarios.yaml, each of them flown with two seeds (quiet_1, quiet_2, ...).
A wrong rig sees what the right one saw: columns, rows and encoder counts stay, points are triangulated anew. Rows that the
results hold already are not made again, so that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from garbi_map.aside import write_text
from garbi_map.calibrate.field import Registration, find
from garbi_map.calibrate.field_evidence import SEEN, Finding
from garbi_map.calibrate.field_rig import RigUnknowns, unknowns
from garbi_map.calibrate.field_words import sentences
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.config import Config
from garbi_map.evaluate import TrueSurface, Truth, rigid_alignment
from garbi_map.navigate import navigate, place
from garbi_map.register import Registered, Scanner, register
from garbi_map.rig import Rig
from garbi_map.sweep import laser_angle
from garbi_map.sweep.store import SweepStore
from tools.bench.dives import BenchDive, recorded, shared_dives, simulated
from tools.bench.field_table import markdown
from tools.simulator.scenario import Scenario

SCENARIOS = Path(__file__).parent / "field_scenarios.yaml"
RESULTS = Path(__file__).parent / "results"
FIRST_SEED = 400
POINTS = 50_000
"""Of a map, evenly drawn, that are measured."""
DELTA, TILT, AXIS, LATE = np.deg2rad(0.3), np.deg2rad(0.2), 0.002, 0.015
WRONG: dict[str, dict[str, float]] = {
    "right": {},
    "delta": {"laser.delta": DELTA},
    "latency": {LATENCY: LATE},
    "theta": {"laser.theta": TILT},
    "gamma": {"laser.gamma": TILT},
    "axis": {"laser.x": -AXIS},
    "all": {
        "laser.delta": DELTA, "laser.theta": TILT, "laser.gamma": -TILT, "laser.x": AXIS, LATENCY: LATE,
    },
}  # fmt: skip
"""By how much the rig file is wrong, rad and m, and the encoder's stamps are late, s. The axis is off at right angles to the
baseline, whose length is the metric scale."""


@dataclass(frozen=True)
class Row:
    """One dive with one rig file. Maps: median cloud to true surface, mm, with the rig as given and as corrected, and with
    the right one. error: found less true, of parameters with all of them free, and sigma; corrected: as applied less true.
    told: how many parameters' worth the dive tells, k less the share of what the prior told already; nees: error squared
    over what the covariance expects, per parameter that it tells. why: the command's last sentence, on what was done.
    """

    dive: str
    case: str
    given_mm: float
    corrected_mm: float
    right_mm: float
    changed: list[str]
    offered: bool
    better: float
    held_out_mm: tuple[float, float]
    names: list[str]
    error: list[float]
    sigma: list[float]
    before: list[float]
    corrected: list[float]
    told: float
    nees: float
    why: str
    map_cpu_s: float
    field_cpu_s: float

    @property
    def seen(self) -> list[bool]:
        """Which parameters the dive tells of."""
        return [sigma < SEEN * before for sigma, before in zip(self.sigma, self.before, strict=True)]


def main() -> None:
    """Makes the rows that are missing and writes field.json and field.md after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dives", help="comma-separated; all by default")
    parser.add_argument("--cases", default=",".join(WRONG), help="comma-separated")
    parser.add_argument("--keep", type=Path, help="folder in which sweeps are kept, to be used again by a later run")
    parser.add_argument("-o", "--out", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    stored = arguments.out / "field.json"
    rows = [Row(**entry) for entry in json.loads(stored.read_text())] if stored.exists() else []
    own, given = scenarios(), {path.name: path for path in shared_dives()}
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.keep or Path(scratch)
        for name in arguments.dives.split(",") if arguments.dives else [*given, *own]:
            missing = [
                case for case in arguments.cases.split(",") if (name, case) not in {(r.dive, r.case) for r in rows}
            ]
            if not missing:
                continue
            config = Config()
            dive = recorded(given[name], work, config) if name in given else simulated(name, own[name], work, config)
            right = next((row.right_mm for row in rows if row.dive == name), None)
            for row in bench(dive, missing, right, Path(scratch)):
                rows.append(row)
                write_text(stored, json.dumps([asdict(row) for row in rows], indent=1) + "\n")
                write_text(arguments.out / "field.md", markdown(rows))
                print(
                    f"{row.dive} {row.case}: {row.given_mm:.3f} -> {row.corrected_mm:.3f} mm, right {row.right_mm:.3f};"
                    f" {', '.join(row.changed) or 'nothing'}; {row.better:.1f}; NEES {row.nees:.2f}",
                    flush=True,
                )


def scenarios() -> dict[str, Scenario]:
    """Each kind with two seeds of its own."""
    kinds = yaml.safe_load(SCENARIOS.read_text())
    return {
        f"{kind}_{number}": Scenario.model_validate(values | {"seed": FIRST_SEED + 2 * place + number})
        for number in (1, 2)
        for place, (kind, values) in enumerate(kinds.items())
    }


def bench(dive: BenchDive, cases: list[str], right: float | None, work: Path) -> Iterator[Row]:
    """One dive with each rig file; right: what its map is with the right one, mm, if that is known."""
    for case in cases:
        wrong = with_wrong_rig(dive, WRONG[case], work / "wrong")
        begin = time.process_time()
        placed = registered(wrong)
        between = time.process_time()
        found, _ = find(placed, unknowns(wrong.scanner.rig, motor=len(wrong.scanner.angle.turns_ns) > 0))
        end = time.process_time()
        given = _map_error(dive.truth, placed)
        if right is None:
            truth = with_wrong_rig(dive, {}, work / "right")
            right = given if case == "right" else _map_error(dive.truth, registered(truth))
        corrected = given
        if found.offered:
            after = with_rig(wrong, found.unknowns.at(found.applied), 0.0, work / "after")
            corrected = _map_error(dive.truth, registered(after))
        yield _row(dive.name, case, (given, corrected, right), found, (between - begin, end - between))


def _row(dive: str, case: str, maps: tuple[float, float, float], found: Finding, cpu: tuple[float, float]) -> Row:
    unknown = found.unknowns
    true = true_corrections(unknown, case)
    error = found.estimate - true
    applied = np.array([found.corrections.get(name, 0.0) for name in unknown.names])
    # what a prior tells is true by the benchmark's making, for most of the parameters are not wrong at all
    told = len(error) - float(np.trace(np.linalg.solve(unknown.root @ unknown.root.T, found.covariance)))
    return Row(
        dive,
        case,
        *maps,
        [name for name, changed in zip(unknown.names, found.changed, strict=True) if changed],
        found.offered,
        found.better,
        (1e3 * found.held_out[0], 1e3 * found.held_out[1]),
        list(unknown.names),
        error.tolist(),
        found.sigma.tolist(),
        unknown.sigma.tolist(),
        (applied - true).tolist(),
        told,
        float(error @ np.linalg.solve(found.covariance, error)) / told,
        sentences(found)[-1],
        *cpu,
    )


def true_corrections(unknown: RigUnknowns, case: str) -> np.ndarray:
    """(k,) what would set the rig file right; a latency is told as it is."""
    wrong = WRONG[case]
    return np.array([wrong.get(name, 0.0) * (1.0 if name == LATENCY else -1.0) for name in unknown.names])


def with_wrong_rig(dive: BenchDive, wrong: dict[str, float], folder: Path) -> BenchDive:
    """The same dive with something added to the parameters of its rig file, and the encoder's stamps late."""
    rig = unknowns(dive.scanner.rig, motor=True).changed(wrong)
    return with_rig(dive, rig, wrong.get(LATENCY, 0.0), folder)


def with_rig(dive: BenchDive, rig: Rig, late: float, folder: Path) -> BenchDive:
    """The same dive with another rig file, its encoder's stamps later by so many s."""
    navigation = dive.navigation
    if navigation.encoder is not None and late:
        moved = navigation.encoder.stamp_ns + round(late * 1e9)
        navigation = replace(navigation, encoder=replace(navigation.encoder, stamp_ns=moved))
    angle = laser_angle(navigation.encoder, rig, Config().sweep)
    shutil.rmtree(folder, ignore_errors=True)
    store = SweepStore(folder)
    for sweep in dive.store:
        u = dive.scanner.rig.project(sweep.points)[:, 0]
        alpha, _ = angle.at(sweep.stamp_ns)
        alpha = np.where(np.isfinite(alpha), alpha, sweep.alpha)
        points = rig.triangulate(u, sweep.row, alpha[sweep.profile]).points
        seen = np.isfinite(points).all(axis=1)
        arrays = {name: getattr(sweep, name)[seen] for name in ("sigma", "intensity", "profile", "row")}
        store.add(replace(sweep, alpha=alpha, points=points[seen], **arrays))
    store.finish([])
    return replace(dive, store=store, scanner=Scanner(rig, angle, dive.scanner.mount), navigation=navigation)


def registered(dive: BenchDive) -> Registration:
    """The dive's sweeps placed as `garbi map` places them; those on disk are corrected for a latency that it finds."""
    config = Config()
    navigated = navigate(dive.navigation, config.navigate, dive.store.stamps())
    settings = config.registration
    found: Registered = register(
        dive.store, dive.navigation, navigated, settings, config.navigate, scanner=dive.scanner
    )
    rig, angle = dive.scanner.rig, dive.scanner.angle
    return Registration(dive.store, dive.navigation, navigated, found, rig, angle, settings, config.navigate)


def _map_error(truth: Truth, placed: Registration) -> float:
    """Median distance of points as they are placed from the true surface, mm, after one rigid alignment."""
    assert truth.trajectory is not None and truth.surface is not None
    made, mount = placed.registered.trajectory, placed.log.mount("rig")
    stride = -(-sum(entry.points for entry in placed.store.entries) // POINTS)
    points = np.concatenate([place(one, made.at(one.stamp_ns).mounted(mount))[::stride] for one in placed.store])
    stamps = placed.store.stamps()
    stamps = stamps[(stamps >= truth.trajectory.stamp_ns[0]) & (stamps <= truth.trajectory.stamp_ns[-1])]
    rotation, shift = rigid_alignment(made.at(stamps), truth.trajectory.at(stamps))
    surface = TrueSurface(*truth.surface)
    return surface.errors(surface.aligned(rotation.apply(points) + shift), truth.seen).median_mm


if __name__ == "__main__":
    main()
