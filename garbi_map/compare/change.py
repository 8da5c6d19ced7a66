"""The distance between two maps, and from which size on it is a change.

M3C2: Lague, Brodu and Leroux, Accurate 3D comparison of complex topography with terrestrial laser scanner, 2013.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from garbi_map.compare.alignment import Alignment
from garbi_map.compare.maps import MapFolder
from garbi_map.compare.settings import CompareSettings
from garbi_map.errors import GarbiError
from garbi_map.export.georeference import Georeference
from garbi_map.seabed import fill_holes

Floats = NDArray[np.float64]

_NORMAL_POINTS = 8
"""That a normal needs."""
_CONFIDENCE = 1.96
"""Sigmas of 95 %."""
_SAME, _SAME_AT_MOST = 0.3, 0.004
"""Of the distance between two surfaces, and m: what lies nearer to a surface than that is of it."""


@dataclass(frozen=True)
class Change:
    """Rasters (rows, columns) on the grid of the first map; NaN where the two cannot be compared.

    distance    m, from the first surface to the second along the first's normal; positive where something is gained
    rise        m, the same along the vertical
    own         m^2, variance of the distance by what each cylinder errs for itself
    shared      m^2, variance by what neighbouring cells have in common: poses and alignment
    hidden      cells where the two show different surfaces, one over the other, both of which the other map knows
    excess      factor by which both variances had to grow for most of the maps to be unchanged, at least 1
    """

    origin: tuple[float, float]
    cell: float
    reference: Georeference
    elevation: Floats
    distance: Floats
    rise: Floats
    own: Floats
    shared: Floats
    hidden: NDArray[np.bool_]
    excess: float

    @property
    def sigma(self) -> Floats:
        """1 sigma of the distance, m."""
        return np.sqrt(self.own + self.shared)

    @property
    def detection(self) -> Floats:
        """Level of detection, m: what no change exceeds in 5 % of the cells."""
        return _CONFIDENCE * self.sigma

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Where both maps are known."""
        return np.isfinite(self.distance)


def difference(first: MapFolder, second: MapFolder, motion: Alignment, settings: CompareSettings) -> Change:
    """The distance from the first map to the second at every known cell of the first, small holes closed.

    The variance of a distance: the scatter in both cylinders over their counts, the uncertainty of both maps' cells
    (which neighbours share), and that of the alignment. Raises GarbiError where a cloud cannot be read.
    """
    elevation, _ = fill_holes(first.elevation, round(settings.cylinder / first.cell))
    first = replace(first, elevation=elevation)
    cores = first.cells()
    origin = np.array([*first.origin, float(np.mean(cores[:, 2]))])
    cores = cores - origin
    still = _Cloud(first.cloud(settings.max_points) - origin, first, settings)
    loose = _Cloud(motion.apply(second.cloud(settings.max_points)) - origin, first, settings)
    normals = still.normals(cores, settings)
    tilted = _distances(cores, normals, still, loose, settings)
    upright = _distances(cores, np.tile([0.0, 0.0, 1.0], (len(cores), 1)), still, loose, settings)
    # on a flank whose thing has gone, nothing lies along the normal
    use = ~np.isfinite(tilted[0])
    distance, own = (np.where(use, up, along) for along, up in zip(tilted, upright, strict=True))
    facing = np.where(use[:, None], [0.0, 0.0, 1.0], normals)
    shared = motion.variance(cores + origin, np.nan_to_num(facing))
    shared += np.nan_to_num(_cell_variance(first)[first.known]) + _moved_variance(second, motion, cores + origin)
    if not np.isfinite(distance).any():
        raise GarbiError(f"{first.path} and {second.path}: no cell of one is known in the other")
    excess = _excess(distance, own + shared)
    limit = excess * _CONFIDENCE * np.sqrt(own + shared)
    hidden = _hidden(cores, facing, distance, limit, still, loose)

    def raster(values: Floats, there: NDArray[np.bool_] | None = None) -> Floats:
        out = np.full(first.elevation.shape, np.nan)
        out[first.known] = np.where(np.isfinite(distance) if there is None else there, values, np.nan)
        return out

    return Change(
        first.origin,
        first.cell,
        first.reference,
        first.elevation,
        raster(distance, ~hidden),
        raster(np.where(np.isfinite(upright[0]), upright[0], distance)),
        raster(excess**2 * own),
        raster(excess**2 * shared),
        raster(hidden.astype(float)) == 1.0,
        excess,
    )


