"""Navigation sensors and the encoder: the truth, spoilt the way instruments spoil it.

Each `*Sensor` yields what it measured between two moments and remembers its biases and wander, so that a dive may be
sampled at once or, in closed loop, step by step. Stamps are START_NS plus seconds since the start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Dvl, Encoder, Floats, Imu, Mount, Pressure, Stamps
from tools.simulator.motion import Motion
from tools.simulator.scan import laser_angle
from tools.simulator.scenario import DvlErrors, ImuErrors, Laser, PressureErrors, Scenario, Sensor

START_NS = 1_767_225_600_000_000_000  # the dive begins with the year 2026, UTC
GRAVITY = 9.80665  # m/s^2
DENSITY = 1025.0  # kg/m^3
ATMOSPHERE = 101_325.0  # Pa
WANDER_TIME = 10.0  # s

MOUNTS = {  # base_link <- sensor; a DVL's transducers usually look past the thrusters at 45 degrees
    "imu_link": Mount(np.array([-0.05, 0.03, 0.08])),
    "dvl_link": Mount(np.array([-0.30, 0.0, -0.20]), np.array([0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8)])),
    "pressure_link": Mount(np.array([-0.20, 0.10, 0.05])),
}


def to_ns(time: Floats) -> Stamps:
    """Seconds since the start as stamps."""
    return START_NS + np.round(np.asarray(time) * 1e9).astype(np.int64)


class _Clock:
    """When a sensor measures, how it stamps that and when the recorder has it."""

    def __init__(self, sensor: Sensor, phase: float, rng: np.random.Generator) -> None:
        self._sensor, self._phase, self._rng = sensor, phase, rng

    def times(self, begin: float, end: float) -> Floats:
        """True moments (n,) s in [begin, end), silence left out."""
        rate = self._sensor.rate
        first = int(np.ceil((begin - self._phase) * rate - 1e-9))
        last = int(np.ceil((end - self._phase) * rate - 1e-9))
        times = self._phase + np.arange(max(first, 0), last) / rate
        for silent, back in self._sensor.gaps:
            times = times[(times < silent) | (times >= back)]
        return times

    def stamps(self, times: Floats) -> tuple[Stamps, Stamps]:
        """Header stamps and arrivals (n,)."""
        late = self._sensor.latency * (1 + self._rng.exponential(0.2, len(times)))
        return to_ns(times + self._sensor.clock_offset), to_ns(times + late)


class _Wander:
    """First-order Gauss-Markov processes, exactly discretised: k of them, each of 1 sigma `sigma` (k,)."""

    def __init__(self, sigma: Floats, rate: float, rng: np.random.Generator) -> None:
        self._sigma, self._rng = sigma, rng
        self._decay = float(np.exp(-1.0 / (rate * WANDER_TIME)))
        self._value = rng.normal(0, 1, len(sigma)) * sigma

    def next(self, count: int) -> Floats:
        """The next values (count, k)."""
        kick = self._rng.normal(size=(count, len(self._sigma))) * self._sigma * np.sqrt(1 - self._decay**2)
        if count == 0:
            return kick
        values, _ = lfilter([1.0], [1.0, -self._decay], kick, axis=0, zi=(self._decay * self._value)[None])
        self._value = values[-1]
        return values


class ImuSensor:
    """Rates, specific force and attitude at imu_link."""

    def __init__(self, errors: ImuErrors, factor: float, rng: np.random.Generator) -> None:
        self._errors, self._factor, self._rng = errors, factor, rng
        self._clock = _Clock(errors, 0.0, rng)
        self._gyro_bias = factor * errors.gyro_bias * rng.normal(size=3)
        self._accelerometer_bias = factor * errors.accelerometer_bias * rng.normal(size=3)
        bias = np.array([errors.tilt_bias, errors.tilt_bias, errors.heading_bias])
        wander = np.array([errors.tilt_wander, errors.tilt_wander, errors.heading_wander])
        self._attitude_bias = factor * bias * rng.normal(size=3)
        self._wander = _Wander(factor * wander, errors.rate, rng)
        self._covariance = np.diag(factor**2 * (bias**2 + wander**2))

    def between(self, motion: Motion, begin: float, end: float) -> Imu:
        """What was measured in [begin, end) s."""
        errors, factor = self._errors, self._factor
        times = self._clock.times(begin, end)
        true = motion.at(times)
        mount = MOUNTS["imu_link"]
        turned = true.rotation * Rotation.from_quat(mount.quaternion)
        felt = true.acceleration_at(mount.translation) + np.array([0.0, 0.0, GRAVITY])
        force = turned.inv().apply(felt) + self._accelerometer_bias
        rate = Rotation.from_quat(mount.quaternion).inv().apply(true.rate) + self._gyro_bias
        rate += factor * errors.gyro_noise * self._rng.normal(size=rate.shape)
        force += factor * errors.accelerometer_noise * self._rng.normal(size=force.shape)
        off = self._attitude_bias + self._wander.next(len(times))
        attitude = (
            (Rotation.from_rotvec(off) * turned).as_quat() if errors.attitude else np.full((len(times), 4), np.nan)
        )
        covariance = np.broadcast_to(self._covariance, (len(times), 3, 3))
        stamps, arrivals = self._clock.stamps(times)
        limit = errors.rate_limit
        return Imu(stamps, arrivals, np.clip(rate, -limit, limit), force, attitude, covariance)


class PressureSensor:
    """Absolute pressure at pressure_link."""

    def __init__(self, errors: PressureErrors, factor: float, depth: float, rng: np.random.Generator) -> None:
        self._noise, self._depth, self._rng = factor * errors.noise, depth, rng
        self._clock = _Clock(errors, 0.003, rng)
        self._bias = factor * errors.bias * rng.normal()

    def between(self, motion: Motion, begin: float, end: float) -> Pressure:
        """What was measured in [begin, end) s."""
        times = self._clock.times(begin, end)
        true = motion.at(times)
        height = true.position[:, 2] + true.rotation.apply(MOUNTS["pressure_link"].translation)[:, 2]
        depth = self._depth - height + self._bias + self._noise * self._rng.normal(size=len(times))
        return Pressure(*self._clock.stamps(times), ATMOSPHERE + DENSITY * GRAVITY * depth)


class DvlSensor:
    """Bottom-track velocity at and in dvl_link."""

    def __init__(self, errors: DvlErrors, factor: float, rng: np.random.Generator) -> None:
        self._errors, self._noise, self._rng = errors, factor * errors.noise, rng
        self._clock = _Clock(errors, 0.007, rng)
        self._scale = 1 + factor * errors.scale * rng.normal()

    def between(self, motion: Motion, begin: float, end: float) -> Dvl:
        """What was measured in [begin, end) s."""
        times = self._clock.times(begin, end)
        true = motion.at(times)
        mount = MOUNTS["dvl_link"]
        turned = true.rotation * Rotation.from_quat(mount.quaternion)
        velocity = self._scale * turned.inv().apply(true.velocity_at(mount.translation))
        velocity += self._noise * self._rng.normal(size=velocity.shape)
        wrong = self._rng.uniform(size=len(times)) < self._errors.outliers
        velocity[wrong] += 0.3 * self._rng.normal(size=(int(wrong.sum()), 3))
        covariance = np.broadcast_to(np.eye(3) * self._noise**2, (len(times), 3, 3))
        return Dvl(*self._clock.stamps(times), velocity, covariance)


class EncoderSensor:
    """The laser's angle in whole counts."""

    def __init__(self, laser: Laser, rng: np.random.Generator) -> None:
        self._laser = laser
        self._clock = _Clock(Sensor(rate=laser.encoder_rate, latency=laser.encoder_latency), 0.001, rng)

    def between(self, begin: float, end: float) -> Encoder:
        """What was measured in [begin, end) s."""
        times = self._clock.times(begin, end)
        counts: NDArray[np.float64] = np.floor(laser_angle(self._laser, times) / self._laser.count + 0.5)
        return Encoder(*self._clock.stamps(times), counts * self._laser.count)


class Suite:
    """All sensors that a scenario has; each draws from a stream of its own: leaving one out changes no other."""

    def __init__(self, scenario: Scenario) -> None:
        own = [np.random.default_rng([scenario.seed, 5, number]) for number in range(4)]
        sensors, factor = scenario.sensors, scenario.sensors.factor
        self.encoder = EncoderSensor(scenario.laser, own[0]) if scenario.laser.motor else None
        self.imu = ImuSensor(sensors.imu, factor, own[1]) if sensors.imu else None
        self.pressure = (
            PressureSensor(sensors.pressure, factor, scenario.water.depth, own[2]) if sensors.pressure else None
        )
        self.dvl = DvlSensor(sensors.dvl, factor, own[3]) if sensors.dvl else None
