"""The laser sheet as a fan of rays: where it lands and where the camera sees that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Floats
from garbi_map.rig import Rig
from tools.simulator.scenario import Laser

# Distance (n,) and facing normal (n, 3) of what rays from (n, 3) along (n, 3) meet, all in the rig frame.
Cast = Callable[[Floats, Floats], tuple[Floats, Floats]]

RAYS = 2000  # of a fan: about two to a row of the image
SLICES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])  # of the sheet's thickness, in its sigma
WEIGHTS = np.exp(-(SLICES**2) / 2) / np.exp(-(SLICES**2) / 2).sum()
HIDDEN = 5e-4  # m, by which something nearer hides a point from the camera


@dataclass(frozen=True)
class Plane:
    """One sheet, rig frame: apex (3,), normal (3,), ahead (3,) along the view and aside (3,) complete it.

    tangent   (k,) of the angle from `ahead` towards `aside` of each ray, equal steps
    """

    apex: Floats
    normal: Floats
    ahead: Floats
    aside: Floats
    tangent: Floats


@dataclass(frozen=True)
class LitLine:
    """Where one slice of the sheet lands, in the order of its rays (k,); NaN pixels where the camera does not see it.

    pixel     (k, 2)
    point     (k, 3) m, rig frame
    range     (k,) m from the laser, inf where nothing is met
    distance  (k,) m from the camera
    cosine    (k,) between the surface's normal and the line of sight
    """

    pixel: Floats
    point: Floats
    range: Floats
    distance: Floats
    cosine: Floats

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(k,)"""
        return np.isfinite(self.pixel[:, 0])


def plane_at(rig: Rig, alpha: float, laser: Laser, rays: int = RAYS) -> Plane:
    """The sheet at an encoder angle, as a fan of that many rays."""
    normal = rig.sheet(alpha)[0]
    ahead = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    ahead /= np.linalg.norm(ahead)
    tangent = np.linspace(-laser.fan, laser.fan, rays)
    return Plane(rig.laser.apex, normal, ahead, np.cross(ahead, normal), tangent)


def cast_slice(rig: Rig, plane: Plane, laser: Laser, offset: float, cast: Cast) -> LitLine:
    """One slice of the sheet, `offset` sigma of its thickness aside."""
    direction = plane.ahead + plane.tangent[:, None] * plane.aside + offset * laser.divergence * plane.normal
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = np.broadcast_to(plane.apex + offset * laser.width * plane.normal, direction.shape)
    reach, normal = cast(origin, direction)
    point = origin + np.where(np.isfinite(reach), reach, 0.0)[:, None] * direction
    pixel = np.full((len(point), 2), np.nan)
    distance = np.full(len(point), np.inf)
    cosine = np.zeros(len(point))
    met = np.flatnonzero(np.isfinite(reach))
    pixel[met] = rig.project(point[met])
    border = 8.0
    limit = np.array([rig.camera.width, rig.camera.height]) - 1 + border
    inside = met[((pixel[met] > -border) & (pixel[met] < limit)).all(1)]
    eye, sight = rig.rays(pixel[inside, 0], pixel[inside, 1])
    first, _ = cast(eye, sight)
    away = np.linalg.norm(point[inside] - eye, axis=1)
    facing = -(normal[inside] * sight).sum(1)
    visible = (first > away - HIDDEN) & (facing > 0)
    shown = inside[visible]
    distance[shown] = away[visible]
    cosine[shown] = facing[visible]
    hidden = np.ones(len(point), bool)
    hidden[shown] = False
    pixel[hidden] = np.nan
    return LitLine(pixel, point, reach, distance, cosine)
