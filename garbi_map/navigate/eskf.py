"""Error-state Kalman filter forward in time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from garbi_map.log.records import Floats
from garbi_map.navigate.inertial import Inertial
from garbi_map.navigate.kernels import cross_matrix, matrix, propagate, turn
from garbi_map.navigate.observations import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    SCALE,
    STATES,
    TOPIC,
    VELOCITY,
    Nominal,
    Source,
)
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.timebase import Timebase


@dataclass
class Start:
    """The state at the first sample and what is known of it: covariance (STATES, STATES)."""

    position: Floats
    velocity: Floats
    quaternion: Floats
    gyro_bias: Floats
    covariance: Floats


@dataclass
class Tally:
    """What became of one sensor's measurements; ratios are squared innovations over what the filter expected."""

    accepted: int = 0
    rejected: int = 0
    ratios: list[float] = field(default_factory=list)
    first_refusal: float | None = None

    def typical(self) -> float:
        """Robust mean of the ratios, 1 for a filter that knows its noise."""
        return float(np.median(self.ratios) / 0.4549) if self.ratios else float("nan")


@dataclass(frozen=True)
class Node:
    """One step of the forward pass: the nominal state's biases after the update, `correction` (STATES,) that the update
    folded into the nominal state, covariance after the update, and transition and process noise that led here."""

    sample: int
    biases: Floats
    correction: Floats
    covariance: Floats
    transition: Floats
    noise: Floats


