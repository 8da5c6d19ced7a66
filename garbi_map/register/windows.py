"""A dive of any length, solved window by window, each anchored to the one before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.register.constants import Constants
from garbi_map.register.covariance import pose_covariances
from garbi_map.register.drift import Round, Scans, estimate_drift
from garbi_map.register.factors import Anchor, Factor
from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings
from garbi_map.register.surfels import Surfels, join
from garbi_map.sweep.store import SweepStore

Floats = NDArray[np.float64]

_ANCHOR_STEP = 0.5
"""s between the poses that tie a window to the one before."""
_OUTPUT_STEP = 0.02
"""s between the poses that a solved window hands on."""


@dataclass
class Path:
    """Poses at ascending times, s, after the epoch: position (n, 3), quaternion (n, 4).

    covariance (n, 6, 6) against the map's origin and north; relative (n, 6, 6) inside the map.
    """

    time: Floats
    position: Floats
    quaternion: Floats
    covariance: Floats
    relative: Floats

    def at(self, t: Floats) -> tuple[Floats, Rotation]:
        """Position (m, 3) and rotation at t (m,), held at the ends."""
        from scipy.spatial.transform import Slerp

        t = np.clip(t, self.time[0], self.time[-1])
        position = np.stack([np.interp(t, self.time, column) for column in self.position.T], axis=1)
        return position, Slerp(self.time, Rotation.from_quat(self.quaternion))(t)


@dataclass
class Solution:
    """The path, the surfels of every sweep placed by it, and how each window went: its rounds, its constants with their
    covariance, the sigmas of its factors."""

    path: Path
    surfels: Surfels
    rounds: list[list[Round]] = field(default_factory=list)
    constants: list[tuple[Constants, Floats]] = field(default_factory=list)
    sigmas: list[dict[str, float]] = field(default_factory=list)


def split(begin: float, end: float, settings: DriftSettings) -> list[tuple[float, float]]:
    """Windows [begin, end] of at most `window` seconds that overlap by `overlap`."""
    if end - begin <= settings.window:
        return [(begin, end)]
    stride = settings.window - settings.overlap
    count = int(np.ceil((end - begin - settings.overlap) / stride))
    stride = (end - begin - settings.overlap) / count
    return [(begin + k * stride, begin + (k + 1) * stride + settings.overlap) for k in range(count)]


def load_scans(store: SweepStore, mount: Mount, sensors: Sensors, begin: float, end: float, most: int) -> Scans:
    """The profiles of [begin, end] in base_link, thinned evenly to at most `most` points; sweeps keep their numbers."""
    epoch = sensors.epoch_ns
    chosen = [e for e in store.entries if (e.end_ns - epoch) * 1e-9 >= begin and (e.begin_ns - epoch) * 1e-9 <= end]
    stride = max(1, -(-sum(entry.points for entry in chosen) // most))
    rotation = Rotation.from_quat(mount.quaternion).as_matrix()
    points, sigma, profile, time, sweeps = [], [], [], [], []
    profiles = 0
    for entry in chosen:
        sweep = store.load(entry.index)
        t = sensors.seconds(sweep.stamp_ns)
        keep = ((t >= begin) & (t <= end))[sweep.profile]
        keep &= (np.arange(len(keep)) % stride) == 0
        points.append(sweep.points[keep] @ rotation.T + mount.translation)
        sigma.append(sweep.sigma[keep])
        profile.append(sweep.profile[keep] + profiles)
        time.append(t)
        sweeps.append(np.full(len(t), entry.index, np.int64))
        profiles += len(t)
    return Scans(
        np.concatenate(points or [np.empty((0, 3))]),
        np.concatenate(sigma or [np.empty(0, np.float32)]),
        np.concatenate(profile or [np.empty(0, np.int32)]).astype(np.int32),
        np.concatenate(time or [np.empty(0)]),
        np.concatenate(sweeps or [np.empty(0, np.int64)]),
        sensors.changes,
    )


def solve_near(
    store: SweepStore,
    mount: Mount,
    sensors: Sensors,
    span: tuple[float, float],
    settings: DriftSettings,
    progress: Callable[[str], None],
) -> Solution:
    """The path that makes neighbours in time agree; what is far apart in time may be off by what adds up."""
    return _solve(store, mount, sensors, span, settings, None, progress)


def solve_far(
    store: SweepStore,
    mount: Mount,
    sensors: Sensors,
    start: Path,
    settings: DriftSettings,
    progress: Callable[[str], None],
) -> Solution:
    """From a path that is right to centimetres everywhere, the one that makes all sweeps agree."""
    return _solve(store, mount, sensors, (start.time[0], start.time[-1]), settings, start, progress)


def _solve(
    store: SweepStore,
    mount: Mount,
    sensors: Sensors,
    span: tuple[float, float],
    settings: DriftSettings,
    start: Path | None,
    progress: Callable[[str], None],
) -> Solution:
    solution: Solution | None = None
    windows = split(*span, settings)
    for number, (begin, end) in enumerate(windows):
        progress(f"window {number + 1} of {len(windows)}")
        scans = load_scans(store, mount, sensors, begin, end, settings.window_points)
        knots = settings.position_knots, sensors.attitude_knots(settings)
        motion = Motion(begin, end, sensors.prior_attitude, *knots, sensors.constants())
        if start is not None:
            t = motion.instants(_OUTPUT_STEP)
            motion.fit(t, *start.at(t))
        anchor = None if solution is None else _anchor(solution.path, motion)
        origin = None
        if solution is None:
            origin = motion.position(np.array([begin]))[0] if start is not None else _first_position(sensors, begin)
        factors: list[Factor] = sensors.factors(begin, end, settings, origin)
        if anchor is not None:
            factors.append(anchor)
        elsewhere = None
        if start is not None and solution is not None:
            new = np.unique(scans.sweep)
            elsewhere = solution.surfels.without(new)
        rounds, problem = estimate_drift(
            scans, motion, factors, settings, near_only=start is None, far_only=start is not None, elsewhere=elsewhere
        )
        path = _sample(motion, problem)
        surfels = scans.surfels(motion, settings.surfel_size, settings.surfel_points)
        if solution is None:
            solution = Solution(path, surfels)
        else:
            solution.path = _blend(solution.path, path)
            solution.surfels = join(solution.surfels.without(np.unique(surfels.sweep)), surfels)
        solution.rounds.append(rounds)
        solution.constants.append((motion.constants, problem.covariance(motion.constants_columns)))
        solution.sigmas.append({type(factor).__name__: factor.sigma for factor in factors})
    assert solution is not None
    return solution


def _first_position(sensors: Sensors, begin: float) -> Floats:
    """Where the filter has the vehicle at `begin`; its origin is the dive's first pose, its height the pressure's."""
    stamp = np.array([sensors.epoch_ns + round(begin * 1e9)], np.int64)
    return sensors.trajectory.at(stamp).position[0]


def _anchor(path: Path, motion: Motion) -> Anchor | None:
    """The end of the earlier window, but for its last second, which nothing after it has checked."""
    t = np.arange(motion.begin, path.time[-1] - 1.0, _ANCHOR_STEP)
    if len(t) == 0:
        return None
    position, rotation = path.at(t)
    shared = np.sqrt(max(len(t) / 4.0, 1.0))
    return Anchor(t, position, rotation, 5e-4 * shared, 2e-4 * shared)


def _sample(motion: Motion, problem: NormalEquations) -> Path:
    t = motion.instants(_OUTPUT_STEP)
    return Path(t, motion.position(t), motion.rotation(t).as_quat(), *pose_covariances(motion, problem, t))


def _blend(earlier: Path, later: Path) -> Path:
    """The earlier path fades into the later one over what they share."""
    shared = later.time[0], earlier.time[-1]
    before = earlier.time < shared[0]
    position, rotation = earlier.at(later.time)
    weight = np.clip((later.time - shared[0]) / max(shared[1] - shared[0], 1e-9), 0.0, 1.0)[:, None]
    between = (Rotation.from_quat(later.quaternion) * rotation.inv()).as_rotvec()
    return Path(
        np.r_[earlier.time[before], later.time],
        np.r_[earlier.position[before], position * (1 - weight) + later.position * weight],
        np.r_[earlier.quaternion[before], (Rotation.from_rotvec(between * weight) * rotation).as_quat()],
        np.r_[earlier.covariance[before], later.covariance],
        np.r_[earlier.relative[before], later.relative],
    )
