"""Attitude from the gyro alone, its bias removed by the trend against what else knows the attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Navigation, Stamps
from garbi_map.navigate.inertial import Flags, Inertial, prepare_inertial
from garbi_map.navigate.process import topic_sigma
from garbi_map.navigate.settings import NavigateSettings

_TREND_RATE = 5.0  # Hz: biases are slow, more samples would only repeat themselves
_TREND_SAMPLES = 5000  # at most, so that long dives stay small
_BIAS_KNOTS = 120.0  # s between the knots of a bias that may wander
_HORIZON = 60.0  # s that are fitted first; four times as many in each next stage, lest a biased gyro wraps around
_ROUNDS = 2
_REWEIGHTINGS = 8
_SWAY_TIME = 2.0  # s, for which the vehicle's own acceleration keeps its direction


@dataclass(frozen=True)
class GyroAttitude:
    """The attitude whose short-term shape is the gyro's and whose mean and trend are the attitude topic's.

    stamp_ns     (n,) int64, those of the inertial series
    quaternion   (n, 4) xyzw, map <- base_link
    sigma        (n, 3) rad, 1 sigma of the rotation error, map axes
    bias         (3,) rad/s, mean of the gyro's bias over the dive, base_link axes; bias_sigma (3,)
    bias_series  (n, 3) rad/s, the bias as it wandered
    disturbed    (n,) bool, the topic's yaw contradicts the gyro (a magnetometer near iron)
    reference    "attitude topic", "gravity" (yaw starts at 0) or "none" (starts level, yaw 0)
    """

    stamp_ns: Stamps
    quaternion: Floats
    sigma: Floats
    bias: Floats
    bias_sigma: Floats
    bias_series: Floats
    disturbed: Flags
    reference: str


def gyro_attitude(log: Navigation, settings: NavigateSettings, inertial: Inertial | None = None) -> GyroAttitude | None:
    """Integrate the gyro and remove its bias by the trend against the attitude topic and the direction of gravity.

    The residual's model is a constant rotation and -integral(R b dt), b constant or linear between knots for long
    dives; Cauchy weights, since a disturbed compass is wrong for seconds on end. None where the log has no gyro.
    """
    series = inertial or prepare_inertial(log, settings)
    if series is None or not series.rate_known.any() or series.rate_derived:
        return None
    return _Trend(series, settings).solve()


@dataclass(frozen=True)
class _Witness:
    """Something that knows the attitude: at samples `rows`, for so many axes (yaw is the third), with errors of `sigma`
    (3,) rad that last for `memory` seconds."""

    name: str
    rows: np.ndarray
    axes: int
    sigma: Floats
    memory: float


class _Trend:
    """The least squares of one dive: unknown are a rotation (3), the bias at K knots (3 K), and by how much a biased
    accelerometer misses the vertical (2)."""

    def __init__(self, series: Inertial, settings: NavigateSettings) -> None:
        self.series, self.settings = series, settings
        self.seconds = series.seconds
        duration = float(self.seconds[-1])
        self.rate = min(_TREND_RATE, _TREND_SAMPLES / max(duration, 1.0))
        bins = np.floor(self.seconds * self.rate).astype(np.int64)
        self.coarse = np.unique(bins, return_index=True)[1]
        count = round(duration / _BIAS_KNOTS) + 1 if duration > 1.5 * _BIAS_KNOTS else 1
        self.knots = np.linspace(0.0, duration, count)
        self.bias = np.zeros((count, 3))
        self.witnesses = self._called()
        self.reference = self.witnesses[0].name if self.witnesses else "none"

    def _called(self) -> list[_Witness]:
        """Who can be asked: the attitude topic, the specific force, both or none."""
        settings, out = self.settings, []
        topic = self.coarse[np.isfinite(self.series.attitude[self.coarse, 0])]
        if len(topic) > 2:
            sigma = topic_sigma(self.series, settings)
            out.append(_Witness("attitude topic", topic, 3, sigma, settings.attitude_time))
        force = self.coarse[self.series.force_known[self.coarse]]
        if len(force) > 2:
            sway = np.full(3, settings.acceleration / settings.gravity)
            out.append(_Witness("gravity", force, 2, sway, _SWAY_TIME))
        return out

    def solve(self) -> GyroAttitude:
        start = self._first_start(self._integrated())
        duration = float(self.seconds[-1])
        stages = max(0, int(np.ceil(np.log(max(duration, 1.0) / _HORIZON) / np.log(4.0)))) + 1
        for horizon in np.repeat(_HORIZON * 4.0 ** np.arange(stages), _ROUNDS):
            change, covariance, columns = self._solve_linear(start * self._integrated(), horizon)
            start = Rotation.from_rotvec(change[:3]) * start
            self.bias += change[3:-2].reshape(-1, 3)
        path = start * self._integrated()
        spread = np.einsum("nij,jk,nik->ni", columns, covariance, columns)
        at, coarse = self.seconds, self.seconds[self.coarse]
        sigma = np.sqrt(np.stack([np.interp(at, coarse, column) for column in spread.T], axis=1))
        mean = np.tile(np.eye(3) / len(self.bias), len(self.bias))
        return GyroAttitude(
            stamp_ns=self.series.stamp_ns,
            quaternion=path.as_quat(),
            sigma=sigma,
            bias=self.bias.mean(axis=0),
            bias_sigma=np.sqrt(np.diag(mean @ covariance[3:-2, 3:-2] @ mean.T)),
            bias_series=self._bias_at(at),
            disturbed=self._disturbed(path),
            reference=self.reference,
        )

    def _hats(self, seconds: Floats) -> Floats:
        """Linear hat functions (n, K) of the bias knots."""
        if len(self.knots) == 1:
            return np.ones((len(seconds), 1))
        return np.stack([np.interp(seconds, self.knots, unit) for unit in np.eye(len(self.knots))], axis=1)

    def _bias_at(self, seconds: Floats) -> Floats:
        if len(self.knots) == 1:
            return np.broadcast_to(self.bias, (len(seconds), 3)).copy()
        return np.stack([np.interp(seconds, self.knots, column) for column in self.bias.T], axis=1)

    def _integrated(self) -> Rotation:
        from garbi_map.navigate.kernels import integrate_rates

        rate = np.ascontiguousarray(self.series.rate)
        return Rotation.from_quat(integrate_rates(self.seconds, rate, self._bias_at(self.seconds)))

    def _first_start(self, integrated: Rotation) -> Rotation:
        """Roughly, map <- base_link at the first sample."""
        if not self.witnesses:
            return Rotation.identity()
        picked = self.witnesses[0].rows
        picked = picked[self.seconds[picked] <= self.seconds[picked[0]] + _HORIZON]
        if self.reference == "attitude topic":
            votes = Rotation.from_quat(self.series.attitude[picked]) * integrated[picked].inv()
            middle = votes.mean()
            for _ in range(_REWEIGHTINGS):  # a disturbed compass must not pull the first guess
                error = (votes * middle.inv()).as_rotvec()
                middle = votes.mean(weights=1.0 / np.maximum(np.linalg.norm(error, axis=1), 1e-3))
            return middle
        early = picked[self.seconds[picked] <= self.seconds[picked[0]] + 10.0]
        up = integrated[early].apply(self.series.specific_force[early]).mean(axis=0)
        level, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])
        return Rotation.from_euler("z", -level.as_euler("ZYX")[0]) * level

    def _residual(self, witness: str, path: Rotation, rows: np.ndarray) -> Floats:
        """Rotation (n, 3), map axes, by which a witness says the path is wrong; gravity says nothing of yaw."""
        if witness == "attitude topic":
            return (Rotation.from_quat(self.series.attitude[rows]) * path[rows].inv()).as_rotvec()
        force = path[rows].apply(self.series.specific_force[rows])
        size = np.maximum(np.linalg.norm(force, axis=1), 1.0)
        return np.stack([force[:, 1] / size, -force[:, 0] / size, np.zeros(len(rows))], axis=1)

    def _columns(self, path: Rotation) -> Floats:
        """What a unit of each unknown turns the path by, at the coarse samples: (n, 3, 3 + 3K + 2) rad, map axes."""
        seconds = self.seconds[self.coarse]
        step = np.diff(seconds, prepend=seconds[0])[:, None, None, None]
        turned = path[self.coarse].as_matrix()[:, :, None, :] * self._hats(seconds)[:, None, :, None]
        middle = 0.5 * (turned + np.concatenate([turned[:1], turned[:-1]]))
        drift = -np.cumsum(middle * step, axis=0).reshape(len(seconds), 3, -1)
        start = np.broadcast_to(np.eye(3), (len(seconds), 3, 3))
        return np.concatenate([start, drift, np.zeros((len(seconds), 3, 2))], axis=2)

    def _solve_linear(self, path: Rotation, horizon: float) -> tuple[Floats, Floats, Floats]:
        """One Gauss-Newton step on the data before `horizon` seconds.

        Gives the change (3 + 3K + 2,), its covariance, and the model's columns.
        """
        columns = self._columns(path)
        prior = self._prior()
        known = np.concatenate([np.zeros(3), self.bias.ravel(), np.zeros(2)])
        asked = []
        for witness in self.witnesses:
            rows = witness.rows[self.seconds[witness.rows] <= horizon]
            fit = columns[np.searchsorted(self.coarse, rows), : witness.axes]
            if witness.name == "gravity":
                fit[:, :, -2:] = np.eye(2)
            asked.append((witness, self._residual(witness.name, path, rows)[:, : witness.axes], fit))
        change = np.zeros(columns.shape[2])
        for _ in range(_REWEIGHTINGS):
            normal, pull = prior.copy(), -prior @ known
            for witness, residual, fit in asked:
                weight = self._weights(witness, residual - fit @ change)
                normal += np.einsum("nai,na,naj->ij", fit, weight, fit, optimize=True)
                pull += np.einsum("nai,na,na->i", fit, weight, residual, optimize=True)
            change = np.linalg.solve(normal, pull)
        return change, np.asarray(np.linalg.inv(normal), float), columns

    def _weights(self, witness: _Witness, left: Floats) -> Floats:
        """Cauchy weights (n, axes); of errors that last for `memory` seconds, all samples in them count as one."""
        sigma = witness.sigma[: witness.axes]
        if len(left) == 0:
            return left
        scale = np.maximum(1.4826 * np.median(np.abs(left), axis=0), 0.5 * sigma)
        alike = max(1.0, 2.0 * witness.memory * self.rate)
        return 1.0 / (sigma**2 * alike * (1.0 + (left / (2.0 * scale)) ** 2))

    def _prior(self) -> Floats:
        """Information on the unknowns: the start where no topic gives it, the bias, its wandering, the vertical."""
        settings, count = self.settings, len(self.knots)
        information = np.zeros((5 + 3 * count, 5 + 3 * count))
        bias = slice(3, 3 + 3 * count)
        tilt, yaw = {"attitude topic": (10.0, 10.0), "gravity": (10.0, 1e-4), "none": (settings.tilt, 1e-4)}[
            self.reference
        ]
        information[:3, :3] = np.diag([tilt**-2, tilt**-2, yaw**-2])
        information[bias, bias] = np.eye(3 * count) / (settings.gyro_bias**2 * count)
        if count > 1:
            difference = np.kron(np.diff(np.eye(count), axis=0), np.eye(3))
            wander = settings.gyro_bias_walk**2 * float(self.knots[1])
            information[bias, bias] += difference.T @ difference / wander
        information[-2:, -2:] = np.eye(2) * (settings.gravity / settings.accelerometer_bias) ** 2
        return information

    def _disturbed(self, path: Rotation) -> Flags:
        out = np.zeros(len(self.seconds), bool)
        rows = np.flatnonzero(np.isfinite(self.series.attitude[:, 0]))
        if len(rows):
            yaw = np.abs(self._residual("attitude topic", path, rows)[:, 2])
            out[rows] = yaw > 4.0 * max(1.4826 * float(np.median(yaw)), self.settings.attitude_yaw)
        return out
