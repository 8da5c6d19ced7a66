"""Error-state Kalman filter forward in time."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from garbi_map.log.records import Floats
from garbi_map.navigate.inertial import Inertial
from garbi_map.navigate.kernels import matrix, propagate, turn
from garbi_map.navigate.observations import Nominal, Source
from garbi_map.navigate.process import ProcessModel, Step
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.start import Start
from garbi_map.navigate.states import ATTITUDE, GYRO_BIAS, POSITION, STATES, TOPIC, VELOCITY
from garbi_map.navigate.timebase import Timebase

_NO_DOUBT = np.zeros(STATES)


@dataclass
class Tally:
    """What became of one sensor's measurements; ratios are squared innovations over what the filter expected,
    shares how much of that expectation is the sensor's own noise."""

    accepted: int = 0
    rejected: int = 0
    ratios: array[float] = field(default_factory=lambda: array("f"))
    shares: array[float] = field(default_factory=lambda: array("f"))
    first_refusal: float | None = None

    def typical(self) -> float:
        """Robust mean of the ratios, 1 for a filter that knows its noise."""
        return float(np.median(self.ratios) / 0.4549) if self.ratios else float("nan")


@dataclass(frozen=True, slots=True)
class Node:
    """One step of the forward pass, all that the smoother wants of it.

    step         how the filter came here
    correction   (STATES,) what the update folded into the nominal state
    biases       (STATES - 9,) of the nominal state after the update
    covariance   upper triangle of the covariance after the update
    """

    sample: int
    step: Step
    correction: Floats
    biases: Floats
    covariance: Floats


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
        self.model = ProcessModel(inertial, settings)
        self._doubt = _NO_DOUBT

    def run(self) -> Iterator[Node]:
        """One node after another; what has been measured since the node before is folded in at each."""
        nodes = self.base.nodes
        queue = self._in_time_order()
        waiting = next(queue, None)
        step, transition = Step(0.0, np.eye(9, 15), 0.0, 0.0, self._doubt), np.eye(STATES)
        triangle = np.triu_indices(STATES)
        for order, sample in enumerate(nodes):
            before = nodes[order - 1] if order else 0
            if order:
                step, transition = self._predict(before, sample)
            due: list[tuple[int, int]] = []
            while waiting is not None and self.base.stamp_ns[sample] >= waiting[0]:
                due.append(waiting[1:])
                waiting = next(queue, None)
            correction = self._update(due, before, sample, transition)
            yield Node(sample, step, correction, self.biases.copy(), self.kalman.P[triangle])

    def _in_time_order(self) -> Iterator[tuple[int, int, int]]:
        """(stamp_ns, source, index) of every measurement."""
        if not self.sources:
            return
        stamps = np.concatenate([source.stamp_ns for source in self.sources])
        which = np.repeat(np.arange(len(self.sources)), [len(source.stamp_ns) for source in self.sources])
        index = np.concatenate([np.arange(len(source.stamp_ns)) for source in self.sources])
        for i in np.argsort(stamps, kind="stable"):
            yield int(stamps[i]), int(which[i]), int(index[i])

    def _predict(self, first: int, last: int) -> tuple[Step, Floats]:
        base = self.base
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
            self.settings.gravity,
            self.position,
            self.velocity,
            self.quaternion,
        )
        step = Step(base.seconds[last] - base.seconds[first], jacobian, no_rate, no_force, self._doubt)
        self._doubt = _NO_DOUBT
        transition = self.model.transition(step)
        self.biases[TOPIC.start - 9 : TOPIC.stop - 9] *= self.model.decay(step)
        self.kalman.predict(F=transition, Q=self.model.noise(step))
        return step, transition

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
        """Mahalanobis gate. A sensor that is refused for longer than its patience makes the filter doubt itself."""
        tally = self.tallies[source.name]
        expected = jacobian @ self.kalman.P @ jacobian.T + variance
        squared = float(innovation @ np.linalg.solve(expected, innovation))
        tally.ratios.extend((innovation**2 / np.diag(expected)).tolist())
        tally.shares.append(float(np.trace(variance) / np.trace(expected)))
        if squared > self._gates[len(innovation)]:
            tally.rejected += 1
            tally.first_refusal = now if tally.first_refusal is None else tally.first_refusal
            if now - tally.first_refusal > source.patience:
                self._doubt = self._doubt.copy()
                self._doubt[source.part] = float(innovation @ innovation)
                tally.first_refusal = None
            return False
        tally.accepted += 1
        tally.first_refusal = None
        return True
