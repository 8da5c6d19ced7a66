"""Scan to map: each sweep against the map of the sweeps before it, with kiss-icp.

kiss-icp's kernel adds metres to square metres, so that it is right for cars in metres and for this scanner in centimetres;
its own de-skewing and its constant-velocity guess are of no use for a sweep of seconds under sway, so points come de-skewed
by our trajectory and the guess is the correction of the sweep before. Point to point, on surfels that lie on the same
grid in every sweep, it brings a sweep near but does not slide it the last centimetre: the surfels' planes do that (Chen and
Medioni, 1992). No covariance comes back: the information is that of
point to plane at the solution (Censi, ICRA 2007), and directions that the geometry does not fix are not corrected (solution
remapping: Zhang, Kaess and Singh, ICRA 2016).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.register.settings import FrontEndSettings
from garbi_map.register.surfels import Surfels, match_surfels
from garbi_map.register.thinning import earliest

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CENTIMETRES = 100.0
_MATCH_SIGMA = 1e-3
"""m, of one matched surfel."""
_PLANE_ROUNDS = 6


@dataclass(frozen=True)
class Constraint:
    """Two sweeps seen to be related: correction of `second` relative to `first`.

    transform (4, 4): first <- second in the map frame, metres; identity where the trajectory was right already.
    information (6, 6) of (translation m, rotation rad) about the map's axes at `centre` (3,).
    """

    first: int
    second: int
    transform: Floats
    information: Floats
    centre: Floats
    uncertain: bool


class ScanToMap:
    """kiss-icp with a local voxel map of its own."""

    def __init__(self, settings: FrontEndSettings) -> None:
        from kiss_icp.mapping import VoxelHashMap
        from kiss_icp.registration import Registration

        self._settings = settings
        # one thread: with two, kiss-icp sums in a different order at each run and no map could be made twice
        self._registration = Registration(max_num_iterations=200, convergence_criterion=1e-5, max_num_threads=1)
        self._map = VoxelHashMap(
            settings.voxel * _CENTIMETRES, settings.local_map * _CENTIMETRES, settings.points_per_voxel
        )

    def align(self, points: Floats, guess: Floats) -> Floats:
        """map <- points (4, 4) in metres, for points (n, 3) of one sweep and a guess (4, 4)."""
        if self._map.empty():
            return guess
        settings = self._settings
        start = guess.copy()
        start[:3, 3] *= _CENTIMETRES
        found = self._registration.align_points_to_map(
            points * _CENTIMETRES,
            self._map,
            start,
            settings.correspondence * _CENTIMETRES,
            settings.kernel * _CENTIMETRES,
        )
        found[:3, 3] /= _CENTIMETRES
        return found

    def insert(self, points: Floats, transform: Floats) -> None:
        """Adds a sweep's points (n, 3), moved by transform (4, 4), and forgets what is far from it."""
        moved = (points @ transform[:3, :3].T + transform[:3, 3]) * _CENTIMETRES
        self._map.add_points(moved)
        self._map.remove_far_away_points(moved.mean(axis=0))


def scan_to_map(surfels: Surfels, settings: FrontEndSettings) -> tuple[list[Floats], list[Constraint]]:
    """The correction (4, 4) of each sweep in order, and what relates it to the earlier sweep that it overlaps most.

    surfels: of all sweeps, placed by the trajectory as it is known; sweep numbers 0..k-1.
    """
    front_end = ScanToMap(settings)
    count = int(surfels.sweep.max()) + 1 if len(surfels.sweep) else 0
    corrections: list[Floats] = []
    constraints: list[Constraint] = []
    pairs = _overlaps(surfels, settings)
    for sweep in range(count):
        points = surfels.mean[surfels.sweep == sweep]
        guess = corrections[-1] if corrections else np.eye(4)
        if len(points) == 0:
            corrections.append(guess)
            continue
        found = front_end.align(points, guess)
        # what has no say in a direction must not move along it
        earlier = {first: rows for (first, second), rows in pairs.items() if second == sweep}
        if earlier:
            first = max(earlier, key=lambda key: len(earlier[key][0]))
            rows = tuple(np.concatenate([pair[k] for pair in earlier.values()]) for k in (0, 1))
            information, centre = information_of(surfels, rows[1])
            before = _picked(surfels, rows[0]).moved(np.array(corrections))
            found = onto_planes(_picked(surfels, rows[1]), before, found, settings)
            found = guess @ remap(np.linalg.inv(guess) @ found, information, centre, settings.weakest)
            relative = np.linalg.inv(corrections[first]) @ found
            constraints.append(Constraint(first, sweep, relative, information, centre, uncertain=False))
        else:
            found = guess
        front_end.insert(points, found)
        corrections.append(found)
    return corrections, constraints


def close_loops(surfels: Surfels, corrections: list[Floats], settings: FrontEndSettings) -> list[Constraint]:
    """Constraints between sweeps that see the same ground but are not neighbours in time, each by kiss-icp.

    Verified: the surfels of the two must agree afterwards to a few millimetres and in most places.
    """
    moved = surfels.moved(np.reshape(corrections, (-1, 4, 4)))
    loops = []
    for (first, second), rows in _promising(_overlaps(moved, settings), settings):
        front_end = ScanToMap(settings)
        front_end.insert(moved.mean[moved.sweep == first], np.eye(4))
        points = moved.mean[np.unique(rows[1])]
        information, centre = information_of(moved, rows[1])
        found = front_end.align(points, np.eye(4))
        found = onto_planes(_picked(moved, rows[1]), _picked(moved, rows[0]), found, settings)
        found = remap(found, information, centre, settings.weakest)
        if not _agrees(moved, rows, found, settings):
            continue
        relative = np.linalg.inv(corrections[first]) @ found @ corrections[second]
        loops.append(Constraint(first, second, relative, information, centre, uncertain=True))
    return loops


