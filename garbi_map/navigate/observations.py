"""What each sensor says about the state, and how wrong it may be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Dvl, Fixes, Floats, Mount, Navigation, Pressure, Stamps
from garbi_map.navigate.inertial import Flags, Inertial
from garbi_map.navigate.kernels import cross_matrix, difference
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.span import within
from garbi_map.navigate.states import ATTITUDE, GYRO_BIAS, POSITION, SCALE, STATES, TOPIC, VELOCITY

_NEIGHBOURS = 7  # samples, over which a lone outlier does not move the median
_DEPTH_JUMP = 0.2  # m
_DVL_JUMP = 0.3  # m/s between a ping and the median of its neighbours that no vehicle of this kind does
_HABIT_PERIOD = 1.0  # s between reminders that the vehicle stays slow and upright


@dataclass(frozen=True)
class Nominal:
    """The filter's belief at the moment of a measurement; position and velocity are those of the IMU, in map."""

    position: Floats
    velocity: Floats
    quaternion: Floats
    matrix: Floats
    rate: Floats  # of the body, bias removed, rad/s
    topic: Floats  # slow error of the attitude topic, rad
    scale: float  # of the DVL, error relative to 1


@dataclass(frozen=True)
class Source:
    """Measurements of one sensor: stamp_ns (k,), value (k, d), variance (k, d, d) of the white part of the error.

    part: the states that this sensor decides.
    patience: seconds of unbroken rejection after which the filter takes itself to be wrong in `part`.
    floor: 1 sigma below which the variance is never scaled.
    """

    name: str
    stamp_ns: Stamps
    value: Floats
    variance: Floats
    part: slice
    patience: float
    floor: float

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        """Innovation (d,) and its Jacobian (d, STATES) with respect to the error-state at that moment."""
        raise NotImplementedError


@dataclass(frozen=True)
class AttitudeSource(Source):
    """Quaternions map <- base_link; `axes` of the rotation error that are used: roll and pitch, or yaw."""

    axes: tuple[int, ...]

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        axes = list(self.axes)
        jacobian = np.zeros((len(axes), STATES))
        for row, axis in enumerate(axes):
            jacobian[row, ATTITUDE.start + axis] = jacobian[row, TOPIC.start + axis] = 1.0
        return (difference(self.value[index], nominal.quaternion) - nominal.topic)[axes], jacobian


@dataclass(frozen=True)
class DepthSource(Source):
    """Height (1,) above the surface of a point at `arm` from the IMU (base_link axes)."""

    arm: Floats

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        arm = nominal.matrix @ self.arm
        jacobian = np.zeros((1, STATES))
        jacobian[0, 2] = 1.0
        jacobian[0, ATTITUDE] = -cross_matrix(arm)[2]
        return self.value[index] - (nominal.position[2] + arm[2]), jacobian


@dataclass(frozen=True)
class VelocitySource(Source):
    """Velocity (3,), base_link axes, of a point at `arm` from the IMU."""

    arm: Floats

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        back, gain = nominal.matrix.T, 1.0 + nominal.scale
        velocity = back @ nominal.velocity + np.cross(nominal.rate, self.arm)
        jacobian = np.zeros((3, STATES))
        jacobian[:, VELOCITY] = gain * back
        jacobian[:, ATTITUDE] = gain * back @ cross_matrix(nominal.velocity)
        jacobian[:, GYRO_BIAS] = gain * cross_matrix(self.arm)
        jacobian[:, SCALE] = velocity
        return self.value[index] - gain * velocity, jacobian


@dataclass(frozen=True)
class FixSource(Source):
    """Absolute position of a point at `arm` from the IMU: east and north, and up where there is no pressure."""

    arm: Floats

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        arm = nominal.matrix @ self.arm
        rows = self.value.shape[1]
        jacobian = np.zeros((3, STATES))
        jacobian[:, POSITION] = np.eye(3)
        jacobian[:, ATTITUDE] = -cross_matrix(arm)
        return self.value[index] - (nominal.position + arm)[:rows], jacobian[:rows]


