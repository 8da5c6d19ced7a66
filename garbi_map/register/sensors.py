"""Which factors a log offers for a stretch of time, and the attitude that they correct."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Navigation, Stamps
from garbi_map.navigate import GyroAttitude, Inertial, Trajectory
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.register.constants import Constant
from garbi_map.register.factors import (
    ASSUMED_RATE_NOISE,
    Acceleration,
    AttitudeCorrection,
    BottomTrack,
    Calm,
    Factor,
    Gauge,
    Height,
    Nominal,
    Position,
)
from garbi_map.register.motion import PriorAttitude
from garbi_map.register.scanner import Changes, Scanner
from garbi_map.register.settings import DriftSettings

Floats = NDArray[np.float64]

CLOCK_SIGMA = 0.025
"""s; clocks that nothing synchronises differ by tens of milliseconds."""
_BIN = 0.04
"""Accelerations are averaged over this many seconds: shorter than the position's knots, longer than the sensor's noise."""
_LONG_SILENCE = 0.5
"""s; the navigation filter bridges shorter ones of the IMU better than a straight line."""
_MOMENT_NS = 50_000_000
"""To either side, over which the navigation filter's velocity is taken."""
_CONTRADICTION = 0.05
"""m/s between a DVL's ping and the navigation filter, which is less than a current or a fish makes."""
_UNKNOWN_ACCELERATION = 0.08
"""m/s^2 by which a vehicle accelerates of which no sensor tells."""
_LEAST_RATE_NOISE = np.deg2rad(0.003)
"""rad/s per root Hz; a gyro that seems better quantises its readings."""
_SWING = 2.0
"""s, for which a vehicle leans to one side of which no sensor tells: it rights itself."""
_UNKNOWN_SPEED = 5.0
"""Times the usual speed that a vehicle may have of which no sensor tells."""


