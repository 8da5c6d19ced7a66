"""Navigation, registration and seabed of a survey of any length: time, memory and accuracy, stage by stage.

    python -m tools.bench.survey [MINUTES...] [--navigation-only] [--keep DIR] [-o FILE.json]

The lanes of 30 m^2 are flown again and again, so that the area stops growing after ten minutes and the time does not.
Profiles are cast without images. The stages run in a process of their own, one after the other as in `garbi map`.
"""

from __future__ import annotations

import argparse
import json
import pickle
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from garbi_map.config import Config
from garbi_map.export import CloudWriter
from garbi_map.log import Navigation
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import register
from garbi_map.seabed import AcceptedPoints, build_seabed
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore
from tools.bench.dives import simulated
from tools.bench.drift_table import with_band
from tools.bench.scores import Score, Scorer, thinning
from tools.simulator.dive import Dive
from tools.simulator.scenario import Route, Scenario, Seabed, Sway, Water

SURVEY = Scenario(
    title="lanes of 6 m over 30 m^2, flown again and again in waves and a current",
    seed=201,
    route=Route(kind="lawnmower", length=6.0, spacing=0.45, lanes=12, speed=0.14),
    sway=Sway(translation=0.03, rotation=0.025, period=4.5),
    water=Water(current=(0.01, 0.01), current_sigma=0.01),
    seabed=Seabed(pipe_radius=0.05),
)


@dataclass(frozen=True)
class Stage:
    """CPU seconds of all threads, and the largest resident memory while it ran, MB."""

    name: str
    cpu_s: float
    peak_mb: float


@dataclass(frozen=True)
class Survey:
    """What one length gave; begin_mb: resident before the first stage."""

    minutes: float
    sweeps: int
    points: int
    begin_mb: float
    stages: list[Stage]
    of_recording: float
    score: Score | None = None
    floor: Score | None = None


def main() -> int:
    """Print a line for each length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("minutes", nargs="*", type=float, default=[2.0, 10.0, 30.0])
    parser.add_argument("--navigation-only", action="store_true", help="no profiles: what the filter costs")
    parser.add_argument("--unscored", action="store_true", help="time and memory only")
    parser.add_argument("--keep", type=Path, help="folder in which profiles are kept, to be used again by a later run")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        for minutes in arguments.minutes:
            scenario = SURVEY.model_copy(update={"duration": 60.0 * minutes})
            if arguments.navigation_only:
                survey = filtered(minutes, Dive(scenario).fly().navigation())
            else:
                survey = surveyed(minutes, scenario, arguments.keep or Path(scratch), not arguments.unscored)
            found.append(survey)
            show(survey)
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(survey) for survey in found], indent=1) + "\n")
    return 0


def filtered(minutes: float, navigation: Navigation) -> Survey:
    """The navigation stage alone."""
    with tempfile.TemporaryDirectory() as scratch:
        handed = Path(scratch) / "navigation.pickle"
        handed.write_bytes(pickle.dumps(navigation))
        begin_mb, stages = _in_a_process(handed, None, Path(scratch))
    return Survey(minutes, 0, 0, begin_mb, stages, sum(stage.cpu_s for stage in stages) / (60.0 * minutes))


def surveyed(minutes: float, scenario: Scenario, work: Path, scored: bool) -> Survey:
    """All stages, and what came out against the truth and against the map of the true poses."""
    dive = simulated("survey", scenario, work, Config())
    with tempfile.TemporaryDirectory() as scratch:
        handed = Path(scratch) / "navigation.pickle"
        handed.write_bytes(pickle.dumps(dive.navigation))
        begin_mb, stages = _in_a_process(handed, dive.store.folder, Path(scratch))
        share = sum(stage.cpu_s for stage in stages) / dive.length
        points = sum(entry.points for entry in dive.store.entries)
        survey = Survey(minutes, len(dive.store), points, begin_mb, stages, share)
        if not scored:
            return survey
        with np.load(Path(scratch) / "found.npz") as file:
            made = Trajectory(*(file[name] for name in ("stamp_ns", "position", "quaternion", "covariance")))
            cloud = file["cloud"]
    scorer = Scorer(dive, Config())
    return replace(survey, score=scorer.score(made, made, cloud), floor=scorer.floor())


def _in_a_process(handed: Path, sweeps: Path | None, out: Path) -> tuple[float, list[Stage]]:
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(run_stages, handed, sweeps, out).result()


def run_stages(handed: Path, sweeps: Path | None, out: Path) -> tuple[float, list[Stage]]:
    """The stages of pipeline.py that come after the sweeps; compiled code is loaded before the first is measured."""
    config, stages = Config(), []

    @contextmanager
    def measured(name: str) -> Iterator[None]:
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        begin = time.process_time()
        yield
        stage = Stage(name, time.process_time() - begin, _resident_mb("VmHWM"))
        print(f"  {name}: {stage.cpu_s:.1f} s CPU, peak {stage.peak_mb:.0f} MB", flush=True)
        stages.append(stage)

    log: Navigation = pickle.loads(handed.read_bytes())
    store = None if sweeps is None else SweepStore.open(sweeps)
    begin_mb = _resident_mb("VmRSS")
    with measured("navigation"):
        navigated = navigate(log, config.navigate, None if store is None else store.stamps())
    if store is None:
        return begin_mb, stages
    with measured("registration"):
        registered = register(store, log, navigated, config.registration, config.navigate)
    inside, mount, filled = registered.inside, log.mount("rig"), store

    def posed() -> Iterator[tuple[Sweep, Trajectory]]:
        for sweep in filled:
            yield sweep, inside.at(sweep.stamp_ns).mounted(mount)

    thinned, stride = [], thinning(store)
    with measured("seabed"), CloudWriter(out / "cloud.laz", config.export.cloud_scale) as cloud:

        def take(accepted: AcceptedPoints) -> None:
            cloud.write(accepted)
            thinned.append(accepted.points[::stride].astype(np.float32))  # for the score alone

        build_seabed(posed, config.seabed, mount, take)
    np.savez(
        out / "found.npz", stamp_ns=inside.stamp_ns, position=inside.position, quaternion=inside.quaternion,
        covariance=inside.covariance, cloud=np.concatenate(thinned).astype(np.float64),
    )  # fmt: skip
    return begin_mb, stages


def _resident_mb(what: str) -> float:
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(what))
    return int(line.split()[1]) / 1024


def show(survey: Survey) -> None:
    """One length."""
    print(
        f"{survey.minutes:g} min, {survey.sweeps} sweeps, {survey.points / 1e6:.1f} M points, "
        f"{survey.begin_mb:.0f} MB before; all {survey.of_recording:.3f} of the recording"
    )
    for name, score in (("this map", survey.score), ("true poses", survey.floor)):
        if score is not None:
            cloud = score.cloud
            print(
                f"  {name}: {cloud.median_mm:.3f} / {cloud.p95_mm:.3f} mm, beyond 10 mm {cloud.beyond10_percent:.3f} %, "
                f"complete {cloud.complete_percent:.1f} %, ATE {score.ate_mm:.2f} mm, NEES position "
                f"{with_band(score.position)} attitude {with_band(score.attitude)}"
            )
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
