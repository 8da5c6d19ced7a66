"""What the seabed room hands on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Verdict(IntEnum):
    """Why a point was taken or left out."""

    ACCEPTED = 0
    INVALID = 1  # not finite, without a sigma, or kilometres away
    UNCERTAIN = 2  # its sigma is beyond the limit
    ISOLATED = 3  # nothing else near: marine snow
    SEEN_THROUGH = 4  # nearly all profiles that passed there, or by other parts of the same body, saw something else,
    # or it floats and nobody saw it again: snow, fish, reflections
    OFF_SURFACE = 5  # beside a surface, farther than its sigma allows, and alone there

    @property
    def label(self) -> str:
        """As reports name it."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class Points:
    """Points of one sweep in `map`.

    stamp_ns    (k,) int64, of each point's profile
    points      (k, 3) float64, m
    sigma       (k,) float32, 1 sigma along the camera ray, m: stripe, laser angle and pose
    intensity   (k,) float32, 0..255
    """

    stamp_ns: NDArray[np.int64]
    points: NDArray[np.float64]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]


@dataclass(frozen=True)
class AcceptedPoints(Points):
    """The points of one sweep that belong to the seabed, and which they were.

    verdict     (n,) uint8, a Verdict for each point of the sweep
    moving      those that were seen through: fish, cables, the vehicle's own arm
    """

    verdict: NDArray[np.uint8]
    moving: Points | None = None

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(n,) which points of the sweep were accepted."""
        return self.verdict == Verdict.ACCEPTED

    @property
    def rejected(self) -> dict[str, int]:
        """Number of points left out, by reason; every reason is there."""
        count = np.bincount(self.verdict, minlength=len(Verdict))
        return {reason.label: int(count[reason]) for reason in Verdict if reason != Verdict.ACCEPTED}


@dataclass(frozen=True, kw_only=True)
class JudgedPoints(AcceptedPoints):
    """Accepted points with what their fusion needs.

    gradient    (k, 2) float64, slope of the surface at each point, along x and y
    noise       (k,) float64, variance of the elevation by the point's own error, m^2
    pose        (k,) float64, deviation of the elevation by the error of the pose, which the sweep shares, m
    """

    gradient: NDArray[np.float64]
    noise: NDArray[np.float64]
    pose: NDArray[np.float64]


@dataclass(frozen=True)
class Seabed:
    """The elevation grid. Row 0 is the southernmost (least y), column 0 the westernmost (least x); no-data is NaN.

    origin               (x, y) of the outer corner of cell (0, 0) in `map`, m
    cell                 side of a cell, m
    elevation            (rows, columns) float32, m, `map` z at the cell's centre
    uncertainty          (rows, columns) float32, 1 sigma of the elevation, m: noise, roughness, pose,
                         and by how much sweeps disagree beyond that
    density              (rows, columns) int32, points
    standard_deviation   (rows, columns) float32, spread of the points in the cell about the local slope, m
    intensity            (rows, columns) float32, mean, 0..255
    sweeps               (rows, columns) int32, sweeps that saw the cell
    absolute             (rows, columns) float32, 1 sigma of the elevation on Earth, m; None where nobody has told it
    """

    origin: tuple[float, float]
    cell: float
    elevation: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    density: NDArray[np.int32]
    standard_deviation: NDArray[np.float32]
    intensity: NDArray[np.float32]
    sweeps: NDArray[np.int32]
    absolute: NDArray[np.float32] | None = None

    @property
    def known(self) -> NDArray[np.bool_]:
        """(rows, columns) cells that hold a measurement."""
        return self.density > 0

    @property
    def area(self) -> float:
        """Area of the cells that hold a measurement, m^2."""
        return float(np.count_nonzero(self.known)) * self.cell**2

    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x (columns,) and y (rows,) of the cells' centres, m."""
        rows, columns = self.elevation.shape
        east = self.origin[0] + (np.arange(columns, dtype=np.float64) + 0.5) * self.cell
        north = self.origin[1] + (np.arange(rows, dtype=np.float64) + 0.5) * self.cell
        return east, north


@dataclass(frozen=True)
class Mesh:
    """A triangulated surface in `map`.

    vertices    (v, 3) float64, m
    triangles   (t, 3) int32, counter-clockwise seen from above
    filled      (v,) bool, interpolated over a small hole instead of measured
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    filled: NDArray[np.bool_]