def _promising(
    pairs: dict[tuple[int, int], tuple[Ints, Ints]], settings: FrontEndSettings
) -> list[tuple[tuple[int, int], tuple[Ints, Ints]]]:
    """Pairs that may be loops: of each later sweep those few that overlap it most, neighbours in time left out."""
    of_sweep: dict[int, list[tuple[tuple[int, int], tuple[Ints, Ints]]]] = {}
    for (first, second), rows in pairs.items():
        if second - first >= 2 and len(rows[0]) >= settings.loop_matches:
            of_sweep.setdefault(second, []).append(((first, second), rows))
    return [
        pair
        for candidates in of_sweep.values()
        for pair in sorted(candidates, key=lambda pair: -len(pair[1][0]))[: settings.loops_per_sweep]
    ]


def onto_planes(surfels: Surfels, planes: Surfels, transform: Floats, settings: FrontEndSettings) -> Floats:
    """The transform (4, 4) that lays surfels on the planes of their n counterparts, from one that is near.

    Symmetric point to plane (Rusinkiewicz, 2019) with Cauchy weights; weak directions keep the transform's.
    """
    for _ in range(_PLANE_ROUNDS):
        normal = surfels.normal @ transform[:3, :3].T + planes.normal
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        mean = surfels.mean @ transform[:3, :3].T + transform[:3, 3]
        distance = np.einsum("nk,nk->n", normal, mean - planes.mean)
        scale = max(2.0 * 1.4826 * float(np.median(np.abs(distance))), 1e-4)
        weight = 1.0 / (1.0 + (distance / scale) ** 2)
        centre = mean.mean(axis=0)
        jacobian = np.hstack([normal, np.cross(mean - centre, normal)])
        values, vectors = np.linalg.eigh(jacobian.T @ (jacobian * weight[:, None]))
        strong = values / _MATCH_SIGMA**2 > settings.weakest
        step = vectors[:, strong] @ (vectors[:, strong].T @ (jacobian.T @ (weight * -distance)) / values[strong])
        move = np.eye(4)
        move[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        move[:3, 3] = centre + step[:3] - move[:3, :3] @ centre
        transform = move @ transform
    return transform


def _picked(surfels: Surfels, rows: Ints) -> Surfels:
    return Surfels(*(getattr(surfels, field.name)[rows] for field in fields(surfels)))


def _overlaps(surfels: Surfels, settings: FrontEndSettings) -> dict[tuple[int, int], tuple[Ints, Ints]]:
    """For each pair of sweeps that overlap, the matched surfels of both; of a place that many sweeps saw, the first few are
    those that later ones are paired with."""
    known = earliest(surfels, settings.correspondence, settings.sweeps_per_place)
    first, second = match_surfels(surfels, settings.correspondence, np.inf, known)
    key = surfels.sweep[first] * (int(surfels.sweep.max(initial=0)) + 1) + surfels.sweep[second]
    order = np.argsort(key, kind="stable")
    cuts = np.flatnonzero(np.diff(key[order])) + 1
    pairs = {}
    for rows in np.split(order, cuts) if len(order) else []:
        pairs[int(surfels.sweep[first[rows[0]]]), int(surfels.sweep[second[rows[0]]])] = (first[rows], second[rows])
    return pairs


def information_of(surfels: Surfels, rows: Ints, sigma: float = _MATCH_SIGMA) -> tuple[Floats, Floats]:
    """Point-to-plane information (6, 6) of surfels about their centre (3,), for 1 sigma metres each."""
    mean, normal = surfels.mean[rows], surfels.normal[rows]
    centre = mean.mean(axis=0)
    jacobian = np.hstack([normal, np.cross(mean - centre, normal)])
    return jacobian.T @ jacobian / sigma**2, centre


def remap(transform: Floats, information: Floats, centre: Floats, weakest: float) -> Floats:
    """The transform without its part along directions with less information than `weakest` per surfel pair sigma."""
    values, vectors = np.linalg.eigh(information)
    rotation = Rotation.from_matrix(transform[:3, :3])
    shift = transform[:3, 3] + rotation.apply(centre) - centre
    motion = np.r_[shift, rotation.as_rotvec()]
    kept = vectors[:, values > weakest]
    motion = kept @ (kept.T @ motion)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(motion[3:]).as_matrix()
    out[:3, 3] = motion[:3] + centre - out[:3, :3] @ centre
    return out


def _agrees(surfels: Surfels, rows: tuple[Ints, Ints], transform: Floats, settings: FrontEndSettings) -> bool:
    first, second = rows
    moved = surfels.mean[second] @ transform[:3, :3].T + transform[:3, 3]
    distance = np.abs(np.einsum("nk,nk->n", moved - surfels.mean[first], surfels.normal[first]))
    return bool(np.median(distance) < settings.loop_agreement)
