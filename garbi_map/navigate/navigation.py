"""From what the log measures to the trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Navigation, Stamps
from garbi_map.navigate.gyro_attitude import GyroAttitude, gyro_attitude
from garbi_map.navigate.inertial import Inertial, prepare_inertial
from garbi_map.navigate.odometry import odometry_trajectory
from garbi_map.navigate.report import filter_report, odometry_report
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.span import main_span
from garbi_map.navigate.timebase import Timebase, make_timebase, pick
from garbi_map.navigate.trajectory import Trajectory

if TYPE_CHECKING:
    from garbi_map.navigate.eskf import ErrorStateFilter
    from garbi_map.navigate.observations import Source
    from garbi_map.navigate.smoother import Smoothed

_DENSE_NS = 20_000_000  # ns between poses at most
_HONEST = (0.4, 2.5)  # typical ratio of squared innovation to expectation beyond which a stated noise is not believed


@dataclass(frozen=True)
class NavigationResult:
    """trajectory   map <- base_link, at the IMU's stamps (50 Hz to `output_rate`) and all asked stamps
    velocity     (n, 3) m/s of base_link in map, at the trajectory's stamps
    report       plain numbers and strings: sensors used, accepted and rejected, gaps, biases with sigma, innovations
    inertial, attitude   the prepared IMU series and the gyro's own attitude, None where the log has none
    """

    trajectory: Trajectory
    velocity: Floats
    report: dict[str, Any]
    inertial: Inertial | None
    attitude: GyroAttitude | None


def navigate(
    log: Navigation, settings: NavigateSettings | None = None, stamps_ns: Stamps | None = None
) -> NavigationResult:
    """The smoothed trajectory of a log, from whatever sensors it has.

    Forward an error-state Kalman filter, backward Rauch-Tung-Striebel. Own sensors of velocity or position (DVL, fixes)
    come first; without them somebody else's odometry is the trajectory; without that the IMU of a vehicle that is
    slow; with nothing at all, a vehicle that stands, and a covariance that says so.

    stamps_ns   (m,) int64 at which poses are wanted besides, e.g. those of the profiles
    Raises GarbiError where neither the log nor stamps_ns holds a single stamp.
    """
    settings = settings or NavigateSettings()
    asked = np.unique(np.asarray([] if stamps_ns is None else stamps_ns, np.int64))
    own = [
        one.stamp_ns
        for one in (log.imu, log.dvl, log.pressure, log.fixes, log.odometry, log.encoder)
        if one is not None
    ]
    span = main_span([*own, asked], settings.longest_gap)
    inertial = prepare_inertial(log, settings, span)
    attitude = gyro_attitude(log, settings, inertial)
    if log.odometry is not None and len(log.odometry.stamp_ns) and log.dvl is None and log.fixes is None:
        return _from_odometry(log, settings, asked, span, inertial, attitude)
    return _from_filter(log, settings, asked, span, inertial, attitude)


def _from_odometry(
    log: Navigation,
    settings: NavigateSettings,
    asked: Stamps,
    span: tuple[int, int],
    inertial: Inertial | None,
    attitude: GyroAttitude | None,
) -> NavigationResult:
    assert log.odometry is not None
    poses = odometry_trajectory(log.odometry, settings)
    trajectory = poses.at(_dense(np.union1d(poses.stamp_ns, span), asked))
    seconds = (trajectory.stamp_ns - trajectory.stamp_ns[0]) * 1e-9
    velocity = (
        np.gradient(trajectory.position, seconds, axis=0) if len(seconds) > 1 else np.zeros_like(trajectory.position)
    )
    report = odometry_report(len(poses.stamp_ns), len(log.odometry.stamp_ns), inertial, attitude)
    return NavigationResult(trajectory, velocity, report, inertial, attitude)


def _from_filter(
    log: Navigation,
    settings: NavigateSettings,
    asked: Stamps,
    span: tuple[int, int],
    inertial: Inertial | None,
    attitude: GyroAttitude | None,
) -> NavigationResult:
    from garbi_map.navigate.eskf import ErrorStateFilter
    from garbi_map.navigate.observations import make_sources
    from garbi_map.navigate.smoother import smooth
    from garbi_map.navigate.start import first_guess
    from garbi_map.navigate.tape import NodeTape

    base = make_timebase(inertial, *span, settings)
    sources = make_sources(log, inertial, attitude.disturbed if attitude else None, *span, settings)
    start = first_guess(inertial, attitude, sources, settings)
    forward = ErrorStateFilter(base, inertial, sources, start, settings)
    nodes = NodeTape(forward.run())
    believed, factors = _believed(forward, sources)
    if factors:
        forward = ErrorStateFilter(base, inertial, believed, start, settings)
        nodes = NodeTape(forward.run())
    smoothed = smooth(nodes, forward.model)
    trajectory, velocity = _path(base, forward, smoothed, inertial, "pressure" in forward.tallies, settings)
    stamps = _dense(trajectory.stamp_ns, asked)
    full = trajectory.at(stamps)
    at = [np.interp(stamps - stamps[0], trajectory.stamp_ns - stamps[0], column) for column in velocity.T]
    report = filter_report(log, settings, inertial, attitude, forward, smoothed, factors)
    return NavigationResult(full, np.stack(at, axis=1), report, inertial, attitude)


def _dense(stamps: Stamps, asked: Stamps) -> Stamps:
    """Own and asked stamps, and more in between wherever they are farther apart than 20 ms."""
    sparse = np.flatnonzero(np.diff(stamps) > _DENSE_NS)
    between = [np.arange(stamps[i], stamps[i + 1], _DENSE_NS) for i in sparse]
    return np.unique(np.concatenate([stamps, asked, *between]))


def _believed(forward: ErrorStateFilter, sources: list[Source]) -> tuple[list[Source], dict[str, float]]:
    """The sources with noises as the innovations show them, and by how much they were scaled; covariances may lie."""
    from garbi_map.navigate.observations import HabitSource, rescaled

    factors: dict[str, float] = {}
    out = []
    for source in sources:
        typical = forward.tallies[source.name].typical()
        # small innovations prove a sensor better than stated only where its own noise is most of what was expected
        own_noise = bool(np.median(forward.tallies[source.name].shares or [0.0]) > 0.5)
        lies = typical > _HONEST[1] or (typical < _HONEST[0] and own_noise)
        if len(source.stamp_ns) >= 20 and lies and not isinstance(source, HabitSource):
            changed = rescaled(source, typical)
            if not np.allclose(changed.variance, source.variance):
                factors[source.name] = typical
                out.append(changed)
                continue
        out.append(source)
    return out, factors


def _path(
    base: Timebase,
    forward: ErrorStateFilter,
    smoothed: Smoothed,
    inertial: Inertial | None,
    has_depth: bool,
    settings: NavigateSettings,
) -> tuple[Trajectory, Floats]:
    """Poses map <- base_link, and velocities (n, 3), at the samples that are put out.

    Between nodes the nominal path keeps the IMU's detail and the smoothed error is interpolated: at a node's right edge
    against the path as updated, at its left edge against the path as predicted.
    """
    nodes = base.nodes
    rows = np.union1d(pick(base.seconds, settings.output_rate), nodes)
    left_error = smoothed.error[:, :9]  # position, velocity, attitude
    right_error = left_error + smoothed.correction[:, :9]
    after = np.clip(np.searchsorted(nodes, rows), 1, len(nodes) - 1)
    start, end = base.seconds[nodes[after - 1]], base.seconds[nodes[after]]
    weight = ((base.seconds[rows] - start) / (end - start))[:, None]
    error = left_error[after - 1] * (1.0 - weight) + right_error[after] * weight
    on_node = np.isin(rows, nodes)
    error[on_node] = left_error[np.searchsorted(nodes, rows[on_node])]
    arm = inertial.lever_arm if inertial else np.zeros(3)
    rotation = Rotation.from_rotvec(error[:, 6:9]) * Rotation.from_quat(forward.quaternion[rows])
    reach = rotation.apply(arm)
    position = forward.position[rows] + error[:, 0:3] - reach
    rate = base.rate[rows] - np.stack([np.interp(rows, nodes, column) for column in smoothed.biases[:, 0:3].T], axis=1)
    spin = rotation.apply(np.where(base.rate_known[rows, None], rate, 0.0))
    velocity = forward.velocity[rows] + error[:, 3:6] - np.cross(spin, reach)
    lever = np.tile(np.eye(6), (len(nodes), 1, 1))
    lever[:, :3, 3:] = _cross_matrices(reach[on_node])
    at_nodes = (lever @ smoothed.pose @ lever.transpose(0, 2, 1)).astype(np.float32)
    known = Trajectory(base.stamp_ns[nodes], forward.position[nodes], forward.quaternion[nodes], at_nodes)
    covariance = known.at(base.stamp_ns[rows]).covariance
    position -= [*position[0, :2], 0.0 if has_depth else position[0, 2]]
    return Trajectory(base.stamp_ns[rows], position, rotation.as_quat(), covariance), velocity


def _cross_matrices(vectors: Floats) -> Floats:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