class ErrorStateFilter:
    """filterpy's KalmanFilter over the error, the state itself outside; the error is folded in after each update.

    The rotation error lives in the map frame, and the reset's Jacobian (identity less half the correction) is left out:
    corrections are milliradians. After the run `position`, `velocity` (m, 3) and `quaternion` (m, 4) hold the nominal
    path at every sample: predicted between nodes, updated at nodes.
    """

    def __init__(
        self, base: Timebase, inertial: Inertial | None, sources: list[Source], start: Start, settings: NavigateSettings
    ) -> None:
        from filterpy.kalman import KalmanFilter

        self.base, self.sources, self.settings = base, sources, settings
        count = len(base.stamp_ns)
        self.position, self.velocity = np.zeros((count, 3)), np.zeros((count, 3))
        self.quaternion = np.zeros((count, 4))
        self.position[0], self.velocity[0], self.quaternion[0] = start.position, start.velocity, start.quaternion
        self.biases = np.zeros(STATES - GYRO_BIAS.start)
        self.biases[:3] = start.gyro_bias
        self.kalman = KalmanFilter(dim_x=STATES, dim_z=1)
        self.kalman.x, self.kalman.P = np.zeros(STATES), start.covariance.copy()
        self.tallies = {source.name: Tally() for source in sources}
        self._gates = {d: float(chi2.ppf(settings.gate, d)) for d in (1, 2, 3)}
        self._gyro = np.mean(inertial.rate_noise**2) if inertial else 0.0
        self._accelerometer = np.mean(inertial.force_noise**2) if inertial else 0.0
        self._topic_sigma = np.maximum(
            inertial.attitude_sigma if inertial else np.zeros(3),
            [settings.attitude_tilt, settings.attitude_tilt, settings.attitude_yaw],
        )

    def run(self) -> Iterator[Node]:
        """One node after another; what has been measured since the node before is folded in at each."""
        nodes = self.base.nodes
        queue = self._in_time_order()
        waiting = next(queue, None)
        transition, noise = np.eye(STATES), np.zeros((STATES, STATES))
        for order, sample in enumerate(nodes):
            before = nodes[order - 1] if order else 0
            if order:
                transition, noise = self._predict(before, sample)
            due: list[tuple[int, int]] = []
            while waiting is not None and self.base.stamp_ns[sample] >= waiting[0]:
                due.append(waiting[1:])
                waiting = next(queue, None)
            correction = self._update(due, before, sample, transition)
            yield Node(sample, self.biases.copy(), correction, self.kalman.P.copy(), transition, noise)

    def _in_time_order(self) -> Iterator[tuple[int, int, int]]:
        """(stamp_ns, source, index) of every measurement."""
        if not self.sources:
            return
        stamps = np.concatenate([source.stamp_ns for source in self.sources])
        which = np.repeat(np.arange(len(self.sources)), [len(source.stamp_ns) for source in self.sources])
        index = np.concatenate([np.arange(len(source.stamp_ns)) for source in self.sources])
        for i in np.argsort(stamps, kind="stable"):
            yield int(stamps[i]), int(which[i]), int(index[i])

    def _predict(self, first: int, last: int) -> tuple[Floats, Floats]:
        base, settings = self.base, self.settings
        seconds = base.seconds[last] - base.seconds[first]
        jacobian, no_rate, no_force = propagate(
            first,
            last,
            base.seconds,
            base.rate,
            base.force,
            base.rate_known,
            base.force_known,
            self.biases[0:3],
            self.biases[3:6],
            settings.gravity,
            self.position,
            self.velocity,
            self.quaternion,
        )
        transition = np.eye(STATES)
        transition[:9, :15] = jacobian
        decay = np.exp(-seconds / settings.attitude_time)
        transition[TOPIC, TOPIC] *= decay
        self.biases[6:9] *= decay
        noise = np.zeros((STATES, STATES))
        diagonal = np.einsum("ii->i", noise)
        push = self._accelerometer * (seconds - no_force) + settings.acceleration**2 * no_force
        diagonal[POSITION], diagonal[VELOCITY] = push * seconds**2 / 3.0, push
        for axis in range(3):
            noise[axis, 3 + axis] = noise[3 + axis, axis] = push * seconds / 2.0
        diagonal[ATTITUDE] = self._gyro * (seconds - no_rate) + settings.turn_rate**2 * no_rate
        diagonal[GYRO_BIAS] = settings.gyro_bias_walk**2 * seconds
        diagonal[ACCELEROMETER_BIAS] = settings.accelerometer_bias_walk**2 * seconds
        diagonal[TOPIC] = self._topic_sigma**2 * (1.0 - decay**2)
        diagonal[SCALE] = (settings.dvl_scale * 1e-4) ** 2 * seconds
        self.kalman.predict(F=transition, Q=noise)
        return transition, noise

    def _nominal(self, stamp_ns: int, first: int, last: int) -> Nominal:
        """The predicted state at a moment between two nodes."""
        base = self.base
        after = min(max(int(np.searchsorted(base.stamp_ns, stamp_ns)), first + 1), last) if last > first else last
        before = max(after - 1, first)
        gap = base.stamp_ns[after] - base.stamp_ns[before]
        w = (stamp_ns - base.stamp_ns[before]) / gap if gap else 0.0
        one, two = self.quaternion[before], self.quaternion[after]
        quaternion = one * (1.0 - w) + (two if one @ two >= 0.0 else -two) * w
        quaternion /= np.sqrt(quaternion @ quaternion)
        rate = base.rate[before] * (1.0 - w) + base.rate[after] * w - self.biases[0:3]
        return Nominal(
            position=self.position[before] * (1.0 - w) + self.position[after] * w,
            velocity=self.velocity[before] * (1.0 - w) + self.velocity[after] * w,
            quaternion=quaternion,
            matrix=matrix(quaternion),
            rate=rate if base.rate_known[before] else np.zeros(3),
            topic=self.biases[6:9],
            scale=float(self.biases[9]),
        )

    def _update(self, due: list[tuple[int, int]], first: int, last: int, transition: Floats) -> Floats:
        """Gate every measurement, fold all that pass into the state at once; the correction (STATES,)."""
        passed: list[tuple[Floats, Floats, Floats]] = []
        span = self.base.seconds[last] - self.base.seconds[first]
        for which, index in due:
            source = self.sources[which]
            stamp = int(source.stamp_ns[index])
            innovation, jacobian = source.look(index, self._nominal(stamp, first, last))
            age = (self.base.stamp_ns[last] - stamp) * 1e-9
            if age > 0.0 and span > 0.0:  # the error then, told by the error at the node: first-order inverse of F
                jacobian = jacobian + (age / span) * (jacobian - jacobian @ transition)
            if self._passes(source, stamp * 1e-9, innovation, jacobian, source.variance[index]):
                passed.append((innovation, jacobian, source.variance[index]))
        if not passed:
            return np.zeros(STATES)
        innovation = np.concatenate([one[0] for one in passed])
        stacked = np.concatenate([one[1] for one in passed])
        variance = np.zeros((len(innovation), len(innovation)))
        row = 0
        for _, _, part in passed:
            variance[row : row + len(part), row : row + len(part)] = part
            row += len(part)
        self.kalman.update(innovation, R=variance, H=stacked)
        self.kalman.P = 0.5 * (self.kalman.P + self.kalman.P.T)
        correction = self.kalman.x.copy()
        self.kalman.x[:] = 0.0
        self.position[last] += correction[POSITION]
        self.velocity[last] += correction[VELOCITY]
        self.quaternion[last] = turn(correction[ATTITUDE], self.quaternion[last])
        self.biases += correction[GYRO_BIAS.start :]
        return correction

    def _passes(self, source: Source, now: float, innovation: Floats, jacobian: Floats, variance: Floats) -> bool:
        """Mahalanobis gate that widens while a sensor is refused without a break: the filter may be the wrong one."""
        tally = self.tallies[source.name]
        expected = jacobian @ self.kalman.P @ jacobian.T + variance
        squared = float(innovation @ np.linalg.solve(expected, innovation))
        tally.ratios.extend((innovation**2 / np.diag(expected)).tolist())
        refused_for = 0.0 if tally.first_refusal is None else now - tally.first_refusal
        if squared > self._gates[len(innovation)] * (1.0 + refused_for / source.patience) ** 2:
            tally.rejected += 1
            tally.first_refusal = now if tally.first_refusal is None else tally.first_refusal
            return False
        tally.accepted += 1
        tally.first_refusal = None
        return True


def start_covariance(
    quaternion: Floats, arm: Floats, sigma: dict[str, Floats], topic_sigma: Floats, settings: NavigateSettings
) -> Floats:
    """Covariance (STATES, STATES) of a start that knows base_link, not the IMU at `arm`, to sigma["position"].

    sigma: 1 sigma (3,) of "position" m, "velocity" m/s, "attitude" rad.
    """
    diagonal = np.zeros(STATES)
    diagonal[POSITION], diagonal[VELOCITY] = sigma["position"], sigma["velocity"]
    diagonal[ATTITUDE] = sigma["attitude"]
    diagonal[GYRO_BIAS], diagonal[ACCELEROMETER_BIAS] = settings.gyro_bias, settings.accelerometer_bias
    diagonal[TOPIC], diagonal[SCALE] = topic_sigma, settings.dvl_scale
    lever = np.eye(STATES)
    lever[POSITION, ATTITUDE] = -cross_matrix(matrix(quaternion) @ arm)
    return lever @ np.diag(diagonal**2) @ lever.T
