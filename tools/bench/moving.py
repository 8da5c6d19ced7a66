"""How much of what moves is taken out of the map, and how much of the seabed with it.

    python -m tools.bench.moving [--seeds N] [--keep DIR] [-o FILE.json]

scenarios/moving.yaml (a fish under the vehicle, a swinging cable) and a harder one, cast without images, placed by their
own registration. Beside each: what thin support alone removes, without looking at what was seen through or floats.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from garbi_map.config import Config
from garbi_map.navigate import navigate
from garbi_map.register import register
from garbi_map.seabed import SeabedBuilder, SeabedSettings, Verdict
from garbi_map.seabed.builder import Posed
from tools.bench.dives import simulated
from tools.simulator.dive import Dive
from tools.simulator.movers import moved
from tools.simulator.scenario import Mover, Scenario, load_scenario

SCENARIO = Path(__file__).resolve().parents[1] / "simulator/scenarios/moving.yaml"
HARDER = (
    Mover(kind="fish", size=0.15, start=(-0.6, 0.1, 0.1), velocity=(0.03, 0.01, 0.0), swing=0.03, period=3.0),
    Mover(kind="fish", size=0.3, start=(0.5, -0.3, 0.25), velocity=(-0.05, 0.02, 0.0), swing=0.1, period=4.0),
    Mover(kind="cable", size=0.5, start=(0.0, 0.3, 0.3), swing=0.05, period=7.0),
    Mover(kind="cable", size=0.4, start=(0.3, -0.2, 0.24), swing=0.2, period=3.0),
)
"""Slow and near the ground, two swinging cables, the lower one 4 cm above it at its lowest."""


@dataclass(frozen=True)
class Result:
    """Of one dive: how many points are on movers, per cent of those and of the seabed's that were left out."""

    dive: str
    movers: int
    movers_removed: float
    seabed_removed: float
    movers_removed_before: float
    """by thin support alone"""
    seabed_removed_before: float
    seen_again: float
    """per cent of the movers' points whose place was seen through at least once; nothing tells of the others"""
    seen_again_removed: float
    """per cent of those that were left out"""


def main() -> int:
    """Print a line for each dive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder in which profiles are kept")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    plain = load_scenario(SCENARIO)
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(arguments.seeds):
            for name, movers in (("moving", plain.movers), ("harder", HARDER)):
                scenario = plain.model_copy(update={"seed": plain.seed + 100 * seed, "movers": movers})
                results.append(bench(f"{name}-{seed}", scenario, arguments.keep or Path(scratch)))
                print(results[-1], flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


def bench(name: str, scenario: Scenario, work: Path) -> Result:
    """One dive, judged with and without what was seen through."""
    config = Config()
    dive = simulated(name, scenario, work, config)
    flown = Dive(scenario).fly()
    truth = [moved(flown, sweep) for sweep in dive.store]
    mover, still = (np.concatenate(part) for part in zip(*truth, strict=True))
    with tempfile.TemporaryDirectory() as scratch:
        store = dive.copied(Path(scratch) / "sweeps")
        navigated = navigate(dive.navigation, config.navigate, store.stamps())
        inside = register(
            store, dive.navigation, navigated, config.registration, config.navigate, scanner=dive.scanner
        ).inside
        mount = dive.navigation.mount("rig")
        posed = [(sweep, inside.at(sweep.stamp_ns).mounted(mount)) for sweep in store]
    eyes = dive.scanner.rig.eyes
    now = _removed(SeabedBuilder(config.seabed, mount, eyes), posed)
    blind = config.seabed.outliers.model_copy(update={"max_through": 1.0, "body": 1e-6})
    before = _removed(SeabedBuilder(SeabedSettings(outliers=blind), mount, eyes), posed)
    any_ray = config.seabed.outliers.model_copy(
        update={"max_through": 1e-6, "beam": 0.008, "thin_beam": 0.008, "every": 1, "body": 1e-6}
    )
    again = _removed(SeabedBuilder(SeabedSettings(outliers=any_ray), mount, eyes), posed)[mover]
    share = [round(100 * float(gone[mask].mean()), 3) for gone in (now, before) for mask in (mover, still)]
    seen = [100 * float(again.mean()), 100 * float(now[mover][again].mean())]
    return Result(name, int(mover.sum()), *share, *(round(value, 3) for value in seen))


def _removed(builder: SeabedBuilder, posed: list[Posed]) -> np.ndarray:
    """(n,) whether a point was left out."""
    for sweep in posed:
        builder.observe(*sweep)
    for sweep in posed:
        builder.see_through(*sweep)
    return np.concatenate([builder.add(*sweep).verdict for sweep in posed]) != Verdict.ACCEPTED


if __name__ == "__main__":
    raise SystemExit(main())
