"""Rig and motion at once: the rounds of the drift estimate again, with the rig among the unknowns.

A wrong rig bends every sweep in the same way in its own frame; seen again from another pose, the same ground is bent another
way. Each round triangulates all points anew with the rig as it is known by then, so that nothing hinges on a linear rig.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from garbi_map.calibrate.field_known import UNKNOWN, Flat, Known, flats
from garbi_map.calibrate.field_views import UnknownScanner, Views
from garbi_map.log.records import Floats, Stamps
from garbi_map.navigate import Trajectory
from garbi_map.register.constants import Constant
from garbi_map.register.drift import Belief, Matches, Scans, matched
from garbi_map.register.factors import Factor
from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations
from garbi_map.register.normals import Normals, common_normals, summed_normals
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings
from garbi_map.register.surfels import Surfels

ACCELEROMETER_SCALE = 0.02
"""1 sigma: what a rig does to ranges looks like a scale, and few accelerometers know theirs."""
ROUNDS = 13
_COARSE = 3
"""Of them, the first, in which hardly a match is doubted: those that contradict the given rig are the ones that count, and
a robust kernel that is narrow from the beginning keeps what suits that rig."""
_FINE = 5
"""Of them, the last, with surfels of two sizes as in the last rounds of the drift estimate."""
_SIZES = (0.7, 0.4)
"""Of them, voxels smaller than those of the drift estimate: a rig bends what a surfel smooths."""
_DOUBT = 1.5
"""Times the spread of the last round's residuals, 1 sigma of a match: neighbouring matches share the noise of a profile's
angle."""
_BOUNDS = (0.4, 2.0)
"""Times the drift estimate's sigma of a match, between which that stays."""
_SPREAD = np.array([0.8191725, 0.6710436, 0.5497005])
"""Of a voxel, by which the next voxels lie elsewhere (Roberts' quasi-random sequence): which points share a voxel is noise
that would otherwise follow the motion about, and hold it where it is."""
_FIRST_GATE = 0.06
"""m between matched surfels in the first round: the motion has been found with the given rig, and bends with it."""
_FIRST_SIGMA = 0.01
"""m, of a match in the coarse rounds."""
_PATH_STEP = 0.02
"""s between the poses that the motion begins with."""
_REGION = 0.25
"""m; places are held out by the squares of this size, as those of one colour of a chessboard."""
_MOST_HELD_OUT = 20_000


@dataclass(frozen=True)
class HeldOut:
    """What is predicted of n matches by the matches of other places.

    information (k, k) and pull (k,): of the other places, as in Evidence. Residuals of these are offset + slope @ z,
    (n,) and (n, k) m, with 1 sigma (n,) m, once the motion has been fitted to the other places with that z. region (n,):
    which square each lies in.
    """

    information: Floats
    pull: Floats
    offset: Floats
    slope: Floats
    sigma: Floats
    region: Floats


@dataclass(frozen=True)
class Evidence:
    """What a stretch of a dive says of the rig, whatever the motion: its cost is z' A z / 2 - pull' z, the prior left out.

    information A (k, k), pull (k,), with z as in RigUnknowns; distance: median between matched surfels, m; matches: their
    number.
    """

    information: Floats
    pull: Floats
    held_out: tuple[HeldOut, ...]
    distance: float
    matches: int


