"""python -m tools.trials avoidance --seeds 300: closed-loop trials in parallel, a table, results beside the benchmarks."""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from tools.trials.avoidance import KINDS, Outcome
from tools.trials.few import FEW, few
from tools.trials.jobs import avoid

CONTROLLERS = ("garbi", "omniscient", "none", "potential", "stop")


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.trials", description=__doc__)
    parser.add_argument("what", choices=["avoidance", *FEW])
    parser.add_argument("--seeds", type=int, default=300, help="number of trials")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--controllers", nargs="+", default=list(CONTROLLERS), choices=CONTROLLERS)
    parser.add_argument("--level", choices=["profiles", "images"], default="profiles")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, help="results, JSON")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    if arguments.what != "avoidance":
        return few(arguments.what, seeds, arguments.workers, arguments.output)
    jobs = [(seed, controller, arguments.level) for controller in arguments.controllers for seed in seeds]
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(arguments.workers, get_context("spawn")) as pool:
        for outcome in pool.map(avoid, jobs):
            outcomes.append(outcome)
            print(
                f"{outcome.controller:10} {outcome.seed:4} {outcome.kind:9} "
                f"{'COLLIDED' if outcome.collided else 'reached' if outcome.reached else 'not reached':12}"
                f"{outcome.gap:6.2f} m {outcome.seconds:6.1f} s",
                flush=True,
            )
    print(table(outcomes))
    if arguments.output:
        arguments.output.write_text(json.dumps([one.as_dict() for one in outcomes], indent=0) + "\n")
    return 0


def table(outcomes: list[Outcome]) -> str:
    """Collisions that the omniscient controller avoids, and goals reached of those it reaches, by kind and controller."""
    known = {one.seed: one for one in outcomes if one.controller == "omniscient"}
    groups: dict[tuple[str, str], list[Outcome]] = defaultdict(list)
    for one in outcomes:
        groups[one.controller, one.kind].append(one)
        groups[one.controller, "all"].append(one)
    lines = ["controller  kind       trials  collided  avoidable  feasible  reached of feasible"]
    for controller in CONTROLLERS:
        for kind in (*KINDS, "all"):
            group = groups.get((controller, kind))
            if not group:
                continue
            collided = [one for one in group if one.collided]
            avoidable = [one for one in collided if one.seed in known and not known[one.seed].collided]
            feasible = [one for one in group if one.seed in known and known[one.seed].reached]
            reached = sum(one.reached for one in feasible)
            share = f"{reached} ({100 * reached / len(feasible):.0f} %)" if feasible else "-"
            lines.append(
                f"{controller:11} {kind:9} {len(group):7} {len(collided):9} {len(avoidable):10} {len(feasible):9}  {share}"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
