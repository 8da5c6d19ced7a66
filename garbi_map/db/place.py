"""A further dive finds its place in the map: first by its relief, then patch by patch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from garbi_map.db.settings import PlaceSettings
from garbi_map.db.submaps import Pose, Submap
from garbi_map.register.surfels import Surfels, extract_surfels
from garbi_map.seabed.relief import Guess, find_shifts

Floats = NDArray[np.float64]

_HEADING_STEP = np.deg2rad(2.0)
_CANDIDATES = 12
_COARSE = (0.10, 0.08, 0.06, 0.04, 0.03)
_FINE = (0.03, 0.02, 0.02, 0.015, 0.01, 0.01, 0.01, 0.01)
"""m, within which the partner of a patch is looked for, round after round."""
_SAME_FACE = np.cos(np.deg2rad(25.0))
_COMMON = 0.04
"""m, horizontally, between patches that see the same ground, whether or not they agree about it."""
_SMALLEST = 2e-4
"""m; patches are not believed to be better than this."""
_TUKEY = 4.7
"""Times the spread, beyond which a patch has no say: what moved between the dives does not pull."""
_APART = 0.05
"""m between two places that are not the same."""
_RIVAL = 0.9
"""Share of the best place's agreement that no other place may reach."""


@dataclass(frozen=True)
class Placement:
    """Where a dive lies in the map.

    transform   (4, 4) map <- frame of the dive
    overlap     m^2 of ground that both saw
    agreement   share of it on which the two lie within PlaceSettings.agreement
    residual    m, median distance of the patches that agree
    sigma       (6,) 1 sigma of translation, m, and rotation, rad, about the middle of the common ground
    """

    transform: Floats
    overlap: float
    agreement: float
    residual: float
    sigma: Floats


def surfels_of(submap: Submap, pose: Pose, number: int, settings: PlaceSettings) -> Surfels:
    """The planar patches of a submap in `map`."""
    first = np.r_[True, np.diff(submap.stamp_ns) != 0]
    profile = np.cumsum(first) - 1
    count = int(profile[-1]) + 1
    return extract_surfels(
        pose.apply(submap.points),
        submap.sigma,
        profile.astype(np.int32),
        (submap.stamp_ns[first] - submap.stamp_ns[0]) * 1e-9,
        np.full(count, number, np.int64),
        pose.apply(submap.origin[first]),
        settings.surfel_size,
        settings.surfel_points,
    )


def place(known: Surfels, surfels: Surfels, settings: PlaceSettings) -> Placement | str:
    """The place of a dive's surfels on the known ones, or, in words, why it has none that is sure.

    Depth and tilt are known to what pressure and gravity tell, the heading to a compass, the place not at all.
    """
    why = "they have no ground in common that can be recognised"
    if not len(known.mean) or not len(surfels.mean):
        return why
    ground = _Ground(known)
    near = np.arange(-np.deg2rad(settings.heading), np.deg2rad(settings.heading) + 1e-9, _HEADING_STEP)
    around = np.arange(-np.pi, np.pi, 2 * _HEADING_STEP)
    for headings, cell in ((near, settings.cell), (around, 2 * settings.cell)):
        guesses = find_shifts(known.mean, surfels.mean, headings, cell, settings.least_overlap, _CANDIDATES)
        found = _best(ground, surfels, guesses, settings)
        if isinstance(found, Placement):
            return found
        why = found or why
    return why


