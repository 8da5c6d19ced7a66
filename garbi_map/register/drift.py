"""Motion inside and between sweeps, from what the sweeps see twice: turning points first.

At a turning point of the laser the same ground is seen twice within a fraction of a second, so that the two views fit
whatever the trajectory is. Matches near in time fix the velocity there, two velocities and the accelerometer between them
fix tilt and bias, and then matches farther apart in time come within reach. Each round makes surfels with the motion as it
is known, matches those that are near in space and time, and solves one linear least-squares problem for all of the motion.
Relatives: Bosse and Zlot, Continuous 3D scan-matching (ICRA 2009); Ramezani et al., Wildcat (2022).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from garbi_map.navigate.kernels import place_points
from garbi_map.register.constants import Constants
from garbi_map.register.factors import Calm, Factor, Patience
from garbi_map.register.motion import Motion, Rows
from garbi_map.register.normal_equations import NormalEquations
from garbi_map.register.normals import Normals, common_normals, summed_normals
from garbi_map.register.overlap import fitting, seen_by_both
from garbi_map.register.scanner import Changes
from garbi_map.register.settings import DriftSettings
from garbi_map.register.surfels import Surfels, extract_surfels, join, match_surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_REACH = (
    *(0.6, 0.6, 0.9, 1.3, 1.3, 2.0, 2.0, 2.0, 3.0, 3.0, 4.5, 4.5),
    *(7.0, 10.0, 10.0, 20.0, 40.0, 80.0),
    *(np.inf,) * 8,
)
"""Longest time between matched surfels in each round, s."""
_NEAR = 12
"""Rounds that stay near in time: what they find is true locally, wherever the vehicle is."""
_RESTRAINED = 4
"""Rounds in which a prior on the velocity keeps the inertial solution from running away."""
_PATIENCE = 6
"""Rounds before clocks have a say: earlier ones, of few matches and many false, would set them wrong by tens of
milliseconds, from where matches of nearest neighbours bring them back slowly."""
_LATE = 3
"""Rounds more before sweeps that do not fit each other are left out where the encoder may be late, which keeps all of them
apart until it is found."""
_SETTLING = 4
"""Last rounds, of the finest surfels, in which what is left of the scanner's own constants is found."""
_FINE = (1.0, 0.6)
"""Sizes of the surfels of the last rounds: large ones are surer of their normal, small ones follow the relief."""
_LATERAL = 0.03
"""How much a surface leaves its tangent plane: a match is that share of its lateral offset less sure."""


