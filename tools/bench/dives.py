"""A dive whose truth is known, made ready for benchmarks: from a folder with a log, or from a scenario without images."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from garbi_map.config import Config
from garbi_map.evaluate import Truth, read_truth
from garbi_map.log import Navigation
from garbi_map.navigate import NavigateSettings, Trajectory
from garbi_map.pipeline import open_dive, sweeps_of
from garbi_map.progress import Silent
from garbi_map.register import Scanner
from garbi_map.rig import Rig
from garbi_map.sweep import laser_angle, make_sweeps
from garbi_map.sweep.store import SweepStore
from tools.simulator.dive import Dive
from tools.simulator.record import TRUTH_RATE
from tools.simulator.scenario import Scenario
from tools.simulator.sensors import to_ns

SCENARIOS = Path(__file__).parent / "drift_scenarios.yaml"
SENSORS = ("imu", "dvl", "pressure", "fixes", "odometry")
REMOVED: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "DVL": ("dvl",),
    "attitude": ("attitude",),
    "pressure": ("pressure",),
    "all but rates and force": ("dvl", "pressure", "attitude"),
    "all but images and encoder": SENSORS,
}
"""What is taken away from a dive, under the name it has in the table."""


@dataclass(frozen=True)
class BenchDive:
    """Sweeps on disk, the scanner and the other sensors that made them, and the truth; length in seconds."""

    name: str
    store: SweepStore
    scanner: Scanner
    navigation: Navigation
    truth: Truth
    length: float

    def copied(self, folder: Path) -> SweepStore:
        """Sweeps of one's own: the registration corrects them for the encoder's latency where they lie."""
        store = SweepStore.open(Path(shutil.copytree(self.store.folder, folder)))
        assert store is not None
        return store

    def seen_by(self, rig: Rig, folder: Path) -> tuple[SweepStore, Scanner]:
        """The same stripes as another rig triangulates them, in a folder of their own, and that scanner."""
        store = SweepStore(folder)
        for sweep in self.store:
            u, v = self.scanner.rig.project(sweep.points).T
            store.add(replace(sweep, points=rig.triangulate(u, v, sweep.alpha[sweep.profile]).points))
        store.finish([])
        return store, replace(self.scanner, rig=rig)

    def without(self, removed: str, settings: NavigateSettings) -> tuple[Navigation, NavigateSettings]:
        """The measurements that are left, and settings that do not use the attitude where that is removed."""
        gone = REMOVED[removed]
        none: dict[str, Any] = {name: None for name in gone if name in SENSORS}
        left = replace(self.navigation, **none)
        return left, settings.model_copy(update={"use_attitude": "attitude" not in gone})


def shared_dives() -> list[Path]:
    """Folders of dives that come with their truth: `shared/data/dives` beside the checkout or beside its parent."""
    checkout = Path(__file__).resolve().parents[2]
    for place in (checkout.parent, checkout.parent.parent):
        found = sorted(path for path in (place / "shared/data/dives").glob("*/") if (path / "dive.mcap").exists())
        if found:
            return found
    return []


def scenarios() -> dict[str, Scenario]:
    """Our own, by name."""
    described: dict[str, Any] = yaml.safe_load(SCENARIOS.read_text())
    return {name: Scenario.model_validate(values) for name, values in described.items()}


def recorded(folder: Path, work: Path, config: Config) -> BenchDive:
    """The dive of a folder that holds dive.mcap and its truth; sweeps of an earlier run in `work` are used again."""
    dive = open_dive([folder / "dive.mcap"], config, None)
    store = sweeps_of(dive, work / folder.name, 2, Silent())
    length = (dive.log.end_ns - dive.log.begin_ns) * 1e-9
    scanner = Scanner(dive.rig, dive.angle, dive.navigation.mount("rig"))
    return BenchDive(folder.name, store, scanner, dive.navigation, read_truth([folder]), length)


def simulated(name: str, scenario: Scenario, work: Path, config: Config) -> BenchDive:
    """A scenario flown and cast without images; profiles of an earlier run in `work` are used again."""
    dive = Dive(scenario).fly()
    navigation = dive.navigation()
    made_of = f"{scenario.model_dump_json()} {config.sweep.model_dump_json()}"
    folder = work / f"{name}-{hashlib.sha256(made_of.encode()).hexdigest()[:12]}"
    store = SweepStore.open(folder)
    angle = laser_angle(navigation.encoder, dive.rig, config.sweep)
    if store is None:
        store = SweepStore(folder)
        for sweep in make_sweeps(dive.stripes(workers=0), dive.rig, angle, config.sweep):
            store.add(sweep)
        store.finish([])
    times = np.arange(0.0, scenario.duration, 1 / TRUTH_RATE)
    poses = dive.motion.at(times)
    trajectory = Trajectory(to_ns(times), poses.position, poses.rotation.as_quat(), np.zeros((len(times), 6, 6)))
    vertices, triangles = dive.scene.mesh
    truth = Truth(trajectory, (vertices, triangles.astype(np.int32)), dive.seen())
    scanner = Scanner(dive.rig, angle, navigation.mount("rig"))
    return BenchDive(name, store, scanner, navigation, truth, scenario.duration)
