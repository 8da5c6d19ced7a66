"""Attitude from the gyro alone, its bias removed by the trend against what else knows the attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Navigation, Stamps
from garbi_map.navigate.inertial import Flags, Inertial, prepare_inertial
from garbi_map.navigate.settings import NavigateSettings

_TREND_RATE = 5.0  # Hz: biases are slow, more samples would only repeat themselves
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
    """Integrate the gyro and remove its bias by the trend against the attitude topic, or against gravity without one.

    The residual's model is a constant rotation and -integral(R b dt), b constant or linear between knots for long
    dives; Cauchy weights, since a disturbed compass is wrong for seconds on end. None where the log has no gyro.
    """
    series = inertial or prepare_inertial(log, settings)
    if series is None or not series.rate_known.any() or series.rate_derived:
        return None
    topic = np.isfinite(series.attitude[:, 0])
    if topic.sum() > 10:
        return _Trend(series, settings, "attitude topic", topic).solve()
    reference = "gravity" if series.force_known.any() else "none"
    return _Trend(series, settings, reference, series.force_known).solve()


class _Trend:
    """The least squares of one dive: unknown are a rotation (3) and the bias at K knots (3 K)."""

    def __init__(self, series: Inertial, settings: NavigateSettings, reference: str, usable: Flags) -> None:
        self.series, self.settings, self.reference, self.usable = series, settings, reference, usable
        self.seconds = series.seconds
        duration = float(self.seconds[-1])
        bins = np.floor(self.seconds * _TREND_RATE).astype(np.int64)
        self.coarse = np.unique(bins, return_index=True)[1]
        self.used = usable[self.coarse]
        count = round(duration / _BIAS_KNOTS) + 1 if duration > 1.5 * _BIAS_KNOTS else 1
        self.knots = np.linspace(0.0, duration, count)
        self.bias = np.zeros((count, 3))
        self.floor = np.array([settings.attitude_tilt, settings.attitude_tilt, settings.attitude_yaw])

    def solve(self) -> GyroAttitude:
        start = self._first_start(self._integrated())
        duration = float(self.seconds[-1])
        stages = max(0, int(np.ceil(np.log(max(duration, 1.0) / _HORIZON) / np.log(4.0)))) + 1
        for horizon in np.repeat(_HORIZON * 4.0 ** np.arange(stages), _ROUNDS):
            change, covariance, columns = self._solve_linear(start * self._integrated(), horizon)
            start = Rotation.from_rotvec(change[:3]) * start
            self.bias += change[3:].reshape(-1, 3)
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
            bias_sigma=np.sqrt(np.diag(mean @ covariance[3:, 3:] @ mean.T)),
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
        if self.reference == "none":
            return Rotation.identity()
        picked = self.coarse[self.used]
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

    def _residual(self, path: Rotation, rows: np.ndarray) -> Floats:
        """Rotation (n, 3), map axes, by which the reference says the path is wrong; gravity says nothing of yaw."""
        if self.reference == "attitude topic":
            return (Rotation.from_quat(self.series.attitude[rows]) * path[rows].inv()).as_rotvec()
        force = path[rows].apply(self.series.specific_force[rows])
        size = np.maximum(np.linalg.norm(force, axis=1), 1.0)
        return np.stack([force[:, 1] / size, -force[:, 0] / size, np.zeros(len(rows))], axis=1)

    def _solve_linear(self, path: Rotation, horizon: float) -> tuple[Floats, Floats, Floats]:
        """One Gauss-Newton step on the data before `horizon` seconds.

        Gives the change (3 + 3K,), its covariance, and the model's columns (n, 3, 3 + 3K).
        """
        settings = self.settings
        seconds = self.seconds[self.coarse]
        step = np.diff(seconds, prepend=seconds[0])[:, None, None, None]
        turned = path[self.coarse].as_matrix()[:, :, None, :] * self._hats(seconds)[:, None, :, None]
        middle = 0.5 * (turned + np.concatenate([turned[:1], turned[:-1]]))
        drift = -np.cumsum(middle * step, axis=0).reshape(len(seconds), 3, -1)
        columns = np.concatenate([np.broadcast_to(np.eye(3), (len(seconds), 3, 3)), drift], axis=2)
        prior = self._prior()
        normal, right = prior.copy(), -prior @ np.concatenate([np.zeros(3), self.bias.ravel()])
        used = self.used & (seconds <= horizon)
        if self.reference != "none" and used.any():
            residual, fit = self._residual(path, self.coarse[used]), columns[used]
            if self.reference == "attitude topic":
                sigma = np.maximum(self.series.attitude_sigma, self.floor)
                memory, axes = settings.attitude_time, slice(0, 3)
            else:
                sigma = np.full(3, settings.acceleration / settings.gravity)
                memory, axes = _SWAY_TIME, slice(0, 2)
            # errors that last for `memory` seconds: that many samples count as one
            weight = np.full(residual.shape, 1.0) / sigma**2 / max(1.0, 2.0 * memory * _TREND_RATE)
            change = np.zeros(columns.shape[2])
            for _ in range(_REWEIGHTINGS):
                left = residual - fit @ change
                scale = np.maximum(1.4826 * np.median(np.abs(left), axis=0), 0.5 * sigma)
                robust = (weight / (1.0 + (left / (2.0 * scale)) ** 2))[:, axes]
                rows = fit[:, axes]
                normal = prior + np.einsum("nai,na,naj->ij", rows, robust, rows, optimize=True)
                pull = right + np.einsum("nai,na,na->i", rows, robust, residual[:, axes], optimize=True)
                change = np.linalg.solve(normal, pull)
        else:
            change = np.linalg.solve(normal, right)
        return change, np.asarray(np.linalg.inv(normal), float), columns

    def _prior(self) -> Floats:
        """Information (3 + 3K, 3 + 3K): of the start where no topic gives it, of the bias and of its wandering."""
        settings, count = self.settings, len(self.knots)
        information = np.zeros((3 + 3 * count, 3 + 3 * count))
        tilt, yaw = {"attitude topic": (10.0, 10.0), "gravity": (10.0, 1e-4), "none": (settings.tilt, 1e-4)}[
            self.reference
        ]
        information[:3, :3] = np.diag([tilt**-2, tilt**-2, yaw**-2])
        information[3:, 3:] = np.eye(3 * count) / (settings.gyro_bias**2 * count)
        if count > 1:
            difference = np.kron(np.diff(np.eye(count), axis=0), np.eye(3))
            wander = settings.gyro_bias_walk**2 * float(self.knots[1])
            information[3:, 3:] += difference.T @ difference / wander
        return information

    def _disturbed(self, path: Rotation) -> Flags:
        out = np.zeros(len(self.seconds), bool)
        if self.reference == "attitude topic":
            rows = np.flatnonzero(self.usable)
            yaw = np.abs(self._residual(path, rows)[:, 2])
            out[rows] = yaw > 4.0 * max(1.4826 * float(np.median(yaw)), self.settings.attitude_yaw)
        return out