@dataclass
class Joint:
    """Motion and rig over one stretch; the motion begins with a path, the rig with z (k,)."""

    scanner: UnknownScanner
    sensors: Sensors
    settings: DriftSettings
    views: Views
    motion: Motion
    factors: list[Factor]
    known: list[Flat] = field(default_factory=list)
    _corner: Floats = field(default_factory=lambda: np.zeros(3))
    _sigmas: dict[float, float] = field(default_factory=dict)

    @classmethod
    def begin(
        cls,
        scanner: UnknownScanner,
        sensors: Sensors,
        settings: DriftSettings,
        views: Views,
        path: Trajectory,
        z: Floats,
        known: Known,
    ) -> Joint:
        """About a path of base_link that covers the views."""
        time = sensors.seconds(views.stamp_ns)
        names = [f"rig_{k}" for k in range(len(z))]
        scale = Constant("accelerometer_scale", ACCELEROMETER_SCALE, "1")
        planes = [Constant(name, UNKNOWN, "rad, rad, m", 3) for name in known.names]
        constants = [*sensors.constants(), scale, *planes, *(Constant(name, 1.0, "1") for name in names)]
        knots = settings.position_knots, sensors.attitude_knots(settings)
        motion = Motion(float(time[0]), float(time[-1]), sensors.prior_attitude, *knots, constants)
        t = motion.instants(_PATH_STEP)
        there = path.at(sensors.epoch_ns + np.round(t * 1e9).astype(np.int64))
        motion.fit(t, there.position, there.rotation)
        motion.constants.value[-len(z) :] = z
        start = motion.position(np.array([motion.begin]))[0]
        factors = sensors.factors(motion.begin, motion.end, settings, start)
        joint = cls(scanner, sensors, settings, views, motion, factors)
        joint.known = flats(known.patches, views, known.begin_ns, joint._placed)
        return joint

    @property
    def z(self) -> Floats:
        """(k,) the corrections as they are known."""
        return self.motion.constants.value[-len(self.scanner.unknowns.names) :].copy()

    def solve(self, rounds: Iterable[int] = range(ROUNDS)) -> None:
        """Moves motion and rig until the sweeps agree; rounds: those of the ROUNDS that are made."""
        for k in rounds:
            problem = self._problem(list(self._matches(k, summed_normals)))
            self.motion.step(problem.solve())
            for factor in self.factors:
                factor.reestimate(self.motion)

    def evidence(self) -> Evidence:
        """What the solved stretch says of the rig, and what places held out would have said; none of it without matches."""
        matches = list(self._matches(ROUNDS - 1, common_normals))
        if not matches:
            nothing = np.zeros(len(self.z))
            return Evidence(np.diag(nothing), nothing, (), float("nan"), 0)
        found = _Response(self._problem(matches), self.z)
        regions = [np.floor(part.place[:, :2] / _REGION).astype(np.int64) for part in matches]
        colours = [region.sum(axis=1) % 2 for region in regions]
        held_out = []
        for colour in (0, 1):
            others = [_part(part, own != colour) for part, own in zip(matches, colours, strict=True)]
            response = _Response(self._problem(others), self.z)
            # one size of surfels is enough to be looked at
            seen = np.flatnonzero(colours[0] == colour)
            seen = seen[:: max(1, -(-len(seen) // _MOST_HELD_OUT))]
            offset, slope = response.predicted(_part(matches[0], seen))
            region = regions[0][seen] @ np.array([1 << 20, 1])
            sigma = matches[0].sigma[seen]
            held_out.append(HeldOut(response.information, response.pull, offset, slope, sigma, region))
        distance = float(np.median(np.abs(matches[0].residual)))
        return Evidence(found.information, found.pull, tuple(held_out), distance, len(matches[0].residual))

    def _matches(self, k: int, normals: Normals) -> Iterator[Matches]:
        """What the surfels of round k say."""
        settings, fine = self.settings, k >= ROUNDS - _FINE
        gate = _between(_FIRST_GATE, settings.gate, k)
        sigma = _between(_FIRST_SIGMA, settings.match_sigma, k)
        size = _between(settings.coarse_surfel_size, settings.surfel_size, k)
        z = self.z
        views = self.views
        points = self.scanner.points(views, z)
        scans = Scans(points, views.sigma, views.profile, self.sensors.seconds(views.stamp_ns), views.sweep)

        def changes(points: Floats, t: Floats) -> dict[str, Floats]:
            moved = self.scanner.changes(points, self._stamps(t), z)
            return {f"rig_{j}": moved[:, :, j] for j in range(len(z))}

        sizes = _SIZES if fine else (1.0,)
        for fraction in sizes:
            voxel = size * fraction
            corner = voxel * ((self._corner + _SPREAD) % 1.0)
            self._corner = self._corner + _SPREAD
            surfels = self._lit_at_once(scans.surfels(self.motion, voxel, settings.surfel_points, corner))
            belief = Belief(self._sigmas.get(fraction, sigma), looks=len(sizes))
            found = matched(self.motion, surfels, gate, np.inf, belief, None, normals, changes)
            if found is None:
                continue
            if fine:
                least, most = (bound * settings.match_sigma for bound in _BOUNDS)
                self._sigmas[fraction] = float(np.clip(_DOUBT * 1.4826 * found.distance, least, most))
            yield found

    def _lit_at_once(self, surfels: Surfels) -> Surfels:
        """Those but where the laser turns and lingers: what moves their mean is not what moves the point of their mean
        time, and the few per cent that they are hold the scale of rig and motion where it is."""
        t = np.clip(surfels.time, self.motion.begin, self.motion.end)
        body = self.motion.rotation(t).inv().apply(surfels.mean - self.motion.position(t))
        return surfels.select(self.scanner.lit(body, self._stamps(t), self.z))

    def _problem(self, matches: list[Matches]) -> NormalEquations:
        problem = NormalEquations(self.motion.size)
        for factor in self.factors:
            factor.add(problem, self.motion)
        for part in matches:
            part.add_to(problem)
        for flat in self.known:
            views, z = self.views.part(flat.point), self.z
            when, points = self._when(views), self.scanner.points(views, z)
            moved = self.scanner.changes(points, self._stamps(when), z)
            flat.add(problem, self.motion, when, points, views.sigma.astype(np.float64), moved)
        return problem

    def _placed(self, which: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Points (n, 3) and where base_link is then (n, 3), map frame."""
        views = self.views.part(which)
        when = self._when(views)
        position = self.motion.position(when)
        return position + self.motion.rotation(when).apply(self.scanner.points(views, self.z)), position

    def _when(self, views: Views) -> Floats:
        return self.sensors.seconds(views.stamp_ns)[views.profile]

    def _stamps(self, t: Floats) -> Stamps:
        return self.sensors.epoch_ns + np.round(t * 1e9).astype(np.int64)


class _Response:
    """A problem with everything but its last k unknowns, the rig's, eliminated; z (k,): where it was linearised."""

    def __init__(self, problem: NormalEquations, z: Floats) -> None:
        cut = len(problem.vector) - len(z)
        matrix = problem.matrix[:cut, :cut].copy()
        matrix[np.diag_indices_from(matrix)] += 1e-9  # unknowns that no row touches
        crossed = problem.matrix[:cut, cut:]
        factored = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
        solved = cho_solve(factored, np.column_stack([problem.vector[:cut], crossed]), check_finite=False)
        self.rest, self.follow = -solved[:, 0], -solved[:, 1:]
        # the prior of z, of unit information about zero, is left out
        self.information = problem.matrix[cut:, cut:] + crossed.T @ self.follow - np.eye(len(z))
        gradient = problem.vector[cut:] + crossed.T @ self.rest - z
        self.pull = self.information @ z - gradient
        self._z = z

    def predicted(self, matches: Matches) -> tuple[Floats, Floats]:
        """Residuals of matches as offset (n,) and slope (n, k) by z, the eliminated unknowns following z."""
        count = len(self._z)
        moved = np.zeros((len(matches.residual), 1 + count))
        following = np.vstack([np.column_stack([self.rest, self.follow]), np.eye(1 + count)[1:]])
        for run in matches.rows.runs:
            moved += np.einsum("na,nak->nk", run.value, following[run.start[:, None] + np.arange(run.value.shape[1])])
        tail = matches.rows.tail
        moved += tail.value @ following[tail.columns]
        slope = moved[:, 1:]
        return matches.residual + moved[:, 0] - slope @ self._z, slope


def _between(first: float, last: float, k: int) -> float:
    """The first value in the coarse rounds, the last in the fine ones, the same factor each round between them."""
    share = min(max(k - _COARSE + 1, 0) / (ROUNDS - _FINE - _COARSE + 1), 1.0)
    return float(first ** (1.0 - share) * last**share)


def _part(matches: Matches, which: NDArray) -> Matches:
    rows = matches.rows.part(which)
    return Matches(matches.residual[which], matches.sigma[which], rows, matches.place[which])
