"""Further dives over one site, other motion and drift, five stones moved and one added: how well they lie on the first."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.config import Config
from garbi_map.db import Database, StoredSubmap, join_map, laid, write_poses
from garbi_map.dive import Dive
from garbi_map.estimate import Estimate, judged_of, registered_of, trajectory_file
from garbi_map.navigate import Trajectory
from garbi_map.navigate.kernels import place_points
from garbi_map.pipeline import stored
from garbi_map.progress import Silent
from garbi_map.sweep import laser_angle, make_sweeps
from garbi_map.sweep.store import SweepStore
from tools.simulator import shapes
from tools.simulator.dive import Dive as Simulated
from tools.simulator.scenario import Route, Scenario, Seabed, Sway, Water
from tools.simulator.seabed import Scene
from tools.simulator.sensors import to_ns

Floats = NDArray[np.float64]

SITE = Scenario(
    title="a site that is visited again",
    duration=40.0,
    seed=301,
    route=Route(kind="lawnmower", length=2.0, spacing=0.5, lanes=2, speed=0.14),
    sway=Sway(translation=0.03, rotation=0.025, period=4.5),
    water=Water(current=(0.01, 0.015), current_sigma=0.01),
    seabed=Seabed(pipe_radius=0.05, block=True, margin=1.8),
)
MOVED = (0.03, 0.05, 0.08, 0.12, 0.20)
"""m, by which stones are moved between the dives."""


@dataclass(frozen=True)
class Visit:
    """A dive as its log would tell it, its sweeps on disk, and its true motion."""

    dive: Dive
    store: SweepStore
    truth: Trajectory


def together(work: Path, count: int) -> dict[str, Any]:
    """Dives of the site one after the other into one map; the first one's frame against each later one's."""
    config = Config()
    variants = visits(count or 4)
    alike: dict[str, Any] = {}
    first: tuple[Visit, Estimate] | None = None
    with Database(work / "db") as database:
        for name, (simulated, title) in variants.items():
            visit = visited(name, simulated, work, config)
            begin = time.process_time()
            made = estimated(visit, database.folder, work)
            spent = time.process_time() - begin
            join_map(database, stored(visit.dive, made), made.judged.submaps, config.database.place)
            laid = time.process_time() - begin - spent
            first = first or (visit, made)
            lie = [as_laid(*one, database.dive(one[0].dive.recording).submaps) for one in (first, (visit, made))]
            whole, each = (1e3 * error for error in apart(*lie))
            alike[name] = {
                "what": title,
                "as_a_whole_median_mm": round(float(np.median(whole)), 3),
                "each_point_median_mm": round(float(np.median(each)), 3),
                "each_point_p95_mm": round(float(np.percentile(each, 95)), 3),
                "estimate_cpu_s": round(spent, 1),
                "placing_cpu_s": round(laid, 1),
                **database.catalogue.provenance()[-1][2],
            }
            print(name, alike[name], flush=True)
    return alike


def visits(count: int) -> dict[str, tuple[Simulated, str]]:
    """The site before and after things moved, by vehicles that go other ways."""
    first = Simulated(SITE).fly()
    rng = np.random.default_rng(7)
    places = first.reference.position[rng.integers(0, len(first.reference.position), 6)] + rng.uniform(
        -0.4, 0.4, (6, 2)
    )
    stones = [shapes.stone(0.05, np.random.default_rng([9, k])) for k in range(6)]
    heading = rng.uniform(0, 2 * np.pi, 5)
    shift = np.array(MOVED)[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])

    def scene(at: Floats) -> Scene:
        meshes = [shapes.moved(stones[k], np.array([*place, 0.0])) for k, place in enumerate(at)]
        return Scene(shapes.merged([first.scene.mesh, *meshes]), first.scene.texture)

    before, after = scene(places[:5]), scene(np.vstack([places[:5] + shift, places[5:]]))
    routes = {
        "again": (SITE.route, "other seed, five stones moved by 3 to 20 cm and one added"),
        "across": (SITE.route.model_copy(update={"heading": np.pi / 2, "length": 1.2}), "the same, lanes across"),
        "aside": (SITE.route.model_copy(update={"centre": (0.6, 0.5)}), "the same, 0.8 m aside"),
        "without DVL": (SITE.route, "the same way, no DVL"),
    }
    first.scene = before
    out = {"first": (first, "the first dive; its frame is the map's")}
    for k, (name, (route, title)) in enumerate(list(routes.items())[:count]):
        update: dict[str, Any] = {"seed": 302 + k, "route": route}
        if name == "without DVL":
            update["sensors"] = SITE.sensors.model_copy(update={"dvl": False})
        other = Simulated(SITE.model_copy(update=update)).fly()
        other.scene, other.rig = after, first.rig
        out[name] = (other, title)
    return out


def visited(name: str, simulated: Simulated, work: Path, config: Config) -> Visit:
    """Profiles are cast without images."""
    navigation = simulated.navigation()
    dive = Dive([Path(name)], config, _NoLog(), simulated.rig, navigation)  # type: ignore[arg-type]
    dive.__dict__["recording"] = name
    store = SweepStore(work / f"{name} cast")
    angle = laser_angle(navigation.encoder, dive.rig, config.sweep)
    for sweep in make_sweeps(simulated.stripes(workers=0), dive.rig, angle, config.sweep):
        store.add(sweep)
    store.finish([])
    times = np.arange(0.0, simulated.scenario.duration, 0.01)
    poses = simulated.motion.at(times)
    truth = Trajectory(to_ns(times), poses.position, poses.rotation.as_quat(), np.zeros((len(times), 6, 6)))
    return Visit(dive, store, truth)


def estimated(visit: Visit, database: Path, work: Path) -> Estimate:
    """What `garbi map` makes of the sweeps of a dive."""
    dive, folder = visit.dive, work / visit.dive.recording
    store, navigated, registered = registered_of(dive, visit.store, folder, Silent())
    judged = judged_of(dive, store, registered.inside, database, folder, Silent())
    write_poses(database / trajectory_file(dive), registered.trajectory)
    return Estimate(store, navigated, registered, judged)


def as_laid(visit: Visit, made: Estimate, submaps: Sequence[StoredSubmap]) -> tuple[Floats, Floats]:
    """Some points (n, 3) of a dive as they lie in the map, and (n, 3) where they truly were."""
    mount = visit.dive.navigation.mount("rig")
    pairs = []
    for trajectory in (laid(made.registered.trajectory, submaps), visit.truth):
        own = []
        for sweep in made.store:
            poses = trajectory.at(sweep.stamp_ns).mounted(mount)
            own.append(place_points(sweep.points, sweep.profile, poses.rotation.as_matrix(), poses.position)[::10])
        pairs.append(np.concatenate(own))
    return pairs[0], pairs[1]


def apart(first: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """How far (n,) m the points of a dive are from where the first dive's map has that ground, as a whole and each.

    The motion that lays a dive's points on their truth is known from the true poses, without any registration between
    dives; those of two dives would be one if they were laid on each other without error. Each point by itself has besides
    what the dive bends, and its own noise.
    """
    (turn, shift), (own_turn, own_shift) = rigid(*first), rigid(*other)
    points, true = other
    whole = turn.inv().apply(own_turn.apply(points) + own_shift - shift) - points
    each = turn.inv().apply(true - shift) - points
    return np.linalg.norm(whole, axis=1), np.linalg.norm(each, axis=1)


class _NoLog:
    losses: ClassVar[list[str]] = []


def rigid(source: Floats, target: Floats) -> tuple[Rotation, Floats]:
    """The motion that lays points (n, 3) on their counterparts, robust to a few per cent that are wrong."""
    keep = np.ones(len(source), bool)
    for _ in range(5):
        a, b = source[keep].mean(axis=0), target[keep].mean(axis=0)
        turn, _ = Rotation.align_vectors(target[keep] - b, source[keep] - a)
        shift = b - turn.apply(a)
        error = np.linalg.norm(turn.apply(source) + shift - target, axis=1)
        keep = error < 3 * np.median(error)
    return turn, shift
