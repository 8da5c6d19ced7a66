"""What a calibration's covariance means in a map: how it bends the map inside, and how it displaces all of it.

A wrong rig bends every sweep in the same way. Registration lets the sweeps shift and turn until they agree, and what cannot
agree bends the map. To first order that is a linear network of sweeps, one for each principal error of the rig.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.field_rig import RigUnknowns, known_covariance
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.calibrate.uncertainty import alpha_through
from garbi_map.log.records import Floats, Mount
from garbi_map.navigate import Trajectory
from garbi_map.rig import Rig
from garbi_map.seabed import JudgedPoints, Seabed

Path = Callable[[NDArray[np.int64]], Trajectory]
"""Poses at stamps, with their covariances."""

CAREFUL = {
    "camera.alpha_u": 0.05,
    "camera.alpha_v": 0.05,
    "camera.u0": 0.05,
    "camera.v0": 0.05,
    "laser.x": 1e-4,
    "laser.y": 1e-4,
    "laser.delta": 5e-5,
    "laser.theta": 1e-4,
    "laser.gamma": 1e-4,
    "laser.beta": 1e-4,
}
"""1 sigma of a careful calibration's parameters, px, m and rad, for a rig file that does not tell its own."""
_SIDE = 0.05
"""m, side of the squares over which the errors of a rig hardly change; larger ones where there would be too many."""
_SQUARES = 20_000
_AGREEMENT = 3e-4
"""m, 1 sigma by which two sweeps agree over a square."""
_STEEPEST = 1.5
"""Slope beyond which the elevation of a cell is no one number."""


@dataclass(frozen=True, eq=False)
class View:
    """What looked: a rig, and how it is mounted, base_link <- rig."""

    rig: Rig
    mount: Mount


@dataclass(frozen=True)
class MapUncertainty:
    """1 sigma of the elevation, (rows, columns) m, of the cells of a seabed.

    bent        by the calibration, inside the map: what no rigid motion of the map can remove
    displaced   by the calibration, on Earth
    path        by the path, on Earth
    told        whether every rig file tells its covariance, else that of a careful calibration was taken for it
    """

    bent: Floats
    displaced: Floats
    path: Floats
    told: bool

    def carried_into(self, seabed: Seabed, level_sigma: float) -> Seabed:
        """The seabed with all of it in its uncertainties; level_sigma: m, 1 sigma of the level that heights count from."""
        inside = np.hypot(seabed.uncertainty, self.bent)
        earth = np.sqrt(seabed.uncertainty**2 + self.displaced**2 + self.path**2 + level_sigma**2)
        return replace(seabed, uncertainty=inside.astype(np.float32), absolute=earth.astype(np.float32))


def rig_errors(rig: Rig) -> tuple[RigUnknowns, bool]:
    """The parameters of a rig file that may be off, as its calibration tells, or those of a careful one; and which it was.

    The latency of the encoder is none of them: every dive tells its own.
    """
    entries: Any = (rig.extra.get("laser") or {}).get("calibration")
    free = entries.get("free") if isinstance(entries, dict) else None
    names = tuple(str(name) for name in free or () if name != LATENCY)
    covariance = known_covariance(rig, names)
    told = bool(covariance.any())
    if not told:
        names, covariance = tuple(CAREFUL), np.diag(np.square(list(CAREFUL.values())))
    return RigUnknowns(rig, names, np.asarray(np.linalg.cholesky(covariance), np.float64)), told