def _best(ground: _Ground, surfels: Surfels, guesses: list[Guess], settings: PlaceSettings) -> Placement | str:
    """The place that most of the common ground agrees with, refined; no other place may come near it."""
    thinned = slice(None, None, max(1, len(surfels.mean) // 4000))
    few = Surfels(*(getattr(surfels, name)[thinned] for name in ("mean", "normal", "time", "sweep", "thickness")))
    tried = []
    for guess in guesses:
        transform = _laid(ground, few, ground.settled(few, _transform(guess)), _COARSE)
        tried.append((ground.agreement(few, transform, settings), transform))
    tried.sort(key=lambda one: -one[0].score)
    if not tried or tried[0][0].share < settings.least_agreement or tried[0][0].area < settings.least_overlap:
        return ""
    best, transform = tried[0]
    middle = surfels.mean.mean(axis=0)
    place_of = _moved(middle, transform)
    rivals = [one.score for one, other in tried if np.linalg.norm(_moved(middle, other) - place_of) > _APART]
    if rivals and max(rivals) > _RIVAL * best.score:
        return "it fits the map in more than one place"
    transform = _laid(ground, surfels, transform, _FINE)
    return ground.placement(surfels, transform, settings)


@dataclass(frozen=True)
class _Agreement:
    share: float
    area: float

    @property
    def score(self) -> float:
        return self.share * self.area


class _Ground:
    """The surfels of the map, to be looked up."""

    def __init__(self, known: Surfels) -> None:
        self._known = known
        self._tree = cKDTree(known.mean)
        self._flat = cKDTree(known.mean[:, :2])

    def settled(self, surfels: Surfels, transform: Floats) -> Floats:
        """The transform, raised or lowered until the common ground lies at one height: depths differ between dives."""
        mean = _moved(surfels.mean, transform)
        distance, nearest = self._flat.query(mean[:, :2], distance_upper_bound=_COMMON)
        common = np.isfinite(distance)
        out = transform.copy()
        if common.any():
            out[2, 3] += float(np.median(self._known.mean[nearest[common], 2] - mean[common, 2]))
        return out

    def matches(self, surfels: Surfels, transform: Floats, gate: float) -> tuple[NDArray, Floats, Floats, Floats]:
        """Rows (m,) of surfels with a partner, where they lie (m, 3), common normals (m, 3) and distances (m,) m."""
        mean, normal = _moved(surfels.mean, transform), surfels.normal @ transform[:3, :3].T
        distance, nearest = self._tree.query(mean, distance_upper_bound=gate)
        rows = np.flatnonzero(np.isfinite(distance))
        rows = rows[np.einsum("nk,nk->n", normal[rows], self._known.normal[nearest[rows]]) > _SAME_FACE]
        partner = nearest[rows]
        common = normal[rows] + self._known.normal[partner]
        common /= np.linalg.norm(common, axis=1, keepdims=True)
        return rows, mean[rows], common, np.einsum("nk,nk->n", common, mean[rows] - self._known.mean[partner])

    def agreement(self, surfels: Surfels, transform: Floats, settings: PlaceSettings) -> _Agreement:
        """On how much ground both have, and on which share of it they agree."""
        mean = _moved(surfels.mean, transform)
        common = np.isfinite(self._flat.query(mean[:, :2], distance_upper_bound=_COMMON)[0])
        rows, _, _, apart = self.matches(surfels, transform, _COARSE[-1])
        seen = np.zeros(len(mean), bool)
        seen[rows[np.abs(apart) < settings.agreement]] = True
        patches = np.unique(np.floor(mean[common, :2] / settings.surfel_size).astype(np.int64), axis=0)
        area = len(patches) * settings.surfel_size**2
        return _Agreement(float(seen[common].mean()) if common.any() else 0.0, area)

    def placement(self, surfels: Surfels, transform: Floats, settings: PlaceSettings) -> Placement | str:
        """The finished placement, where it is sure."""
        found = self.agreement(surfels, transform, settings)
        if found.share < settings.least_agreement or found.area < settings.least_overlap:
            return ""
        _, mean, normal, apart = self.matches(surfels, transform, _FINE[-1])
        good = np.abs(apart) < settings.agreement
        jacobian, _ = _jacobian(mean[good], normal[good])
        spread = max(1.4826 * float(np.median(np.abs(apart[good]))), _SMALLEST)
        information = jacobian.T @ jacobian / spread**2
        if np.linalg.eigvalsh(information)[0] < settings.weakest:
            return "the ground that they have in common is too flat to tell where on it they are"
        sigma = np.sqrt(np.diag(np.linalg.inv(information)))
        return Placement(transform, found.area, found.share, float(np.median(np.abs(apart[good]))), sigma)


def _laid(ground: _Ground, surfels: Surfels, transform: Floats, gates: tuple[float, ...]) -> Floats:
    """The transform that lays surfels on the ground: symmetric point to plane (Rusinkiewicz, 2019), Tukey's weights."""
    for gate in gates:
        rows, mean, normal, apart = ground.matches(surfels, transform, gate)
        if len(rows) < 12:
            return transform
        spread = max(1.4826 * float(np.median(np.abs(apart))), _SMALLEST)
        weight = np.maximum(1.0 - (apart / (_TUKEY * spread)) ** 2, 0.0) ** 2
        jacobian, centre = _jacobian(mean, normal)
        normal_matrix = jacobian.T @ (jacobian * weight[:, None])
        values, vectors = np.linalg.eigh(normal_matrix)
        strong = values > 1e-4 * values[-1]
        step = vectors[:, strong] @ ((vectors[:, strong].T @ (jacobian.T @ (weight * -apart))) / values[strong])
        move = np.eye(4)
        move[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        move[:3, 3] = centre + step[:3] - move[:3, :3] @ centre
        transform = move @ transform
    return transform


def _jacobian(mean: Floats, normal: Floats) -> tuple[Floats, Floats]:
    centre = mean.mean(axis=0)
    return np.hstack([normal, np.cross(mean - centre, normal)]), centre


def _transform(guess: Guess) -> Floats:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", guess.heading).as_matrix()
    out[:2, 3] = guess.shift
    return out


def _moved(points: Floats, transform: Floats) -> Floats:
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])
