"""python -m tools.simulator SCENARIO.yaml -o DIVE.mcap: simulate a dive; the truth goes into the log's folder."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from garbi_map.errors import GarbiError
from tools.simulator.dive import Dive
from tools.simulator.record import write_log, write_truth
from tools.simulator.scenario import load_scenario


def main() -> int:
    """The command line; exit status 1 and one line where the scenario is unusable."""
    parser = argparse.ArgumentParser(prog="python -m tools.simulator", description=__doc__)
    parser.add_argument("scenario", type=Path, help="YAML file; scenarios/ beside this program holds some")
    parser.add_argument("-o", "--output", type=Path, required=True, help="log to write, .mcap")
    parser.add_argument("--seed", type=int, help="instead of the scenario's")
    parser.add_argument("--workers", type=int, default=min(os.cpu_count() or 1, 8), help="processes that render")
    parser.add_argument("--no-truth", action="store_true", help="do not write truth_* and rig.yaml beside the log")
    arguments = parser.parse_args()
    if arguments.seed is not None and arguments.seed < 0:
        parser.error("--seed must not be negative")
    try:
        scenario = load_scenario(arguments.scenario)
        if arguments.seed is not None:
            scenario = scenario.model_copy(update={"seed": arguments.seed})
        dive = Dive(scenario).fly()
        rate = write_log(dive, arguments.output, arguments.workers, _tell if sys.stderr.isatty() else None)
        if not arguments.no_truth:
            write_truth(dive, arguments.output.parent)
    except GarbiError as error:
        print(f"simulator: {error}", file=sys.stderr)
        return 1
    count = len(dive.exposures)
    size = arguments.output.stat().st_size / 1e6
    print(f"{arguments.output}: {count} images, {size:.1f} MB; rendered at {rate:.1f} images/s")
    return 0


def _tell(done: int, total: int) -> None:
    print(f"\r{done}/{total} images", end="\n" if done == total else "", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