class MapSamples:
    """`add` the points of every sweep of a map; `uncertainty` says what the rigs' and the path's errors mean for it.

    Of every sweep one point in a square is kept: memory grows with the area seen, and how often.
    """

    def __init__(self, seabed: Seabed) -> None:
        self._seabed = seabed
        self._side = max(_SIDE, float(np.sqrt(seabed.area / _SQUARES)))
        rows, columns = seabed.elevation.shape
        self._shape = tuple(int(np.ceil(n * seabed.cell / self._side)) for n in (rows, columns))
        self._parts: list[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]] = []
        self._views: list[View] = []

    def add(self, points: JudgedPoints, view: View) -> None:
        """Take in the accepted points of one whole sweep, and what saw them."""
        if not len(points.points):
            return
        column, row = (
            np.clip((points.points[:, axis] - self._seabed.origin[axis]) // self._side, 0, self._shape[1 - axis] - 1)
            for axis in (0, 1)
        )
        square, first = np.unique((row * self._shape[1] + column).astype(np.int64), return_index=True)
        self._parts.append((square, points.stamp_ns[first], points.points[first], points.gradient[first]))
        self._views.append(view)

    def uncertainty(self, path: Path) -> MapUncertainty:
        """path: map <- base_link at stamps, with its covariance on Earth."""
        from garbi_map.seabed.kernels import point_errors

        square, stamps, points, slope = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        lengths = [len(part[0]) for part in self._parts]
        base = path(stamps)
        looks = [
            _Look.of(view, np.repeat([one is view for one in self._views], lengths), base, points)
            for view in dict.fromkeys(self._views)
        ]
        good, eye = np.zeros(len(points), np.bool_), np.zeros_like(points)
        for look in looks:
            good[look.rows[look.good]] = True
            eye[look.rows] = look.eye
        place, member = np.unique(square[good], return_inverse=True)
        up = np.concatenate([-slope, np.ones((len(slope), 1))], axis=1)
        sweep = np.repeat(np.arange(len(lengths)), lengths)
        network = _Network(points[good], up[good], member, sweep[good], base.covariance[good])
        told = True
        bent, displaced = np.zeros((2, len(place), 3, 3))
        rigs: dict[str, list[_Look]] = {}
        for look in looks:
            rigs.setdefault(look.view.rig.to_yaml(), []).append(look)
        for mine in rigs.values():  # two rigs err each for itself
            unknown, own = rig_errors(mine[0].view.rig)
            told &= own
            for one in np.eye(len(unknown.names)):  # a principal error of the rig, one standard deviation of it
                moved = np.zeros_like(points)
                for look in mine:
                    moved[look.rows] = look.moved(*(unknown.at(sign * one) for sign in (1.0, -1.0)))
                laid = network.laid(moved[good])
                for total, left in ((displaced, laid), (bent, network.without_rigid_motion(laid))):
                    mean = network.mean(left)
                    total += mean[:, :, None] * mean[:, None, :]
        each = np.arange(len(points), dtype=np.int32)
        none = np.zeros(len(points), np.float32)
        by_path = point_errors(points, each, none, eye, base.position, base.covariance, slope)[2][good]
        return MapUncertainty(
            bent=self._of_elevation(place, bent),
            displaced=self._of_elevation(place, displaced),
            path=np.sqrt(self._on_cells(place, network.mean(by_path[:, None] ** 2)[:, 0])),
            told=told,
        )

    def _of_elevation(self, place: NDArray[np.int64], covariance: Floats) -> Floats:
        """1 sigma of the cells' elevations (rows, columns), of displacements of squares: where it is steep, one sideways is
        one of elevation."""
        south_north, west_east = np.gradient(self._seabed.elevation.astype(np.float64), self._seabed.cell)
        slopes = (np.clip(np.nan_to_num(slope), -_STEEPEST, _STEEPEST) for slope in (west_east, south_north))
        up = [*(-slope for slope in slopes), np.ones(self._seabed.elevation.shape)]
        variance = np.zeros(self._seabed.elevation.shape)
        for a in range(3):
            for b in range(3):
                variance += up[a] * up[b] * self._on_cells(place, covariance[:, a, b])
        return np.sqrt(np.maximum(variance, 0.0))

    def _on_cells(self, place: NDArray[np.int64], value: Floats) -> Floats:
        """Values (n,) of squares, between their centres (rows, columns); beyond, that of the nearest."""
        from scipy.ndimage import distance_transform_edt, map_coordinates

        squares = np.full(self._shape, np.nan)
        squares.ravel()[place] = value
        nearest = distance_transform_edt(np.isnan(squares), return_distances=False, return_indices=True)
        at = [(np.arange(n) + 0.5) * self._seabed.cell / self._side - 0.5 for n in self._seabed.elevation.shape]
        return map_coordinates(squares[tuple(nearest)], np.meshgrid(*at, indexing="ij"), order=1, mode="nearest")


@dataclass(frozen=True)
class _Look:
    """Samples that a view saw: their rows (k,) among all, where the rig was (k, 3), how it was turned, their pixels (k, 2),
    angles of the laser (k,) rad, and which of them the rig can see (k,)."""

    view: View
    rows: NDArray[np.int64]
    eye: Floats
    turn: Rotation
    pixels: Floats
    alpha: Floats
    good: NDArray[np.bool_]

    @classmethod
    def of(cls, view: View, mine: NDArray[np.bool_], base: Trajectory, points: Floats) -> _Look:
        """Those of all samples (n, 3) in `map` that are `mine` (n,), from the poses of base_link (n,)."""
        rows, rig = np.flatnonzero(mine), view.rig
        turn = base.rotation[rows]
        eye = base.position[rows] + turn.apply(view.mount.translation)
        turn = turn * Rotation.from_quat(view.mount.quaternion)
        seen = turn.inv().apply(points[rows] - eye)
        fixed = rig.laser.fixed_angle
        alpha = alpha_through(rig.laser, seen) if fixed is None else np.full(len(seen), fixed)
        pixels = rig.project(seen)
        return cls(view, rows, eye, turn, pixels, alpha, np.isfinite(pixels).all(axis=1) & np.isfinite(alpha))

    def moved(self, one: Rig, other: Rig) -> Floats:
        """By how much (k, 3) in `map` the samples move by half of what two rigs differ; not where none sees them."""
        out = np.zeros_like(self.eye)
        u, v = self.pixels[self.good].T
        ends = [rig.triangulate(u, v, self.alpha[self.good]).points for rig in (one, other)]
        out[self.good] = self.turn[self.good].apply((ends[0] - ends[1]) / 2)
        return out


class _Network:
    """Sweeps that see the same squares: of n samples where they are, which way the surface faces, square and sweep.

    covariance (n, 6, 6): of the path, which no sweep leaves by more for the others' sake.
    """

    def __init__(
        self,
        points: Floats,
        up: Floats,
        square: NDArray[np.int64],
        sweep: NDArray[np.int64],
        covariance: NDArray[np.floating],
    ) -> None:
        n = len(points)
        self._squares = csr_array((np.ones(n), (square, np.arange(n))))
        self._count = self._squares.sum(axis=1)
        self._up, self._offset = up, points - points.mean(axis=0)
        self._sweep = np.unique(sweep, return_inverse=True)[1]
        each = csr_array((1.0 / np.bincount(self._sweep)[self._sweep], (self._sweep, np.arange(n))))
        self._arm = points - (each @ points)[self._sweep]
        lever = np.concatenate([up, np.cross(self._arm, up)], axis=1)
        columns = (6 * self._sweep[:, None] + np.arange(6)).ravel()
        self._design = csr_array((lever.ravel(), (np.repeat(np.arange(n), 6), columns)))
        shared = self._squares @ self._design
        normal = self._design.T @ self._design - shared.T @ diags_array(1.0 / self._count) @ shared
        variance = each @ np.diagonal(covariance, axis1=1, axis2=2).astype(np.float64)
        held = diags_array((_AGREEMENT**2 / np.maximum(variance, 1e-12)).ravel())
        self._normal = splu((normal + held).tocsc())

    def mean(self, values: Floats) -> Floats:
        """Of the samples' values (n, k), in each square (m, k)."""
        return (self._squares @ values) / self._count[:, None]

    def laid(self, moved: Floats) -> Floats:
        """The samples' displacements (n, 3) when sweeps that are displaced by `moved` (n, 3) have shifted and turned until
        the surfaces that they see agree as well as they can."""
        off = (moved * self._up).sum(axis=1)
        apart = off - self._squares.T @ self.mean(off[:, None])[:, 0]
        step = self._normal.solve(self._design.T @ apart).reshape(-1, 6)[self._sweep]
        return moved - step[:, :3] - np.cross(step[:, 3:], self._arm)

    def without_rigid_motion(self, moved: Floats) -> Floats:
        """What is left of the samples' displacements (n, 3) when all are moved as one to where the surface fits best."""
        lever = np.concatenate([self._up, np.cross(self._offset, self._up)], axis=1)
        step = np.linalg.lstsq(lever, (moved * self._up).sum(axis=1))[0]
        return moved - step[:3] - np.cross(step[3:], self._offset)