@dataclass(frozen=True)
class HabitSource(Source):
    """Where nothing measures it, the vehicle is slow and nearly upright; the rows of `value` are zero."""

    def look(self, index: int, nominal: Nominal) -> tuple[Floats, Floats]:
        rows = self.value.shape[1]
        jacobian = np.zeros((rows, STATES))
        jacobian[:, self.part.start : self.part.start + rows] = np.eye(rows)
        if self.part == VELOCITY:
            return -nominal.velocity, jacobian
        up = nominal.matrix[:, 2]  # the body's vertical seen from the map: its lean is the tilt
        return np.array([up[1], -up[0]]), jacobian


def make_sources(
    log: Navigation,
    inertial: Inertial | None,
    disturbed: Flags | None,
    begin_ns: int,
    end_ns: int,
    settings: NavigateSettings,
) -> list[Source]:
    """All that the log measures between two stamps, in base_link axes, obviously broken samples left out."""
    origin = inertial.lever_arm if inertial else np.zeros(3)
    sources: list[Source] = []
    if inertial and np.isfinite(inertial.attitude[:, 0]).any():
        sources += _attitude(inertial, disturbed, settings)
    if log.pressure is not None:
        sources += _depth(log.pressure, log.mount("pressure_link"), origin, begin_ns, end_ns, settings)
    if log.dvl is not None:
        sources += _velocity(log.dvl, log.mount("dvl_link"), origin, begin_ns, end_ns, settings)
    if log.fixes is not None:
        sources += _fixes(log.fixes, 2 if log.pressure is not None else 3, origin, begin_ns, end_ns, settings)
    moving = [source.stamp_ns for source in sources if source.name in ("dvl", "fixes")]
    leaning = [inertial.stamp_ns[inertial.force_known]] if inertial else []
    leaning += [source.stamp_ns for source in sources if source.name == "tilt"]
    sources.append(_habit("speed", VELOCITY, 3, settings.speed, moving, begin_ns, end_ns, settings))
    sources.append(_habit("upright", ATTITUDE, 2, settings.tilt, leaning, begin_ns, end_ns, settings))
    return [source for source in sources if len(source.stamp_ns)]


def rescaled(source: Source, factor: float) -> Source:
    """The source with its variance multiplied, but not below its floor."""
    floor = np.eye(source.variance.shape[-1]) * source.floor**2
    return replace(source, variance=np.maximum(source.variance * factor, floor))


def _attitude(inertial: Inertial, disturbed: Flags | None, settings: NavigateSettings) -> list[Source]:
    good = np.isfinite(inertial.attitude[:, 0])
    # neighbours share their error: one sample per node says all
    bins = np.floor(inertial.seconds * settings.node_rate + 1e-9)[good]
    rows = np.flatnonzero(good)[np.flatnonzero(np.diff(bins, append=np.inf))]
    steady = rows if disturbed is None else rows[~disturbed[rows]]
    noise = settings.attitude_noise

    def source(name: str, picked: np.ndarray, axes: tuple[int, ...], part: slice, patience: float) -> Source:
        variance = np.broadcast_to(np.eye(len(axes)) * noise**2, (len(picked), len(axes), len(axes)))
        return AttitudeSource(
            name, inertial.stamp_ns[picked], inertial.attitude[picked], variance, part, patience, noise, axes=axes
        )

    return [source("tilt", rows, (0, 1), slice(6, 8), 30.0), source("yaw", steady, (2,), slice(8, 9), 60.0)]


def _depth(
    record: Pressure, mount: Mount, origin: Floats, begin_ns: int, end_ns: int, settings: NavigateSettings
) -> list[Source]:
    keep = within(record.stamp_ns, begin_ns, end_ns)
    keep = keep[np.isfinite(record.pressure[keep])]
    if len(keep) == 0:
        return []
    stamps, pressure = record.stamp_ns[keep], record.pressure[keep]
    height = (settings.atmosphere - pressure) / (settings.water_density * settings.gravity)
    sigma = max(_white(height), settings.pressure_noise)
    calm = np.abs(height - median_filter(height, size=_NEIGHBOURS, mode="nearest")) < _DEPTH_JUMP
    stamps, height = stamps[calm], height[calm]
    if len(stamps) == 0:
        return []
    stamps, height, count = _thinned(stamps, height, settings.node_rate)
    return [
        DepthSource(
            "pressure",
            stamps,
            height[:, None],
            (sigma**2 / count)[:, None, None],
            slice(2, 3),
            10.0,
            settings.pressure_noise,
            arm=mount.translation - origin,
        )
    ]


