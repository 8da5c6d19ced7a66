"""The rigid motion that lays one map on another, found on what did not change."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, minimum_filter
from scipy.spatial.transform import Rotation

from garbi_map.compare.coarse import guesses
from garbi_map.compare.maps import MapFolder
from garbi_map.compare.settings import AlignmentSettings
from garbi_map.errors import GarbiError
from garbi_map.seabed.relief import Guess, relief_of
from garbi_map.words import length, percent

Floats = NDArray[np.float64]

_SMOOTH = 1.2
"""Cells over which both surfaces are smoothed alike before they are compared."""
_RIM = 4
"""Cells along the rim that take no part."""
_MOST = 60_000
"""Cells of the second map that take part."""
_FLOOR = 2e-4
"""m; no cell is believed to be better than that."""
_FAR = 8.0
"""Times the median distance (5 standard deviations): what lies farther apart has changed."""
_TRIAL = 3
"""Rounds after which the coarse guesses are told apart."""


@dataclass(frozen=True)
class Alignment:
    """x_first = rotation x_second + shift.

    rotation     (3, 3)
    shift        (3,) m
    centre       (3,) m, first map: what the covariance's rotation is about
    covariance   (6, 6) of a rotation vector (rad) about the centre and a shift (m)
    overlap      share of the smaller map's cells that the other shows
    explained    share of the relief's variance (of medians) that both have in common
    residual     m, median distance of what overlaps
    """

    rotation: Floats
    shift: Floats
    centre: Floats
    covariance: Floats
    overlap: float
    explained: float
    residual: float

    def apply(self, points: Floats) -> Floats:
        """Points (n, 3) m of the second map in the frame of the first."""
        return points @ self.rotation.T + self.shift

    def variance(self, points: Floats, normals: Floats) -> Floats:
        """Variance (n,) m^2 by which the alignment errs at points (n, 3), first map, along unit normals (n, 3)."""
        row = np.concatenate([np.cross(points - self.centre, normals), normals], axis=1)
        return np.einsum("ni,ij,nj->n", row, self.covariance, row)


def align(first: MapFolder, second: MapFolder, settings: AlignmentSettings) -> Alignment:
    """Six numbers: every heading and shift by correlation of the reliefs, then robust least squares of elevations.

    What has changed is left to the robust weights (Geman and McClure's), whose gate closes round by round.
    Raises GarbiError where the maps do not show the same site, and where it is too flat to tell.
    """
    ground = _Ground(first, settings.relief_scale)
    loose = _Ground(second, settings.relief_scale)
    points, sigma = loose.sample()
    starts = guesses(first, second, settings)
    trials = [
        _fitted(_start(guess, points, ground), ground, points, sigma, settings.gates[:_TRIAL]) for guess in starts
    ]
    good = [trial for trial in trials if trial is not None]
    if not good:
        raise _apart(first, second, "no part of one is like a part of the other")
    good.sort(key=lambda motion: ground.misfit(_moved(points, *motion)))
    fine = _fitted(good[0], ground, points, sigma, settings.gates[_TRIAL - 1 :])
    if fine is None:
        raise _apart(first, second, "what seemed alike does not fit")
    found = _judged(fine, ground, loose, points, sigma, settings)
    relief = ground.noise()
    if found.overlap < settings.least_overlap:
        raise _apart(first, second, f"only {percent(max(found.overlap, 0.0))} of the smaller one overlaps")
    if found.explained < settings.least_explained:
        flat = relief < 3.0
        why = "the site is too flat to tell where they lie; give --as-is if both have one origin"
        raise _apart(first, second, why if flat else f"where they fit best they are {length(found.residual)} apart")
    return found


def as_is(first: MapFolder, second: MapFolder, settings: AlignmentSettings) -> Alignment:
    """No motion, for maps that have one origin; raises GarbiError where they do not overlap."""
    ground, loose = _Ground(first, settings.relief_scale), _Ground(second, settings.relief_scale)
    points, sigma = loose.sample()
    motion = (np.eye(3), np.zeros(3))
    found = replace(_judged(motion, ground, loose, points, sigma, settings), covariance=np.zeros((6, 6)))
    if found.overlap < settings.least_overlap:
        raise _apart(first, second, f"only {percent(max(found.overlap, 0.0))} of the smaller one overlaps")
    return found


def _apart(first: MapFolder, second: MapFolder, why: str) -> GarbiError:
    return GarbiError(f"{first.path} and {second.path} cannot be laid on each other: {why}")


Motion = tuple[Floats, Floats]


class _Ground:
    """A map's surface, slightly smoothed, with its slopes, to look places up in."""

    def __init__(self, one: MapFolder, scale: float) -> None:
        self.one = one
        known = one.known
        weight = gaussian_filter(known.astype(float), _SMOOTH, mode="constant")
        total = gaussian_filter(np.where(known, one.elevation, 0.0), _SMOOTH, mode="constant")
        near = weight > 0.2
        self._mean = float(one.elevation[known].mean())
        self._height = np.where(near, total / np.maximum(weight, 1e-9), self._mean)
        self._near = near
        slope = np.gradient(self._height, one.cell) if min(known.shape) > 1 else [np.zeros(known.shape)] * 2
        self._slope = (slope[1], slope[0])
        # at the rim the smoothed surface is that of the cells farther in
        self._inside = minimum_filter(near, 1 + 2 * _RIM, mode="constant").astype(float)
        self._sigma = np.where(known, one.uncertainty, np.nan)
        self._relief = relief_of(np.where(known, self._height, np.nan), one.cell, scale)[known]

    def noise(self) -> float:
        """How many times the relief stands out of the uncertainty of a cell."""
        deviation = np.median(np.abs(self._relief - np.median(self._relief)))
        return float(1.4826 * deviation / max(np.nanmedian(self._sigma), _FLOOR))

    def sample(self) -> tuple[Floats, Floats]:
        """Places (k, 3) m of the smoothed surface, evenly thinned, and their sigma (k,) m."""
        row, column = np.nonzero(self.one.known & (self._inside > 0))
        step = max(1, len(row) // _MOST)
        row, column = row[::step], column[::step]
        x = self.one.origin[0] + (column + 0.5) * self.one.cell
        y = self.one.origin[1] + (row + 0.5) * self.one.cell
        return np.stack([x, y, self._height[row, column]], axis=1), self._sigma[row, column]

    def under(self, points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Height (n,) of points (n, 3) over the surface along its normal, the normals (n, 3), and where it is known."""
        place = np.stack(
            [
                (points[:, 1] - self.one.origin[1]) / self.one.cell - 0.5,
                (points[:, 0] - self.one.origin[0]) / self.one.cell - 0.5,
            ]
        )
        inside = map_coordinates(self._inside, place, order=1, mode="constant") > 0.999
        height = map_coordinates(self._height, place, order=1, mode="nearest")
        east, north = (map_coordinates(slope, place, order=1, mode="nearest") for slope in self._slope)
        normal = np.stack([-east, -north, np.ones(len(points))], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return (points[:, 2] - height) * normal[:, 2], normal, inside

    def misfit(self, points: Floats) -> float:
        """How badly points lie on the surface: median distance, over the root of the share that overlaps."""
        off, _, inside = self.under(points)
        share = float(inside.mean())
        return np.inf if share < 0.01 else float(np.median(np.abs(off[inside]))) / np.sqrt(share)


def _start(guess: Guess, points: Floats, ground: _Ground) -> Motion:
    """The guess with the height that fits."""
    rotation = Rotation.from_euler("z", guess.heading).as_matrix()
    shift = np.array([*guess.shift, 0.0])
    off, normal, inside = ground.under(points @ rotation.T + shift)
    if inside.any():
        shift[2] = -float(np.median(off[inside] / normal[inside, 2]))
    return rotation, shift


def _moved(points: Floats, rotation: Floats, shift: Floats) -> Floats:
    return points @ rotation.T + shift


def _fitted(
    motion: Motion | None, ground: _Ground, points: Floats, sigma: Floats, gates: tuple[float, ...]
) -> Motion | None:
    """Gauss-Newton steps, three for each gate; None where hardly anything overlaps."""
    if motion is None:
        return None
    rotation, shift = motion
    for gate in gates:
        for _ in range(3):
            normal_matrix, step, _ = _equations((rotation, shift), ground, points, sigma, gate)
            if normal_matrix is None:
                return None
            centre = _centre(ground)
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            rotation = turn @ rotation
            shift = turn @ (shift - centre) + centre + step[3:]
    return rotation, shift


def _centre(ground: _Ground) -> Floats:
    rows, columns = ground.one.elevation.shape
    x, y = (ground.one.origin[k] + 0.5 * n * ground.one.cell for k, n in enumerate((columns, rows)))
    return np.array([x, y, ground._mean])


def _equations(
    motion: Motion, ground: _Ground, points: Floats, sigma: Floats, gate: float
) -> tuple[Floats | None, Floats, Floats]:
    """Normal matrix (6, 6), step (6,) and, of each point that counts, place (k, 2) and score (k, 6)."""
    moved = _moved(points, *motion)
    off, normal, inside = ground.under(moved)
    if np.count_nonzero(inside) < 100:
        return None, np.zeros(6), np.zeros((0, 8))
    moved, off, normal = moved[inside], off[inside], normal[inside]
    row = np.concatenate([np.cross(moved - _centre(ground), normal), normal], axis=1)
    gate = min(gate, max(_FAR * float(np.median(np.abs(off))), _FLOOR))
    weight = 1.0 / (1.0 + (off / gate) ** 2) ** 2 / (sigma[inside] ** 2 + _FLOOR**2)
    weight *= normal[:, 2] ** 2  # a steep place is hardly known from above
    matrix = (row * weight[:, None]).T @ row
    matrix += 1e-9 * np.trace(matrix) * np.eye(6)
    score = row * (weight * off)[:, None]
    return matrix, -np.linalg.solve(matrix, score.sum(0)), np.concatenate([moved[:, :2], score], axis=1)


def _judged(
    motion: Motion, ground: _Ground, loose: _Ground, points: Floats, sigma: Floats, settings: AlignmentSettings
) -> Alignment:
    """What the fit is worth. Residuals within a block err as one: the covariance is that of clusters (Liang and Zeger,
    Longitudinal data analysis using generalized linear models, 1986)."""
    off, _, inside = ground.under(_moved(points, *motion))
    area = [np.count_nonzero(one.one.known) * one.one.cell**2 for one in (ground, loose)]
    overlap = float(inside.mean()) * area[1] / min(area) if inside.any() else 0.0
    matrix, _, scores = _equations(motion, ground, points, sigma, settings.gates[-1])
    if matrix is None:
        return Alignment(*motion, _centre(ground), np.zeros((6, 6)), min(overlap, 1.0), 0.0, np.inf)
    block = np.floor(scores[:, :2] / settings.block).astype(int)
    _, member = np.unique(block, axis=0, return_inverse=True)
    sums = np.stack([np.bincount(member.ravel(), column) for column in scores[:, 2:].T], axis=1)
    inverse = np.linalg.inv(matrix)
    residual = float(np.median(np.abs(off[inside])))
    relief = float(np.median(np.abs(ground._relief - np.median(ground._relief))))
    return Alignment(
        *motion,
        centre=_centre(ground),
        covariance=inverse @ (sums.T @ sums) @ inverse,
        overlap=min(overlap, 1.0),
        explained=max(0.0, 1.0 - (residual / max(relief, 1e-9)) ** 2),
        residual=residual,
    )
