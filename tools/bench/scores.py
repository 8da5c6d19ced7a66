"""What is measured of a trajectory: its cloud, its small stones, itself, and how well it knows its own error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from garbi_map.config import Config
from garbi_map.evaluate import CloudErrors, TrueSurface, rigid_alignment
from garbi_map.navigate import Trajectory
from garbi_map.seabed import AcceptedPoints, build_seabed
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore
from tools.bench.dives import BenchDive
from tools.bench.relief import find_stones, kept

Floats = NDArray[np.float64]

STEP_NS = 100_000_000
"""Poses this far apart are compared with their covariance."""
MOST_POINTS = 6_000_000
"""A cloud of more is thinned before it is measured."""


@dataclass(frozen=True)
class Honesty:
    """Normalised error squared per degree of freedom (1 is honest), and how many independent errors it is the mean of."""

    nees: float
    independent: float

    @property
    def band(self) -> tuple[float, float]:
        """Where 95 % of honest estimates are."""
        low, high = chi2.ppf([0.025, 0.975], self.independent) / self.independent
        return float(low), float(high)


@dataclass(frozen=True)
class Score:
    """stones, kept, relief: see relief.kept; position and attitude only where there is a covariance."""

    cloud: CloudErrors
    ate_mm: float
    attitude_deg: float
    stones: int
    kept_percent: float | None
    relief_percent: float | None
    position: Honesty | None = None
    attitude: Honesty | None = None


class Scorer:
    """The truth of one dive; every trajectory is measured through the same seabed stage."""

    def __init__(self, dive: BenchDive, config: Config) -> None:
        assert dive.truth.trajectory is not None and dive.truth.surface is not None
        self._dive, self._config = dive, config
        self.true = dive.truth.trajectory
        self._surface = TrueSurface(*dive.truth.surface)
        self._stones = find_stones(dive.truth)

    def floor(self) -> Score:
        """The figures of the true poses."""
        return self.score(self.true, cloud=self._true_cloud)

    def score(
        self,
        made: Trajectory,
        covariances: Trajectory | None = None,
        cloud: Floats | None = None,
        store: SweepStore | None = None,
    ) -> Score:
        """The figures of a trajectory.

        covariances: the same poses with the covariance inside the map, if there is one; cloud (n, 3): the accepted points
        in its map, made here if they are not given; store: the sweeps that it places, if they are not the dive's.
        """
        stamps = self._dive.store.stamps()
        stamps = stamps[(stamps >= self.true.stamp_ns[0]) & (stamps <= self.true.stamp_ns[-1])]
        here, there = made.at(stamps), self.true.at(stamps)
        rotation, shift = rigid_alignment(here, there)
        off = there.position - rotation.apply(here.position) - shift
        turned = (there.rotation * (rotation * here.rotation).inv()).magnitude()
        points = self._surface.aligned(
            rotation.apply(self._cloud(made, store or self._dive.store) if cloud is None else cloud) + shift
        )
        position, attitude = (None, None) if covariances is None else self._honesty(covariances)
        return Score(
            self._surface.errors(points, self._dive.truth.seen),
            1e3 * float(np.sqrt((off**2).sum(axis=1).mean())),
            float(np.degrees(np.sqrt((turned**2).mean()))),
            *kept(self._stones, self._reference, self._stones.heights_in(points)),
            position,
            attitude,
        )

    @cached_property
    def _reference(self) -> Floats:
        """Heights (n,) of the stones in the map of the true poses."""
        return self._stones.heights_in(self._surface.aligned(self._true_cloud))

    @cached_property
    def _true_cloud(self) -> Floats:
        return self._cloud(self.true, self._dive.store)

    def _cloud(self, trajectory: Trajectory, store: SweepStore) -> Floats:
        """The accepted points (n, 3) in the trajectory's map."""
        mount = self._dive.navigation.mount("rig")
        points: list[Floats] = []
        stride = thinning(store)

        def posed() -> Iterator[tuple[Sweep, Trajectory]]:
            for sweep in store:
                yield sweep, trajectory.at(sweep.stamp_ns).mounted(mount)

        def take(accepted: AcceptedPoints) -> None:
            points.append(accepted.points[::stride])

        build_seabed(posed, self._config.seabed, mount, take)
        return np.concatenate(points)

    def _honesty(self, made: Trajectory) -> tuple[Honesty, Honesty]:
        first, last = max(made.stamp_ns[0], self.true.stamp_ns[0]), min(made.stamp_ns[-1], self.true.stamp_ns[-1])
        stamps = np.arange(first, last + 1, STEP_NS)
        here, there = made.at(stamps), self.true.at(stamps)
        rotation, shift = rigid_alignment(here, there)
        matrix = rotation.as_matrix()
        off = there.position - rotation.apply(here.position) - shift
        turned = (there.rotation * (rotation * here.rotation).inv()).as_rotvec()
        position, attitude = (
            honesty(error, matrix @ here.covariance[:, part, part] @ matrix.T)
            for error, part in ((off, slice(0, 3)), (turned, slice(3, 6)))
        )
        return position, attitude


def thinning(store: SweepStore) -> int:
    """Every how many-th point is measured."""
    return -(-sum(entry.points for entry in store.entries) // MOST_POINTS)


def honesty(error: Floats, covariance: Floats) -> Honesty:
    """Errors (n, 3) at even times against their covariances (n, 3, 3).

    Neighbours err alike: the number of independent ones follows from the whitened errors' autocorrelation, summed as long
    as it is positive (Geyer, Practical Markov Chain Monte Carlo, 1992).
    """
    white = np.linalg.solve(np.linalg.cholesky(covariance), error[:, :, None])[:, :, 0]
    n = len(white)
    independent = 0.0
    for column in white.T:
        spectrum = np.abs(np.fft.rfft(column, 2 * n)) ** 2
        correlation = np.fft.irfft(spectrum)[:n] / np.arange(n, 0, -1)
        correlation = correlation / correlation[0]
        ends = np.flatnonzero(correlation <= 0)
        independent += n / (2.0 * correlation[: ends[0] if len(ends) else n].sum() - 1.0)
    return Honesty(float((white**2).mean()), max(independent, 3.0))


def together(parts: list[Honesty]) -> Honesty:
    """Several dives as one, each with the weight of its independent errors."""
    weight = np.array([part.independent for part in parts])
    return Honesty(float(np.average([part.nees for part in parts], weights=weight)), float(weight.sum()))
