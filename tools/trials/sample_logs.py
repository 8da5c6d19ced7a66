"""python -m tools.trials.sample_logs: make the logs of the behaviours under logs/ again, each with what is expected of it.

The vehicle is flown by a script, not by the behaviours: a log stays the same when they change.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tools.simulator.record import write_log
from tools.simulator.scenario import Mover
from tools.simulator.vehicle import Command
from tools.trials.scenario import DOWNWARD, FORWARD, open_water
from tools.trials.world import Block, Rod, World

PERIOD = 0.1
SMALL = {"width": 384, "height": 288, "rate": 12.5, "quality": 85}  # a quarter of the pixels, half the images


@dataclass(frozen=True)
class Sample:
    """A log: what is there, how the vehicle is flown (a speed over time), and the plan that the log carries."""

    world: World
    rig: dict[str, Any]
    focal: float
    seconds: float
    surge: Callable[[float], float]
    plan: str


SAMPLES = {
    "wall": Sample(
        World([Block((3.4, 0.0, 1.2), (0.1, 2.5, 1.6), 0.1)]),
        FORWARD,
        280.0,
        30.0,
        lambda t: 0.14 if t < 14.0 else 0.0 if t < 20.0 else -0.12,
        """\
behaviours: {avoidance: {notice: 1.6, full: 1.05}}
expectations:
- stops: {within: 0.6, distance: 1.0}
- holds: {share: 0.9, distance: 1.0}
- away: {share: 0.9, distance: 0.8}
""",
    ),
    "crossing": Sample(
        World([], (Mover(kind="sphere", size=0.4, start=(1.75, 3.6, 1.1), velocity=(0.0, -0.15, 0.0)),)),
        FORWARD,
        280.0,
        40.0,
        lambda t: 0.0,
        """\
behaviours: {avoidance: {notice: 1.6, full: 1.25}}
expectations:
- stops: {within: 0.6, distance: 1.2}
- says: {text: something moving}
- resumes: {within: 8.0, distance: 1.2}
""",
    ),
    "pipe": Sample(
        World([Rod((2.35, -3.0, 1.05), (2.35, 3.0, 1.15), 0.15, "pipe")]),
        FORWARD,
        280.0,
        24.0,
        lambda t: 0.03 * float(np.sin(0.4 * t)),
        """\
behaviours: {travel: null, hold: {target: cylinder, range: 1.5}}
expectations:
- target: {share: 0.9, between: [8, 24]}
""",
    ),
    "survey_leg": Sample(
        World([]),
        DOWNWARD,
        400.0,
        24.0,
        lambda t: 0.12,
        """\
behaviours: {prior: {free_above: 0.4, speed: 0.1}}
expectations:
- false_stops: {most: 0.05}
- says: {text: the rig does not see ahead}
""",
    ),
}


def make(name: str, path: Path, seed: int = 7) -> None:
    """Fly it and write the log."""
    sample = SAMPLES[name]
    camera = {**sample.rig.get("camera", {}), **SMALL, "focal": sample.focal}
    rig = {**sample.rig, "camera": camera}
    scenario = open_water(seed, rig, duration=sample.seconds, water={"snow": 300.0})
    dive = sample.world.make(scenario)
    while dive.vehicle.time < sample.seconds + 0.6:
        depth = float(np.clip(0.5 * (scenario.altitude - dive.vehicle.position[2]), -0.1, 0.1))
        yaw = float(np.clip(-0.6 * dive.vehicle.attitude.as_euler("ZYX")[0], -0.2, 0.2))
        dive.step(Command(sample.surge(dive.vehicle.time), depth, yaw, 0.0), PERIOD)
    write_log(dive, path, workers=0, metadata={"garbi.expectations": {"yaml": sample.plan}}, truth=False)


def main() -> int:
    """All of them, or those that are named."""
    folder = Path(__file__).resolve().parents[2] / "logs"
    for name in sys.argv[1:] or SAMPLES:
        path = folder / f"behaviour_{name}.mcap"
        make(name, path)
        print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
