"""A dive of any length, solved window by window, each anchored to the one before it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

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
from garbi_map.register.thinning import earliest, within
from garbi_map.sweep.store import SweepStore
from garbi_map.sweep.types import Sweep

Floats = NDArray[np.float64]

_ANCHOR_STEP = 0.5
"""s between the poses that tie a window to the one before."""
_OUTPUT_STEP = 0.02
"""s between the poses that a solved window hands on."""
_COVARIANCE_STEP = 0.1
"""s between those of them whose covariance is kept."""
_MARGIN = 0.3
"""m about a window within which settled surfels have a say."""


@dataclass
class Path:
    """Poses at ascending times, s, after the epoch: position (n, 3), quaternion (n, 4).

    At fewer times, sure (k,) s: covariance (k, 6, 6) against the map's origin and north, relative (k, 6, 6) inside the map.
    """

    time: Floats
    position: Floats
    quaternion: Floats
    sure: Floats
    covariance: NDArray[np.float32]
    relative: NDArray[np.float32]

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


def _sweep_begin(t: float, cuts: Floats) -> float:
    """The last beginning (k,) s of a sweep before t: a window that began inside one would know it in part only."""
    before = cuts[cuts <= t]
    return float(before[-1]) if len(before) else t


def load_scans(store: SweepStore, mount: Mount, sensors: Sensors, begin: float, end: float, most: int) -> Scans:
    """The profiles of [begin, end] in base_link, thinned evenly to at most `most` points; sweeps keep their numbers."""
    epoch = sensors.epoch_ns
    chosen = [e for e in store.entries if (e.end_ns - epoch) * 1e-9 >= begin and (e.begin_ns - epoch) * 1e-9 <= end]
    stride = max(1, -(-sum(entry.points for entry in chosen) // most))
    return make_scans((store.load(entry.index) for entry in chosen), mount, sensors, begin, end, stride)


def make_scans(
    sweeps: Iterable[Sweep], mount: Mount, sensors: Sensors, begin: float, end: float, stride: int = 1
) -> Scans:
    """The profiles of some sweeps that lie in [begin, end] s, in base_link: every `stride`th point."""
    rotation = Rotation.from_quat(mount.quaternion).as_matrix()
    points, sigma, profile, time, numbers = [], [], [], [], []
    profiles = 0
    for sweep in sweeps:
        t = sensors.seconds(sweep.stamp_ns)
        keep = ((t >= begin) & (t <= end))[sweep.profile]
        keep &= (np.arange(len(keep)) % stride) == 0
        points.append(sweep.points[keep] @ rotation.T + mount.translation)
        sigma.append(sweep.sigma[keep])
        profile.append(sweep.profile[keep] + profiles)
        time.append(t)
        numbers.append(np.full(len(t), sweep.index, np.int64))
        profiles += len(t)
    return Scans(
        np.concatenate(points or [np.empty((0, 3))]),
        np.concatenate(sigma or [np.empty(0, np.float32)]),
        np.concatenate(profile or [np.empty(0, np.int32)]).astype(np.int32),
        np.concatenate(time or [np.empty(0)]),
        np.concatenate(numbers or [np.empty(0, np.int64)]),
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
    cuts = np.array([(entry.begin_ns - sensors.epoch_ns) * 1e-9 for entry in store.entries])
    windows = [(_sweep_begin(begin, cuts), end) for begin, end in split(*span, settings)]
    for number, (begin, end) in enumerate(windows):
        progress(f"window {number + 1} of {len(windows)}")
        scans = load_scans(store, mount, sensors, begin, end, settings.window_points)
        solution = extend(
            solution, scans, sensors, (begin, end), settings, start, near_only=start is None, far_only=start is not None
        )
    assert solution is not None
    return solution


def extend(
    solution: Solution | None,
    scans: Scans,
    sensors: Sensors,
    span: tuple[float, float],
    settings: DriftSettings,
    start: Path | None = None,
    near_only: bool = False,
    far_only: bool = False,
    settled: float | None = None,
) -> Solution:
    """The solution so far and a window, span s, anchored to it where they overlap, up to `settled` s if that is given.

    start: a path to begin from. But for the near rounds, the window is laid on what is settled, and settles its own.
    """
    begin, end = span
    knots = settings.position_knots, sensors.attitude_knots(settings)
    motion = Motion(begin, end, sensors.prior_attitude, *knots, sensors.constants())
    if start is not None:
        t = motion.instants(_OUTPUT_STEP)
        motion.fit(t, *start.at(t))
    anchor = None if solution is None else _anchor(solution.path, motion, settled)
    origin = None
    if solution is None:
        origin = motion.position(np.array([begin]))[0] if start is not None else _first_position(sensors, begin)
    factors: list[Factor] = sensors.factors(begin, end, settings, origin)
    if anchor is not None:
        factors.append(anchor)
    elsewhere = None
    if not near_only and solution is not None:
        elsewhere = solution.surfels.without(np.unique(scans.sweep))
        if start is not None:
            seen = scans.surfels(motion, settings.coarse_surfel_size, settings.surfel_points)
            elsewhere = elsewhere.select(within(elsewhere, seen, _MARGIN))
    rounds, problem = estimate_drift(
        scans, motion, factors, settings, near_only=near_only, far_only=far_only, elsewhere=elsewhere
    )
    path = _sample(motion, None if near_only else problem)
    surfels = scans.surfels(motion, settings.surfel_size, settings.surfel_points)
    if solution is None:
        solution = Solution(path, surfels)
    else:
        solution.path = _blend(solution.path, _inheriting(solution.path, path))
        solution.surfels = join(solution.surfels.without(np.unique(surfels.sweep)), surfels)
    if not near_only:
        known = earliest(solution.surfels, settings.surfel_size, settings.settled_surfels)
        solution.surfels = solution.surfels.select(known)
    solution.rounds.append(rounds)
    solution.constants.append((motion.constants, problem.covariance(motion.constants_columns)))
    solution.sigmas.append({type(factor).__name__: factor.sigma for factor in factors})
    return solution


def _first_position(sensors: Sensors, begin: float) -> Floats:
    """Where the filter has the vehicle at `begin`; its origin is the dive's first pose, its height the pressure's."""
    stamp = np.array([sensors.epoch_ns + round(begin * 1e9)], np.int64)
    return sensors.trajectory.at(stamp).position[0]


def _anchor(path: Path, motion: Motion, settled: float | None) -> Anchor | None:
    """The end of the earlier window, but for its last second, which nothing after it has checked."""
    t = np.arange(motion.begin, path.time[-1] - 1.0 if settled is None else settled, _ANCHOR_STEP)
    if len(t) == 0:
        return None
    position, rotation = path.at(t)
    shared = np.sqrt(max(len(t) / 4.0, 1.0))
    return Anchor(t, position, rotation, 5e-4 * shared, 2e-4 * shared)


def _sample(motion: Motion, problem: NormalEquations | None) -> Path:
    """Without a problem the covariances are zero: those of the near rounds, which no one asks for, cost a second."""
    t, sure = motion.instants(_OUTPUT_STEP), motion.instants(_COVARIANCE_STEP)
    covariance = relative = np.zeros((len(sure), 6, 6), np.float32)
    if problem is not None:
        covariance, relative = (values.astype(np.float32) for values in pose_covariances(motion, problem, sure))
    return Path(t, motion.position(t), motion.rotation(t).as_quat(), sure, covariance, relative)


def _inheriting(earlier: Path, later: Path) -> Path:
    """The later path, which knows its covariance against the earlier one only, with that one's own added.

    Inside the map, too, it is as sure as it is tied to the earlier one, not as its own window is in itself.
    """
    return replace(
        later,
        covariance=later.covariance + _carried(earlier, earlier.covariance, later),
        relative=later.covariance + _carried(earlier, earlier.relative, later),
    )


def _carried(earlier: Path, covariance: NDArray[np.float32], later: Path) -> NDArray[np.float32]:
    """What (k, 6, 6) the later path inherits: the earlier one's covariance in the middle of what they share, as that of a
    rigid motion of all that comes after."""
    middle = np.array([0.5 * (later.time[0] + earlier.time[-1])])
    there = covariance[np.searchsorted(earlier.sure, middle[0])]
    x, y, z = (later.at(later.sure)[0] - earlier.at(middle)[0]).T
    zero = np.zeros_like(x)
    motion = np.tile(np.eye(6), (len(x), 1, 1))
    motion[:, :3, 3:] = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    return (motion @ there @ motion.transpose(0, 2, 1)).astype(np.float32)


def _blend(earlier: Path, later: Path) -> Path:
    """The earlier path fades into the later one over what they share."""
    shared = later.time[0], earlier.time[-1]
    before, sure_before = earlier.time < shared[0], earlier.sure < shared[0]
    position, rotation = earlier.at(later.time)
    weight = np.clip((later.time - shared[0]) / max(shared[1] - shared[0], 1e-9), 0.0, 1.0)[:, None]
    between = (Rotation.from_quat(later.quaternion) * rotation.inv()).as_rotvec()
    return Path(
        np.r_[earlier.time[before], later.time],
        np.r_[earlier.position[before], position * (1 - weight) + later.position * weight],
        np.r_[earlier.quaternion[before], (Rotation.from_rotvec(between * weight) * rotation).as_quat()],
        np.r_[earlier.sure[sure_before], later.sure],
        np.r_[earlier.covariance[sure_before], later.covariance],
        np.r_[earlier.relative[sure_before], later.relative],
    )