def _velocity(
    record: Dvl, mount: Mount, origin: Floats, begin_ns: int, end_ns: int, settings: NavigateSettings
) -> list[Source]:
    keep = within(record.stamp_ns, begin_ns, end_ns)
    keep = keep[np.isfinite(record.velocity[keep]).all(axis=1)]
    if len(keep) == 0:
        return []
    turned = Rotation.from_quat(mount.quaternion)
    velocity = turned.apply(record.velocity[keep])
    jump = np.linalg.norm(velocity - median_filter(velocity, size=(_NEIGHBOURS, 1), mode="nearest"), axis=1)
    calm = jump < _DVL_JUMP
    variance = _floored(record.covariance[keep], settings.dvl_noise)
    matrix = turned.as_matrix()
    return [
        VelocitySource(
            "dvl",
            record.stamp_ns[keep][calm],
            velocity[calm],
            (matrix @ variance @ matrix.T)[calm],
            VELOCITY,
            10.0,
            settings.dvl_noise,
            arm=mount.translation - origin,
        )
    ]


def _fixes(
    record: Fixes, rows: int, origin: Floats, begin_ns: int, end_ns: int, settings: NavigateSettings
) -> list[Source]:
    keep = within(record.stamp_ns, begin_ns, end_ns)
    keep = keep[np.isfinite(record.position[keep, :rows]).all(axis=1)]
    if len(keep) == 0:
        return []
    return [
        FixSource(
            "fixes",
            record.stamp_ns[keep],
            record.position[keep, :rows],
            _floored(record.covariance[keep], settings.fix_noise)[:, :rows, :rows],
            slice(0, rows),
            60.0,
            settings.fix_noise,
            arm=-origin,
        )
    ]


def _habit(
    name: str,
    part: slice,
    rows: int,
    sigma: float,
    measured: list[Stamps],
    begin_ns: int,
    end_ns: int,
    settings: NavigateSettings,
) -> Source:
    """Reminders wherever the nearest measurement is farther than half a habit_time."""
    stamps = np.arange(begin_ns, end_ns, int(_HABIT_PERIOD * 1e9))
    edges = np.sort(np.concatenate([*measured, [np.iinfo(np.int64).min // 2, np.iinfo(np.int64).max // 2]]))
    after = np.searchsorted(edges, stamps)
    stamps = stamps[np.minimum(edges[after] - stamps, stamps - edges[after - 1]) > 0.5e9 * settings.habit_time]
    # the reminders of one habit_time say the same thing: together they weigh as one
    variance = sigma**2 * settings.habit_time / _HABIT_PERIOD
    return HabitSource(
        name,
        stamps,
        np.zeros((len(stamps), rows)),
        np.broadcast_to(np.eye(rows) * variance, (len(stamps), rows, rows)),
        part,
        np.inf,
        sigma,
    )


def _floored(covariance: Floats, floor: float) -> Floats:
    """The diagonal of what messages state (n, 3, 3), never below the floor; nonsense becomes the floor."""
    stated = np.nan_to_num(np.diagonal(covariance, axis1=1, axis2=2), nan=0.0, posinf=0.0, neginf=0.0)
    return np.maximum(stated, floor**2)[:, :, None] * np.eye(3)


def _white(values: Floats) -> float:
    """1 sigma of a scalar series' white part from its second differences."""
    if len(values) < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6.0)))


def _thinned(stamps: Stamps, values: Floats, per_second: float) -> tuple[Stamps, Floats, Floats]:
    """Means of stamps and values (n,) in bins of time, and how many samples each is made of."""
    bins = np.unique(((stamps - stamps[0]) * (per_second * 1e-9)).astype(np.int64), return_inverse=True)[1]
    count = np.bincount(bins).astype(float)
    mean_stamp = stamps[0] + np.round(np.bincount(bins, stamps - stamps[0]) / count).astype(np.int64)
    return mean_stamp, np.bincount(bins, values) / count, count
