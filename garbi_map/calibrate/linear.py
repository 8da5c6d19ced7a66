"""The paper's linear calibrations (sections 4.1, 4.2): starting values for everything else, and its baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.rig import Laser


@dataclass(frozen=True)
class LinearCamera:
    """A pinhole camera and its pose: pixels alpha_u, alpha_v, u0, v0; camera <- target rotation, translation (3,) m."""

    alpha_u: float
    alpha_v: float
    u0: float
    v0: float
    rotation: Rotation
    translation: Floats


def solve_camera(points: Floats, pixels: Floats) -> LinearCamera:
    """The camera of equations (1) to (3), from points (n, 3) m that do not lie in one plane, seen at pixels (n, 2).

    Eleven unknowns with m34 = 1 (the paper's ten are the degrees of freedom), both sides centred and scaled; then the
    closed forms u0 = m1.m3, alpha_u = |m1 x m3|. Raises GarbiError for a mirrored target and where nothing follows.
    """
    world, world_scale, world_centre = _scaled(points)
    image, image_scale, image_centre = _scaled(pixels)
    n = len(world)
    q = np.zeros((2 * n, 11))
    q[0::2, 0:3], q[0::2, 3] = world, 1.0
    q[1::2, 4:7], q[1::2, 7] = world, 1.0
    q[0::2, 8:11] = -image[:, :1] * world
    q[1::2, 8:11] = -image[:, 1:] * world
    solution, _, rank, singular = np.linalg.lstsq(q, image.reshape(-1), rcond=None)
    if n < 6 or rank < 11 or singular[-1] < 1e-6 * singular[0]:
        raise GarbiError("the linear camera solve needs six or more points that do not lie in one plane")
    projection = np.append(solution, 1.0).reshape(3, 4)
    to_world = np.eye(4)
    to_world[:3, :3] *= world_scale
    to_world[:3, 3] = -world_scale * world_centre
    from_image = np.array([[1 / image_scale, 0, image_centre[0]], [0, 1 / image_scale, image_centre[1]], [0, 0, 1]])
    return _decompose(from_image @ projection @ to_world, points)


def _scaled(values: Floats) -> tuple[Floats, float, Floats]:
    centre = values.mean(axis=0)
    scale = 1.0 / float(np.sqrt(((values - centre) ** 2).mean()))
    return (values - centre) * scale, scale, centre


def _decompose(m: Floats, points: Floats) -> LinearCamera:
    m = m / np.linalg.norm(m[2, :3])
    if np.median(points @ m[2, :3] + m[2, 3]) < 0:
        m = -m
    m1, m2, m3 = m[:, :3]
    if np.linalg.det(m[:, :3]) < 0:
        raise GarbiError("the target is seen mirrored: check its drawing, or whether the images are flipped")
    u0, v0 = m1 @ m3, m2 @ m3
    alpha_u, alpha_v = np.linalg.norm(np.cross(m1, m3)), np.linalg.norm(np.cross(m2, m3))
    turned = np.stack([(m1 - u0 * m3) / alpha_u, (m2 - v0 * m3) / alpha_v, m3])
    left, _, right = np.linalg.svd(turned)
    translation = np.array([(m[0, 3] - u0 * m[2, 3]) / alpha_u, (m[1, 3] - v0 * m[2, 3]) / alpha_v, m[2, 3]])
    return LinearCamera(
        float(alpha_u), float(alpha_v), float(u0), float(v0), Rotation.from_matrix(left @ right), translation
    )


def solve_laser(points: Floats, alpha: Floats) -> Laser:
    """Five parameters, theta = gamma = 0, from points (n, 3) m, rig frame, on the sheets at alpha (n,) rad.

    Equation (5) with the height of each point among the knowns: five columns, any heights, one solve. Raises
    GarbiError where the points do not determine them.
    """
    x, y, z = points.T
    s, c = np.sin(alpha), np.cos(alpha)
    q = np.column_stack([-s, c, x * c + y * s, z, np.ones_like(z)])
    s1, s2, s3, s4, s5 = _solved(q, y * c - x * s)
    px, py, delta = _apex(s1, s2, s3)
    beta = np.arctan(s4 * np.cos(delta))
    return _same_side(px, py, -s5 / s4 if abs(s4) > 1e-12 else 0.0, delta, beta, points, alpha)


def solve_laser_paper(low: tuple[Floats, Floats], high: tuple[Floats, Floats], as_printed: bool = False) -> Laser:
    """Equations (5) to (10): two sets of points (n, 3) m and alpha (n,) rad, each at one height, solved apart.

    as_printed: (9) and (10) with their misprints; otherwise
    tan(beta) = cos(delta) (S14 - S24) / (Pz1 - Pz2),  Z = Pz1 - S14 cos(delta) / tan(beta).
    """
    first, second = (_four_columns(*part) for part in (low, high))
    height1, height2 = (float(part[0][:, 2].mean()) for part in (low, high))
    x, y, delta = _apex(*first[:3])
    if as_printed:
        beta = np.arctan((first[3] - second[3]) / ((low[0][:, 0].mean() + high[0][:, 0].mean()) * np.cos(delta)))
        z = first[3] * np.cos(delta) / np.tan(beta) - low[0][:, 0].mean()
    else:
        beta = np.arctan(np.cos(delta) * (first[3] - second[3]) / (height1 - height2))
        z = height1 - first[3] * np.cos(delta) / np.tan(beta)
    return Laser(float(x), float(y), float(z), float(delta), 0.0, 0.0, float(beta))


def _four_columns(points: Floats, alpha: Floats) -> Floats:
    x, y, _ = points.T
    s, c = np.sin(alpha), np.cos(alpha)
    return _solved(np.column_stack([-s, c, x * c + y * s, np.ones_like(s)]), y * c - x * s)


def _solved(q: Floats, right: Floats) -> Floats:
    scale = np.linalg.norm(q, axis=0)
    if not scale.min() > 0:
        raise GarbiError("the stripe points do not determine the laser: show the target at other heights and angles")
    solution, _, rank, singular = np.linalg.lstsq(q / scale, right, rcond=None)
    if rank < q.shape[1] or singular[-1] < 1e-9 * singular[0]:
        raise GarbiError("the stripe points do not determine the laser: show the target at other distances and angles")
    return np.asarray(solution / scale)


def _apex(s1: float, s2: float, s3: float) -> tuple[float, float, float]:
    """Equations (6) to (8)."""
    x = (s1 - s2 * s3) / (1.0 + s3 * s3)
    return x, s2 + x * s3, float(np.arctan(s3))


def _same_side(x: float, y: float, z: float, delta: float, beta: float, points: Floats, alpha: Floats) -> Laser:
    """(delta, beta) and (delta + pi, -beta) are one sheet: the one whose sheet, as it turns, points at the target."""
    bearing = np.median(np.cos(np.arctan2(points[:, 1] - y, points[:, 0] - x) - alpha - delta))
    if bearing < 0:
        delta, beta = delta - np.copysign(np.pi, delta), -beta
    return Laser(float(x), float(y), float(z), float(delta), 0.0, 0.0, float(beta))
