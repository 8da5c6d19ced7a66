"""python -m tools.trials avoidance --seeds 300 -o results: closed-loop trials in parallel; CSV, table and bars in a folder.

`--log SEED` flies one trial again and leaves it as a log that opens in Rerun and replays."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from tools.trials.avoidance import Outcome, fly, save
from tools.trials.few import FEW, few
from tools.trials.jobs import avoid
from tools.trials.sources import fingerprint
from tools.trials.table import CONTROLLERS, append, draw, read, table


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.trials", description=__doc__)
    parser.add_argument("what", choices=["avoidance", *FEW])
    parser.add_argument("--seeds", type=int, default=300, help="number of trials")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--controllers", nargs="+", default=list(CONTROLLERS), choices=CONTROLLERS)
    parser.add_argument("--level", choices=["profiles", "images"], default="profiles")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--log", type=int, help="fly this seed with the first controller and write trial_SEED.mcap")
    parser.add_argument("-o", "--output", type=Path, help="folder of the results (hold, survey: JSON file)")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    if arguments.what != "avoidance":
        return few(arguments.what, seeds, arguments.workers, arguments.output)
    folder = arguments.output or Path.cwd()
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.log is not None:
        flight = fly(arguments.log, arguments.controllers[0], arguments.level)
        save(flight, folder / f"trial_{arguments.log}.mcap")
        print(told(flight.outcome))
        return 0
    return _many(arguments, folder)


def _many(arguments: argparse.Namespace, folder: Path) -> int:
    """All that the folder does not hold yet, flown with these very sources."""
    kept = folder / "avoidance.csv"
    done = (
        {(one.seed, one.controller) for one in read(kept) if one.sources == fingerprint()} if kept.exists() else set()
    )
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    jobs = [
        (seed, controller, arguments.level)
        for seed in seeds
        for controller in arguments.controllers
        if (seed, controller) not in done
    ]
    for outcome in _outcomes(jobs, arguments.workers):
        append(kept, outcome)
        print(told(outcome), flush=True)
    outcomes = read(kept)
    print(table(outcomes))
    (folder / "avoidance.md").write_text(table(outcomes) + "\n")
    draw(outcomes, folder / "avoidance.svg")
    return 0


def _outcomes(jobs: list[tuple[int, str, str]], workers: int) -> Iterator[Outcome]:
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(avoid, jobs)


def told(one: Outcome) -> str:
    """In one line."""
    became = "COLLIDED" if one.collided else "reached" if one.reached else "not reached"
    return f"{one.controller:10} {one.seed:4} {one.kind:9} {became:12}{one.gap:6.2f} m {one.seconds:6.1f} s"


if __name__ == "__main__":
    sys.exit(main())
