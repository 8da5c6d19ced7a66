"""The drift estimate on dives whose truth is known, beside other ways to place the same sweeps, all in one table.

    python -m tools.bench.drift [DIVE...] [--without SENSORS]... [--only-this] [--keep DIR] [-o DIR]

A DIVE is a scenario of drift_scenarios.yaml, or a folder (by its path, or one of those in shared/data/dives by its name)
that holds dive.mcap, truth_trajectory.tum, truth_seabed.ply and truth_seen.npy; by default all of both. Stripes, angles
and the seabed stage are the same for all ways; only the trajectory differs.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from garbi_map.aside import write_text
from garbi_map.config import Config
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import register
from tools.bench.baselines import gicp_pose_graph, kiss_icp, stock_kiss_icp
from tools.bench.dives import REMOVED, BenchDive, recorded, scenarios, shared_dives, simulated
from tools.bench.drift_table import columns, markdown
from tools.bench.scores import Score, Scorer

RESULTS = Path(__file__).parent / "results"
BESIDE = ("nothing", "DVL")
"""What may be removed for the other ways to be tried too; for the rest there is dead reckoning."""


@dataclass(frozen=True)
class Row:
    """One line of the table. cpu_s: of navigation and registration together, this process, all its threads."""

    dive: str
    without: str
    method: str
    score: Score
    ratio: float
    cpu_s: float
    length_s: float


def main() -> int:
    """Print the table and write it to drift.json and drift.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dives", nargs="*", help="names of scenarios or dives, or folders")
    parser.add_argument("--without", action="append", choices=list(REMOVED), help="only with these sensors removed")
    parser.add_argument("--only-this", action="store_true", help="leave the other methods out")
    parser.add_argument("--keep", type=Path, help="folder in which sweeps are kept, to be used again by a later run")
    parser.add_argument("-o", "--out", type=Path, help="folder of the results; the project's own if everything is run")
    arguments = parser.parse_args()
    out = arguments.out
    if out is None and not (arguments.dives or arguments.without or arguments.only_this):
        out = RESULTS
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for make in chosen(arguments.dives, arguments.keep or Path(scratch)):
            dive = make(config=Config())
            for row in bench(dive, arguments.without or list(REMOVED), arguments.only_this):
                rows.append(row)
                print("  ".join(columns(row)), flush=True)
            if out is not None:  # after each dive: all of them take an hour
                write(out, rows)
    if out is None:
        print(markdown(rows))
    return 0


def write(out: Path, rows: list[Row]) -> None:
    """drift.json and drift.md."""
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "drift.md", markdown(rows))
    write_text(out / "drift.json", json.dumps([asdict(row) for row in rows], indent=1) + "\n")


def chosen(names: list[str], work: Path) -> Iterator[Callable[..., BenchDive]]:
    """What makes the dives of these names, or all there are."""
    own, given = scenarios(), {path.name: path for path in shared_dives()}
    for name in names or [*given, *own]:
        if name in own:
            yield partial(simulated, name, own[name], work)
        elif name in given or (Path(name) / "dive.mcap").exists():
            yield partial(recorded, given.get(name, Path(name)), work)
        else:
            sys.exit(f"{name}: neither a folder with dive.mcap nor one of {', '.join([*given, *own])}")


def bench(dive: BenchDive, removals: list[str], only_this: bool) -> Iterator[Row]:
    """All methods on one dive."""
    config = Config()
    scorer = Scorer(dive, config)
    mount = dive.navigation.mount("rig")
    floor = scorer.floor()

    def row(without: str, method: str, score: Score, begin: float) -> Row:
        ratio = score.cloud.median_mm / floor.cloud.median_mm
        return Row(dive.name, without, method, score, ratio, begin, dive.length)

    yield row("", "true poses", floor, 0.0)
    if not only_this:
        begin = time.process_time()
        made = stock_kiss_icp(dive.store, mount)
        yield row("", "stock kiss-icp", scorer.score(made), time.process_time() - begin)
    for without in removals:
        left, settings = dive.without(without, config.navigate)
        begin = time.process_time()
        navigated = navigate(left, settings, dive.store.stamps())
        took = time.process_time() - begin
        if not only_this:
            prior = navigated.trajectory
            yield row(without, "dead reckoning", scorer.score(prior), took)
            ways: dict[str, Callable[..., Trajectory]] = {
                "kiss-icp, our de-skew": kiss_icp,
                "GICP + pose graph": gicp_pose_graph,
            }
            for method, way in ways.items() if without in BESIDE else ():
                begin = time.process_time()
                made = way(dive.store, prior, mount)
                yield row(without, method, scorer.score(made), took + time.process_time() - begin)
        ours = (
            {"this map": False, "this map, live": True} if without in BESIDE and not only_this else {"this map": False}
        )
        for method, live in ours.items():
            chosen_settings = config.registration.model_copy(update={"live": live})
            with tempfile.TemporaryDirectory() as scratch:
                store = dive.copied(Path(scratch) / "sweeps")
                begin = time.process_time()
                found = register(store, left, navigated, chosen_settings, settings, scanner=dive.scanner)
                spent = took + time.process_time() - begin
                yield row(without, method, scorer.score(found.trajectory, found.inside, store=store), spent)


if __name__ == "__main__":
    sys.exit(main())