class _Cloud:
    """Points (n, 3) m in square bins over the first map."""

    def __init__(self, points: Floats, first: MapFolder, settings: CompareSettings) -> None:
        from garbi_map.compare import kernels

        self._side = max(0.5 * settings.cylinder, first.cell)
        self._low = np.full(2, -settings.reach)
        rows, columns = first.elevation.shape
        self._columns, self._rows = (
            int(np.ceil((n * first.cell + 2 * settings.reach) / self._side)) for n in (columns, rows)
        )
        order, self._start = kernels.binned(points, self._low, self._side, self._columns, self._rows)
        self._points = points[order[: self._start[-1]]]
        self._bins = (self._low, self._side, self._columns, self._rows)

    def normals(self, cores: Floats, settings: CompareSettings) -> Floats:
        """Unit normals (k, 3) at cores (k, 3), NaN where the cloud is too thin."""
        from garbi_map.compare import kernels

        return kernels.surface_normals(
            cores, self._points, self._start, *self._bins, 0.5 * settings.normal_scale, _NORMAL_POINTS
        )

    def nearest(self, places: Floats, reach: Floats) -> Floats:
        """Distance (k,) m of places (k, 3) from the nearest point, inf where none is within reach (k,) m."""
        from garbi_map.compare import kernels

        return kernels.nearest(places, reach, self._points, self._start, *self._bins)

    def means(self, cores: Floats, normals: Floats, reach: float, settings: CompareSettings) -> tuple[Floats, Floats]:
        """Mean (k,) m along the normal, and its variance by the scatter (k,) m^2."""
        from garbi_map.compare import kernels

        mean, variance, _ = kernels.cylinder_means(
            cores, normals, self._points, self._start, *self._bins,
            0.5 * settings.cylinder, reach, settings.sheet, settings.min_points,
        )  # fmt: skip
        return mean, variance


def _distances(
    cores: Floats, normals: Floats, still: _Cloud, loose: _Cloud, settings: CompareSettings
) -> tuple[Floats, Floats]:
    """From the one cloud to the other along the normals, and the variance by scatter; (k,), (k,)."""
    here, scatter = still.means(cores, normals, settings.sheet, settings)
    there, other = loose.means(cores, normals, settings.reach, settings)
    return there - here, scatter + other


def _hidden(
    cores: Floats, normals: Floats, distance: Floats, limit: Floats, still: _Cloud, loose: _Cloud
) -> NDArray[np.bool_]:
    """Which cores (k,) seem changed only because the two maps show different surfaces there, one over the other.

    Beside a pipe one map sees the ground and the other the pipe: what is found there is in the first map, too.
    """
    beyond = np.isfinite(distance) & (np.abs(distance) > limit)
    reach = np.where(beyond, np.maximum(limit, np.minimum(_SAME * np.abs(distance), _SAME_AT_MOST)), np.nan)
    found = cores + np.nan_to_num(distance)[:, None] * np.nan_to_num(normals)
    return beyond & (np.isfinite(still.nearest(found, reach)) | np.isfinite(loose.nearest(cores, reach)))


def _cell_variance(one: MapFolder) -> Floats:
    """Mean variance (rows, columns) m^2 of the known cells within two cells of each."""
    known = np.isfinite(one.uncertainty)
    weight = uniform_filter(known.astype(float), 5, mode="constant")
    total = uniform_filter(np.where(known, one.uncertainty**2, 0.0), 5, mode="constant")
    return np.where(weight > 1e-9, total / np.maximum(weight, 1e-9), np.nan)


def _moved_variance(second: MapFolder, motion: Alignment, places: Floats) -> Floats:
    """The second map's variance (k,) m^2 at places (k, 3) of the first; its median where it has no cell there."""
    variance = _cell_variance(second)
    back = (places - motion.shift) @ motion.rotation
    index = np.floor((back[:, :2] - np.asarray(second.origin)) / second.cell).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < variance.shape)).all(axis=1)
    out = np.full(len(places), np.nan)
    out[inside] = variance[tuple(index[inside].T)]
    return np.where(np.isfinite(out), out, float(np.nanmedian(variance)))


def _excess(distance: Floats, variance: Floats) -> float:
    """By what factor distances vary more than claimed, told by the middle 68 % of them: what changed is beyond."""
    good = np.isfinite(distance) & (variance > 0)
    return max(1.0, float(np.percentile(np.abs(distance[good]) / np.sqrt(variance[good]), 68.27)))