@dataclass(frozen=True)
class Scans:
    """Profiles in base_link, metres, and their times.

    points (n, 3), sigma (n,) m, profile (n,) index of each point's profile; time (m,) s and sweep (m,) of each profile;
    changes: what constants of the motion do to the points, beside moving them all.
    """

    points: Floats
    sigma: NDArray[np.float32]
    profile: NDArray[np.int32]
    time: Floats
    sweep: NDArray[np.int64]
    changes: Changes | None = None

    @cached_property
    def _changes(self) -> dict[str, Floats]:
        return {} if self.changes is None else self.changes(self.points, self.time[self.profile])

    def as_known(self, constants: Constants) -> Floats:
        """The points (n, 3) in base_link as the constants have them."""
        points = self.points
        for name, change in self._changes.items():
            points = points + constants.number(name) * change
        return points

    def surfels(self, motion: Motion, size: float, fewest: int, corner: Floats | None = None) -> Surfels:
        """Surfels of every sweep as the motion has them; two threads take half of the sweeps each.

        corner (3,) m: of one of the voxels, if it is not the map's origin.
        """
        corner = np.zeros(3) if corner is None else corner
        matrix, viewpoint = motion.rotation(self.time).as_matrix(), motion.position(self.time) - corner
        known = self.as_known(motion.constants)

        def part(points: slice) -> Surfels:
            profile = self.profile[points]
            placed = place_points(known[points], profile, matrix, viewpoint)
            return extract_surfels(placed, self.sigma[points], profile, self.time, self.sweep, viewpoint, size, fewest)

        with ThreadPoolExecutor(2) as pool:
            found = join(*pool.map(part, self._halves))
        return replace(found, mean=found.mean + corner)

    @cached_property
    def _halves(self) -> tuple[slice, slice]:
        """The points of the earlier and of the later sweeps, about as many of both."""
        sweep = self.sweep[self.profile]
        middle = int(np.searchsorted(sweep, sweep[len(sweep) // 2])) if len(sweep) else 0
        return slice(0, middle), slice(middle, len(sweep))


@dataclass(frozen=True)
class Round:
    """What one round found: how far apart in time, the number of matches, their median distance m, the largest step m."""

    reach: float
    matches: int
    distance: float
    step: float


def estimate_drift(
    scans: Scans,
    motion: Motion,
    factors: Sequence[Factor],
    settings: DriftSettings,
    near_only: bool = False,
    far_only: bool = False,
    elsewhere: Surfels | None = None,
    progress: Callable[[Round], None] = lambda _: None,
) -> tuple[list[Round], NormalEquations]:
    """Moves `motion` until the sweeps agree; returns what each round found, and the problem at the end, whose information
    takes no noise of normals for slopes.

    near_only stops before matches far apart in time, far_only begins with them. elsewhere: surfels of settled sweeps that
    are not among the scans.
    """
    count = len(_REACH)
    chosen = range(_NEAR) if near_only else range(_NEAR if far_only else 0, count)
    gates = np.r_[np.geomspace(settings.coarse_gate, settings.gate, count - 2), [settings.gate] * 2]
    sizes = np.r_[np.linspace(settings.coarse_surfel_size, settings.surfel_size, count - 4), [settings.surfel_size] * 4]
    sigmas = np.r_[np.geomspace(settings.coarse_match_sigma, settings.match_sigma, count - 1), settings.match_sigma]
    checked = _PATIENCE if scans.changes is None else _PATIENCE + _LATE
    restraint, patience = Calm(settings.attitude_knots / 2, 0.15, derivative=1), Patience()

    def linearised(k: int, normals: Normals) -> tuple[NormalEquations, int, float]:
        problem = NormalEquations(motion.size, motion.order)
        for factor in factors:
            factor.add(problem, motion)
        if k < _RESTRAINED:
            restraint.add(problem, motion)
        if k < _PATIENCE:
            patience.add(problem, motion)
        matches, distance = 0, 0.0
        settling = k >= count - _SETTLING
        fractions = _FINE if settling else (1.0,)
        changes = scans.changes if settling or _PATIENCE <= k < _NEAR else None
        for fraction in fractions:
            surfels = scans.surfels(motion, sizes[k] * fraction, settings.surfel_points)
            belief = Belief(sigmas[k], sizes[k] if k < _NEAR else None, k >= checked, len(fractions))
            found = matched(motion, surfels, gates[k], _REACH[k], belief, elsewhere, normals, changes)
            distance = 0.0
            if found is not None:
                found.add_to(problem)
                matches, distance = matches + len(found.residual), found.distance
        return problem, matches, distance

    rounds: list[Round] = []
    for k in chosen:
        problem, matches, distance = linearised(k, summed_normals)
        step = problem.solve()
        motion.step(step)
        for factor in factors:
            factor.reestimate(motion)
        rounds.append(Round(_REACH[k], matches, distance, float(np.abs(step[: motion.attitude_offset]).max())))
        progress(rounds[-1])
    return rounds, linearised(chosen[-1], common_normals)[0]


@dataclass(frozen=True)
class Belief:
    """How far matches are believed: 1 sigma, m, at no lateral offset; voxel: size, m, of the surfels, if those beyond the
    edge of the other sweep are to be left out; strict: whether sweeps that do not fit each other are; looks: how often the
    same points are matched, as surfels of several sizes."""

    sigma: float
    voxel: float | None = None
    strict: bool = False
    looks: int = 1


@dataclass(frozen=True)
class Matches:
    """n . (m_i - m_j) = 0 for n matched surfels: residual (n,) m, 1 sigma (n,) m, what they touch, and where they are
    (n, 3) m, map frame."""

    residual: Floats
    sigma: Floats
    rows: Rows
    place: Floats

    @property
    def distance(self) -> float:
        """Median, m."""
        return float(np.median(np.abs(self.residual)))

    def add_to(self, problem: NormalEquations) -> None:
        """Adds what they say."""
        problem.add(self.residual, self.sigma, self.rows.runs, 2.0, self.rows.tail)


def matched(
    motion: Motion,
    surfels: Surfels,
    gate: float,
    reach: float,
    belief: Belief,
    settled: Surfels | None = None,
    normals: Normals = summed_normals,
    changes: Changes | None = None,
) -> Matches | None:
    """What matched surfels say of the motion and of what else changes their points; None where there is no match.

    Both poses are unknown, but for a settled surfel's, which stays where it is.
    """
    moving = len(surfels.mean)
    moves = {} if changes is None else _map_axes(changes, motion, surfels)
    if settled is not None:
        surfels = join(surfels, settled)
    first, second = match_surfels(surfels, gate, reach)
    useful = (first < moving) | (second < moving)
    first, second = first[useful], second[useful]
    if belief.voxel is not None:
        whole = seen_by_both(surfels, first, second, belief.voxel)
        first, second = first[whole], second[whole]
    if len(first) == 0:
        return None
    pair = surfels.sweep[first] * (surfels.sweep.max() + 1) + surfels.sweep[second]
    normal = normals(surfels.normal[first], surfels.normal[second], pair)
    between = surfels.mean[first] - surfels.mean[second]
    residual = np.einsum("nk,nk->n", normal, between)
    if belief.strict:
        fits = fitting(residual, pair, belief.sigma)
        first, second = first[fits], second[fits]
        normal, between, residual = normal[fits], between[fits], residual[fits]
        if len(first) == 0:
            return None
    lateral = np.sqrt(np.maximum(np.einsum("nk,nk->n", between, between) - residual**2, 0.0))

    # the normal turns with the two surfels, half with each; held still, it would tie the whole map to a heading
    turning = 0.5 * np.cross(normal, between)

    def rows(index: Ints, sign: float) -> Rows:
        t = np.clip(surfels.time[index], motion.begin, motion.end)
        free = (index < moving)[:, None]
        axes = np.where(free, sign * normal, 0.0)
        arm = surfels.mean[index] - motion.position(t)
        out = motion.rows(t).position(axes).rotation(np.cross(arm, axes) + np.where(free, turning, 0.0))
        for name, move in moves.items():
            move = move[np.minimum(index, moving - 1)]
            out.constant(name, np.einsum("nk,nk->n", axes, move[:, :3]))
            if move.shape[1] > 3:
                out.constant(name, np.where(free[:, 0], -0.5 * residual * move[:, 3], 0.0))
        return out

    sigmas = np.hypot(belief.sigma, _LATERAL * lateral) * np.sqrt(belief.looks * _repetition(first, second))
    middle = 0.5 * (surfels.mean[first] + surfels.mean[second])
    return Matches(residual, sigmas, rows(first, 1.0) + rows(second, -1.0), middle)


def _map_axes(changes: Changes, motion: Motion, surfels: Surfels) -> dict[str, Floats]:
    """How the constants move the surfels (n, 3), map axes, and what comes after (n, 0 or 1), as it is."""
    t = np.clip(surfels.time, motion.begin, motion.end)
    rotation = motion.rotation(t)
    body = rotation.inv().apply(surfels.mean - motion.position(t))
    changed = changes(body, t).items()
    return {name: np.column_stack([rotation.apply(change[:, :3]), change[:, 3:]]) for name, change in changed}


def _repetition(first: Ints, second: Ints) -> Floats:
    """How many times over (m,) each match says what others say: N views of a place make N (N - 1) / 2 matches, N - 1 of
    them independent, and the sum over all of them is N / 2 times the squares about the mean of the views."""
    partners = np.bincount(np.concatenate([first, second])).astype(np.float64)
    return 0.5 + 0.25 * (partners[first] + partners[second])
