"""The register room's whole job: neighbours in time, then sweeps against the map, then everything at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from garbi_map.errors import GarbiError
from garbi_map.log.records import Mount, Navigation
from garbi_map.navigate import NavigationResult, Trajectory
from garbi_map.navigate import navigate as run_navigation
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.register.agreement import Agreement, compare_placements
from garbi_map.register.constants import learnt
from garbi_map.register.drift import Round
from garbi_map.register.front_end import close_loops, scan_to_map
from garbi_map.register.live import LiveDrift
from garbi_map.register.pose_graph import optimise
from garbi_map.register.scanner import ENCODER, Scanner
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import RegisterSettings
from garbi_map.register.surfels import Surfels
from garbi_map.register.timing import Offset, judged, refined, restamped
from garbi_map.register.windows import Path, Solution, solve_far, solve_near
from garbi_map.sweep.store import SweepStore
from garbi_map.words import many

Floats = NDArray[np.float64]

_ATTEMPTS = 4
"""At setting clocks right: what is left after two is less than what can be seen."""
_NEIGHBOUR = np.array([0.004, 0.004, 0.004, 0.002, 0.002, 0.002])
"""How much the drift changes between neighbouring sweeps after the near rounds, 1 sigma, m and rad."""


@dataclass(frozen=True)
class Registered:
    """The trajectory after drift correction, and what was found on the way.

    trajectory   map <- base_link at 50 Hz and at every profile; covariance against the map's origin and north
    inside       the same poses with the covariance inside the map: what no rigid motion of the map can remove
    rounds       what each round of the drift estimate found, per window, the far rounds after the near ones
    graph_step   (k,) m, how far the pose graph moved each sweep
    loops        number of loop closures that were verified
    looped       the two sweeps of each
    agreement    how well overlapping sweeps agree with the navigation filter's trajectory and with ours
    constants    what was learnt of the sensors, with units in the names
    clocks       by how much the stamps of sensors and encoder differ from the camera's
    rig_notes    what the sweeps say against the rig, one line each; None where they were not asked
    """

    trajectory: Trajectory
    inside: Trajectory
    rounds: list[list[Round]]
    graph_step: Floats
    loops: int
    agreement: Agreement
    constants: dict[str, Any]
    clocks: list[Offset] = field(default_factory=list)
    looped: list[tuple[int, int]] = field(default_factory=list)
    rig_notes: list[str] | None = None


def register(
    store: SweepStore,
    log: Navigation,
    navigated: NavigationResult,
    settings: RegisterSettings,
    navigate: NavigateSettings,
    progress: Callable[[str], None] = lambda _: None,
    scanner: Scanner | None = None,
) -> Registered:
    """One consistent trajectory for all sweeps of a store.

    The result begins where the navigation filter's trajectory begins. Where the encoder's stamps turn out to be late
    against the images' (which the scanner has to be known for), the sweeps of the store are corrected.
    Raises GarbiError where the sweeps do not span any time.
    """
    mount = log.mount("rig")
    stamps = store.stamps()
    if len(stamps) < 2 or stamps[-1] <= stamps[0]:
        raise GarbiError(
            f"registration: the sweeps hold {many(len(stamps), 'profile')}, too few for a trajectory; "
            "see what was left out of them with `garbi sweep`"
        )
    prior = navigated.trajectory
    if settings.live:
        return _registered_live(store, log, prior, settings, navigate, progress, scanner)
    near, sensors, clocks = _synchronised(store, log, navigated, settings, navigate, progress, scanner)
    progress("sweeps against the map")
    corrections, constraints = scan_to_map(near.surfels, settings.front_end)
    loops = close_loops(near.surfels, corrections, settings.front_end)
    corrections = optimise(corrections, constraints + loops, _NEIGHBOUR)
    closed = _apply(near.path, near.surfels, corrections)
    progress("all sweeps at once")
    far = solve_far(store, mount, sensors, closed, settings.drift, progress)
    clocks = _retimed(store, far, clocks, scanner)
    rounds = near.rounds + far.rounds
    found = _registered(store, mount, prior, far, sensors.epoch_ns, rounds, _steps(near.surfels, corrections))
    return replace(found, loops=len(loops), clocks=clocks, looped=[(loop.first, loop.second) for loop in loops])


def _registered_live(
    store: SweepStore,
    log: Navigation,
    prior: Trajectory,
    settings: RegisterSettings,
    navigate: NavigateSettings,
    progress: Callable[[str], None],
    scanner: Scanner | None,
) -> Registered:
    """The sweeps one after the other, each with what had been measured when it ended."""
    live = LiveDrift(log.mount("rig"), settings.drift, navigate, scanner)
    for sweep in store:
        progress(f"sweep {sweep.index + 1} of {len(store)}")
        if len(sweep.stamp_ns) > 1:
            live.add(sweep, log)
    if live.solution is None:
        raise GarbiError(
            "registration: no sweep holds two profiles, too few for a trajectory; leave registration.live out"
        )
    rounds = live.solution.rounds
    return _registered(store, log.mount("rig"), prior, live.solution, live.epoch_ns, rounds, np.zeros(len(store)))


def _registered(
    store: SweepStore,
    mount: Mount,
    prior: Trajectory,
    solution: Solution,
    epoch_ns: int,
    rounds: list[list[Round]],
    steps: Floats,
) -> Registered:
    """What a solution says of the sweeps, beside the navigation filter's prior; nothing of loops and clocks."""
    stamps = store.stamps()
    trajectory = _trajectory(solution.path, solution.path.covariance, epoch_ns, stamps)
    placed = _placed_by(prior, solution, epoch_ns)
    return Registered(
        trajectory=trajectory,
        inside=_trajectory(solution.path, solution.path.relative, epoch_ns, stamps),
        rounds=rounds,
        graph_step=steps,
        loops=0,
        agreement=compare_placements(store, mount, prior, trajectory, placed, solution.surfels),
        constants=_constants(solution),
    )


