"""A map against the orders of hydrographic surveys: IHO S-44, edition 6.1.0 (2022), table 1.

All uncertainties there are at 95 %. Inside the map, what counts is how its parts lie to each other; against the Earth, also
where the map is and from what level its depths count. A chart wants the second, a measurement in the map the first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.report import Bathymetry, SurveyOrder
from garbi_map.export.weak import holes_inside, outline, sweeps_about
from garbi_map.register import Registered
from garbi_map.seabed import Seabed

_SCALAR, _RADIAL = 1.96, 2.45
"""Sigmas to 95 %, of one axis and of a circle in two of the same sigma."""
_ASKED_COVERAGE = 0.995
"""Share of the outline from which on it counts as all."""


@dataclass(frozen=True)
class Order:
    """What an order allows and asks for.

    tvu       (a, b): vertical uncertainty up to sqrt(a^2 + (b depth)^2), m
    thu       (m, share of depth): horizontal uncertainty up to their sum
    feature   m, side of the cubes that have to be found, to 40 m of depth; 0: none
    coverage  1: everything once, 2: everything twice, 0: not everything; judged to a quarter of the features' side
    """

    name: str
    tvu: tuple[float, float]
    thu: tuple[float, float]
    feature: float
    coverage: int

    def allowed_depth_error(self, depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """The maximum vertical uncertainty, m, at depths, m."""
        return np.hypot(self.tvu[0], self.tvu[1] * np.asarray(depth, np.float64))


ORDERS = (
    Order("Order 2", (1.0, 0.023), (20.0, 0.10), 0.0, 0),
    Order("Order 1b", (0.5, 0.013), (5.0, 0.05), 0.0, 0),
    Order("Order 1a", (0.5, 0.013), (5.0, 0.05), 2.0, 0),
    Order("Special", (0.25, 0.0075), (2.0, 0.0), 1.0, 1),
    Order("Exclusive", (0.15, 0.0075), (1.0, 0.0), 0.5, 2),
)


def bathymetry(
    seabed: Seabed,
    registered: Registered,
    widest_hole: float,
    has_depth: bool,
    origin_sigma: float | None,
) -> Bathymetry:
    """The figures of a map, and what each order says to them.

    has_depth       whether heights count from the surface of the water
    origin_sigma    m, 1 sigma along each axis of where the map is on Earth; None where nobody knows
    """
    known = seabed.known
    sigma = seabed.uncertainty[known].astype(np.float64)
    depth = -seabed.elevation[known].astype(np.float64) if has_depth else np.zeros(len(sigma))
    inside_xy = _pose_sigma(registered.inside.covariance)
    earth_xy = _pose_sigma(registered.trajectory.covariance)
    cell = seabed.cell / np.sqrt(12.0)  # a point may lie anywhere in its cell
    vertical = {"inside": _SCALAR * sigma}
    if has_depth and seabed.absolute is not None:
        vertical["earth"] = _SCALAR * seabed.absolute[known].astype(np.float64)
    horizontal = {"inside": _RADIAL * float(np.hypot(inside_xy, cell))}
    if origin_sigma is not None:
        horizontal["earth"] = _RADIAL * float(np.sqrt(earth_xy**2 + cell**2 + origin_sigma**2))
    area = outline(seabed)
    sweeps = sweeps_about(seabed)
    once = 1.0 - _share(holes_inside(seabed, area, widest_hole), area)
    gap = _widest_gap(area & ~known, seabed.cell)
    middle = float(np.median(depth))
    orders = []
    for order in ORDERS:
        allowed = order.allowed_depth_error(depth)
        share = {where: float((value <= allowed).mean()) for where, value in vertical.items()}
        thu = order.thu[0] + order.thu[1] * middle
        reached = _reached(sweeps >= order.coverage, area, order.feature / 4, seabed.cell) if order.coverage else None
        orders.append(
            SurveyOrder(
                name=order.name,
                tvu_m=float(order.allowed_depth_error(np.array(middle))),
                inside_share=share["inside"],
                earth_share=share.get("earth"),
                thu_m=thu,
                inside_position=horizontal["inside"] <= thu,
                earth_position=horizontal["earth"] <= thu if "earth" in horizontal else None,
                feature_m=order.feature or None,
                features=not order.feature or gap < order.feature,
                coverage=order.coverage,
                covered_share=reached,
                covered=reached is None or reached >= _ASKED_COVERAGE,
            )
        )
    return Bathymetry(
        depth_m=middle if has_depth else None,
        tvu_inside_m=float(np.median(vertical["inside"])),
        tvu_earth_m=float(np.median(vertical["earth"])) if "earth" in vertical else None,
        thu_inside_m=horizontal["inside"],
        thu_earth_m=horizontal.get("earth"),
        widest_gap_m=gap,
        covered_once=once,
        covered_twice=once * _share(known & (sweeps >= 2), known),
        density=float(np.median(seabed.density[known])),
        five_or_more=float((seabed.density[known] >= 5).mean()),
        orders=orders,
    )


def _pose_sigma(covariance: NDArray[np.floating]) -> float:
    """Median 1 sigma of the poses along a horizontal axis, m."""
    variance = np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, :2].astype(np.float64), 0.0)
    return float(np.median(np.sqrt(variance.mean(axis=1))))


def _widest_gap(empty: NDArray[np.bool_], cell: float) -> float:
    """The side of the largest square of empty cells, m."""
    import cv2

    reach = cv2.distanceTransform(np.pad(empty.astype(np.uint8), 1), cv2.DIST_C, 3)
    return float(max(2.0 * reach.max() - 1.0, 0.0)) * cell


def _reached(seen: NDArray[np.bool_], area: NDArray[np.bool_], near: float, cell: float) -> float:
    """The share of an area that lies within `near` m of what was seen: no feature that counts is smaller."""
    import cv2

    far = cv2.distanceTransform((~seen).astype(np.uint8), cv2.DIST_L2, 5)
    return _share(area & (far * cell <= near), area)


def _share(mask: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(np.count_nonzero(mask)) / max(float(np.count_nonzero(among)), 1.0)