@dataclass(frozen=True)
class Sensors:
    """Everything that is known of the motion besides the sweeps; times are seconds after `epoch_ns`.

    trajectory: the navigation filter's; inertial and gyro: None where the log has no IMU; scanner: None where nothing is
    known of it; clocks: whether the clocks of sensors and encoder are unknown against the camera's.
    """

    log: Navigation
    trajectory: Trajectory
    inertial: Inertial | None
    gyro: GyroAttitude | None
    navigate: NavigateSettings
    epoch_ns: int
    scanner: Scanner | None = None
    clocks: bool = False

    def seconds(self, stamp_ns: Stamps) -> Floats:
        """Times (n,) s of stamps (n,)."""
        return np.asarray((stamp_ns - self.epoch_ns) * 1e-9, np.float64)

    @property
    def prior_attitude(self) -> PriorAttitude:
        """The navigation filter's, whose short-term shape is the gyro's; straight on where the IMU is silent.

        There the filter's attitude trembles with every ping of the DVL, which no spline of a second's knots takes back;
        and where no sensor tells the attitude at all, a level vehicle is a better start.
        """
        if not self.attitude_known:
            heading = self.trajectory.rotation[0].as_euler("ZYX")[0]
            return PriorAttitude(np.zeros(1), Rotation.from_euler("z", [[heading]]).as_quat())
        time, told = self.seconds(self.trajectory.stamp_ns), self._attitude_times()
        if self.inertial is not None:
            spoken = self.inertial.rate_known | np.isfinite(self.inertial.attitude).all(axis=1)
            told = self.seconds(self.inertial.stamp_ns[spoken])
        after = np.clip(np.searchsorted(told, time), 1, len(told) - 1)
        inside = (told[after] - told[after - 1] > _LONG_SILENCE) & (time > told[after - 1]) & (time < told[after])
        return PriorAttitude(time[~inside], self.trajectory.quaternion[~inside])

    @property
    def attitude_known(self) -> bool:
        """Whether a gyro or somebody else's odometry tells how the vehicle turns."""
        return self.gyro is not None or self.log.odometry is not None or self._topic_attitude

    @property
    def _topic_attitude(self) -> bool:
        return self.inertial is not None and bool(np.isfinite(self.inertial.attitude).any())

    def attitude_knots(self, settings: DriftSettings) -> float:
        """Spacing, s: a turning that no sensor tells, be it for a second, needs about as many knots as the position."""
        told = self._attitude_times()
        silent = self.attitude_known and np.diff(told, prepend=told[:1]).max(initial=0.0) > settings.attitude_knots / 2
        return settings.attitude_knots if self.attitude_known and not silent else 2.0 * settings.position_knots

    def factors(self, begin: float, end: float, settings: DriftSettings, start: Floats | None) -> list[Factor]:
        """The factors of [begin, end] s; start (3,): where the vehicle is at `begin`, None if something else says so."""
        out: list[Factor] = [self._attitude(settings)]
        axes: tuple[int, ...] = (0, 1, 2)
        accelerations = self._accelerations(begin, end)
        measured = None if accelerations is None else accelerations.time
        out.append(Calm(settings.position_knots, _UNKNOWN_ACCELERATION, derivative=2, measured=measured))
        if accelerations is not None:
            out.append(accelerations)
        heights = self._heights(begin, end)
        if heights is not None:
            out.append(heights)
            axes = (0, 1)
        bottom_track = self._bottom_track(begin, end)
        measured = None if bottom_track is None else bottom_track.time
        out.append(Calm(1.0, _UNKNOWN_SPEED * self.navigate.speed, derivative=1, measured=measured))
        if bottom_track is not None:
            out.append(bottom_track)
        out.extend(self._positions(begin, end))
        out.append(Gauge(axes if start is not None else (), np.zeros(3) if start is None else start))
        out.append(Nominal())
        return out

    def constants(self) -> list[Constant]:
        """What is unknown of scanner and sensors that there are, the sensors' clocks included where they are asked for."""
        out = []
        if self.gyro is not None:
            bias = float(np.clip(3.0 * self.gyro.bias_sigma.max(), 5e-4, 0.01))
            out += [Constant("accelerometer_bias", 0.1, "m/s^2", 3), Constant("gyro_bias", bias, "rad/s", 3)]
        if self.log.dvl is not None or self.log.odometry is not None:
            out.append(Constant("dvl_scale", 0.02, "1"))
        if self.clocks:
            # without a gyro the motion between the sweeps is too free to time anything against
            timed = {"imu": self.gyro, "dvl": self.log.dvl, "pressure": self.log.pressure} if self.gyro else {}
            known = [name for name, record in timed.items() if record is not None]
            out += [Constant(f"{name}_clock", CLOCK_SIGMA, "s", patient=True) for name in known]
        return out + self._scanner_constants()

    def _scanner_constants(self) -> list[Constant]:
        """None without a gyro: a turning that no sensor tells can pass for anything that the scanner does."""
        return self.scanner.constants() if self.scanner is not None and self.gyro is not None else []

    @property
    def changes(self) -> Changes | None:
        """What the unknown constants of the scanner do to its points."""
        scanner = self.scanner
        if scanner is None or not self._scanner_constants():
            return None
        return lambda points, t: scanner.changes(points, self.epoch_ns + np.round(t * 1e9).astype(np.int64))

    def _attitude(self, settings: DriftSettings) -> AttitudeCorrection:
        spacing = self.attitude_knots(settings)
        if not self.attitude_known:
            memory = np.array([_SWING, _SWING, np.inf])
            return AttitudeCorrection(np.deg2rad([3.0, 3.0, 2.5]), spacing, None, memory=memory)
        magnitude = np.deg2rad([0.25, 0.25, 1.0])
        if self.gyro is not None:
            magnitude = np.maximum(magnitude, np.minimum(np.median(self.gyro.sigma, axis=0), np.deg2rad(5.0)))
        return AttitudeCorrection(magnitude, spacing, self._attitude_times(), self._rate_noise())

    def _rate_noise(self) -> float:
        """Density of the noise of the prior attitude's rate, rad/s per root Hz."""
        if self.gyro is None or self.inertial is None or self.inertial.rate_known.sum() < 10:
            return ASSUMED_RATE_NOISE
        known = self.inertial.rate_known
        return max(
            noise_density(self.seconds(self.inertial.stamp_ns[known]), self.inertial.rate[known]), _LEAST_RATE_NOISE
        )

    def _attitude_times(self) -> Floats:
        """Times (n,) s at which the prior attitude is measured, not held or interpolated."""
        if self.gyro is None or self.inertial is None:
            return self.seconds(self.trajectory.stamp_ns)
        return self.seconds(self.inertial.stamp_ns[self.inertial.rate_known])

    def _accelerations(self, begin: float, end: float) -> Acceleration | None:
        series = self.inertial
        if series is None or self.gyro is None or not series.force_known.any():
            return None
        time = self.seconds(series.stamp_ns)
        here = (time >= begin) & (time < end)
        if here.sum() < 10:
            return None
        time, known = time[here], series.force_known[here] & series.rate_known[here]
        rate = series.rate[here] - self.gyro.bias_series[here]
        values = np.hstack([time[:, None], series.specific_force[here], rate, known[:, None]])
        number = np.floor((time - time[0]) / _BIN).astype(np.int64)
        count = np.bincount(number)
        sums = np.stack([np.bincount(number, column) for column in values.T], axis=1)
        means: Floats = sums[count > 0] / count[count > 0, None]
        t, force, rate = means[:, 0], means[:, 1:4], means[:, 4:7]
        if len(t) < 3:
            return None
        turning = np.gradient(rate, t, axis=0)
        lever = series.lever_arm
        arm = np.cross(turning, lever) + np.cross(rate, np.cross(rate, lever))
        whole = means[:, 7] > 0.99
        return Acceleration(t[whole], force[whole], arm[whole]) if whole.sum() > 2 else None

    def _heights(self, begin: float, end: float) -> Height | None:
        pressure = self.log.pressure
        if pressure is None:
            return None
        time = self.seconds(pressure.stamp_ns)
        here = (time >= begin) & (time <= end)
        if not here.any():
            return None
        water = self.navigate
        depth = (pressure.pressure[here] - water.atmosphere) / (water.water_density * water.gravity)
        return Height(time[here], -depth, self.log.mount("pressure_link").translation)

    def _bottom_track(self, begin: float, end: float) -> BottomTrack | None:
        dvl, odometry = self.log.dvl, self.log.odometry
        if dvl is not None:
            time = self.seconds(dvl.stamp_ns)
            here = (time >= begin) & (time <= end) & np.isfinite(dvl.velocity).all(axis=1)
            if here.sum() < 3:
                return None
            mount = self.log.mount("dvl_link")
            velocity = Rotation.from_quat(mount.quaternion).apply(dvl.velocity[here])
            like = self._believable(dvl.stamp_ns[here], velocity, mount.translation)
            return BottomTrack(time[here][like], velocity[like], mount.translation) if like.sum() > 2 else None
        if odometry is not None:
            time = self.seconds(self.trajectory.stamp_ns)
            here = (time >= begin) & (time <= end)
            if here.sum() < 3:
                return None
            velocity = np.gradient(self.trajectory.position[here], time[here], axis=0)
            turned = self.trajectory.rotation[here].inv().apply(velocity)
            return BottomTrack(time[here], turned, np.zeros(3))
        return None

    def _believable(self, stamp_ns: Stamps, velocity: Floats, lever: Floats) -> NDArray[np.bool_]:
        """Which velocities (n, 3) m/s in base_link are not far from those of the navigation filter's trajectory.

        A DVL that takes the water or a fish for the bottom does so for seconds on end: by then the filter has refused it,
        but the drift estimate, which does not go forward in time, would find the path that suits it.
        """
        before, after = (self.trajectory.at(stamp_ns + side * _MOMENT_NS) for side in (-1, 1))
        there = self.trajectory.at(stamp_ns).rotation
        moved = after.position + after.rotation.apply(lever) - before.position - before.rotation.apply(lever)
        off = np.linalg.norm(velocity - there.inv().apply(moved) / (2e-9 * _MOMENT_NS), axis=1)
        return np.asarray(off < max(_CONTRADICTION, 6.0 * float(np.median(off))))

    def _positions(self, begin: float, end: float) -> list[Factor]:
        """Absolute fixes and odometry, through the filter's smoothed trajectory, once a second."""
        if self.log.fixes is None and self.log.odometry is None:
            return []
        t = np.arange(begin, end, 1.0)
        there = self.trajectory.at(self.epoch_ns + np.round(t * 1e9).astype(np.int64))
        variance = np.trace(there.covariance[:, :3, :3], axis1=1, axis2=2) / 3.0
        return [Position(t, there.position, float(np.sqrt(np.median(variance)) * np.sqrt(max(len(t) / 4.0, 1.0))))]


def noise_density(time: Floats, reading: Floats) -> float:
    """White noise of a sensor's readings (n, k) at time (n,) s: their unit per root Hz, whatever slow thing they measure.

    Fourth differences hold the noise and hardly anything of a vehicle's motion; the squares of their binomial weights sum
    to 70.
    """
    noise = 1.4826 * np.median(np.abs(np.diff(reading, n=4, axis=0))) / np.sqrt(70.0)
    return float(noise * np.sqrt(np.median(np.diff(time))))