def _synchronised(
    store: SweepStore,
    log: Navigation,
    navigated: NavigationResult,
    settings: RegisterSettings,
    navigate: NavigateSettings,
    progress: Callable[[str], None],
    scanner: Scanner | None,
) -> tuple[Solution, Sensors, list[Offset]]:
    """Neighbours in time, again where they show that clocks differ, with what was recorded set right."""
    applied = {ENCODER: store.latency} if store.latency else {}
    clocks: list[Offset] = []
    stamps = store.stamps()
    span = (0.0, float((stamps[-1] - stamps[0]) * 1e-9))
    for attempt in range(_ATTEMPTS):
        progress("clocks" if attempt == 0 else "clocks, corrected")
        right = restamped(log, clocks)
        if attempt > 0:
            navigated = run_navigation(right, navigate, stamps)
        known = (navigated.trajectory, navigated.inertial, navigated.attitude, navigate, int(stamps[0]), scanner)
        near = solve_near(store, log.mount("rig"), Sensors(right, *known, clocks=True), span, settings.drift, progress)
        clocks = judged(learnt(near.constants), applied)
        told = {offset.name: offset.value for offset in clocks if offset.state == "applied"}
        if told == applied or attempt == _ATTEMPTS - 1:
            break
        latency = told.get(ENCODER, 0.0)
        if scanner is not None and latency != store.latency:
            store.retime(partial(scanner.retimed, latency=latency), latency)
        applied = told
    return near, Sensors(right, *known), clocks


def _retimed(store: SweepStore, far: Solution, clocks: list[Offset], scanner: Scanner | None) -> list[Offset]:
    """The sweeps with the encoder's latency as all of them together tell it; the path has taken it into account."""
    more = learnt(far.constants).get(ENCODER)
    if more is None or scanner is None:
        return clocks
    fine = [refined(offset, more) if offset.name == ENCODER else offset for offset in clocks]
    for latency in (offset.value for offset in fine if offset.name == ENCODER and offset.state == "applied"):
        if latency != store.latency:
            store.retime(partial(scanner.retimed, latency=latency), latency)
    return fine


def _apply(path: Path, surfels: Surfels, corrections: list[Floats]) -> Path:
    """The path with the sweeps' corrections, which are those of the sweep's middle and change linearly in between."""
    seen = np.unique(surfels.sweep)
    if len(seen) < 2:
        return path
    middle = np.array([surfels.time[surfels.sweep == sweep].mean() for sweep in seen])
    transforms = np.array([corrections[sweep] for sweep in seen])
    centre = surfels.mean.mean(axis=0)
    shift = transforms[:, :3, :3] @ centre + transforms[:, :3, 3] - centre
    t = np.clip(path.time, middle[0], middle[-1])
    turn = Slerp(middle, Rotation.from_matrix(transforms[:, :3, :3]))(t)
    moved = np.stack([np.interp(t, middle, column) for column in shift.T], axis=1)
    position = turn.apply(path.position - centre) + centre + moved
    return replace(path, position=position, quaternion=(turn * Rotation.from_quat(path.quaternion)).as_quat())


def _steps(surfels: Surfels, corrections: list[Floats]) -> Floats:
    """How far (k,) m the centre of each sweep was moved."""
    out = np.zeros(len(corrections))
    for sweep in np.unique(surfels.sweep):
        centre = surfels.mean[surfels.sweep == sweep].mean(axis=0)
        out[sweep] = np.linalg.norm(corrections[sweep][:3, :3] @ centre + corrections[sweep][:3, 3] - centre)
    return out


def _placed_by(prior: Trajectory, solution: Solution, epoch_ns: int) -> Surfels:
    """The surfels where the navigation filter alone would have put them."""
    t = solution.surfels.time
    position, rotation = solution.path.at(t)
    there = prior.at(epoch_ns + np.round(t * 1e9).astype(np.int64))
    body = rotation.inv().apply(solution.surfels.mean - position)
    normal = rotation.inv().apply(solution.surfels.normal)
    moved = there.rotation.apply(body) + there.position
    return Surfels(moved, there.rotation.apply(normal), t, solution.surfels.sweep, solution.surfels.thickness)


def _trajectory(path: Path, covariance: NDArray[np.float32], epoch_ns: int, stamps: NDArray[np.int64]) -> Trajectory:
    """The path's own instants and the stamps; covariance (k, 6, 6) is that at the path's `sure` times."""
    own, sure = (epoch_ns + np.round(t * 1e9).astype(np.int64) for t in (path.time, path.sure))
    place, turn = path.at(path.sure)
    every = np.union1d(own, stamps)
    position, rotation = path.at(np.asarray((every - epoch_ns) * 1e-9, np.float64))
    known = Trajectory(sure, place, turn.as_quat(), covariance).at(every)
    return Trajectory(every, position, rotation.as_quat(), known.covariance)


def _constants(solution: Solution) -> dict[str, Any]:
    """Value, 1 sigma and unit of each constant, and the sigmas of the factors."""
    found = {
        name: {"value": one.value.tolist(), "sigma": one.sigma.tolist(), "unit": one.unit}
        for name, one in learnt(solution.constants).items()
    }
    return {**found, "sigma": solution.sigmas[-1]}
