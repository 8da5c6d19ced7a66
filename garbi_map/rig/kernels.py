"""Compiled geometry of one camera behind an optional flat port, and one rotating laser sheet.

Parameters travel as small arrays, all float64:

lens      (9,)    alpha_u alpha_v u0 v0 k1 k2 p1 p2 k3
port      (7,)    normal (3) in the camera frame, distance, thickness, index_glass, index_water; (0,) without a port
rotation  (3, 3)  rig <- camera
centre    (3,)    pinhole in the rig frame
axis      (3, 3)  rig <- laser at alpha + delta = 0, that is Ry(gamma) Rx(theta)
apex      (3,)    the point that all sheets share, rig frame
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from garbi_map.log.records import Floats

LENS_RESIDUAL = 1e-14  # on the normalised image plane: 1e-11 px at a focal length of 1000 px
LENS_STEPS = 30
PORT_STEPS = 60


@njit(cache=True, nogil=True, inline="always")
def _distort(x, y, lens):  # type: ignore[no-untyped-def]
    """Plumb bob: distorted (x, y) on the normalised plane, and its 2x2 Jacobian (xx, xy = yx, yy)."""
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xd, yd, xx, xy, yy


@njit(cache=True, nogil=True, inline="always")
def _undistort(u, v, lens):  # type: ignore[no-untyped-def]
    """Normalised (x, y) of a pixel and their derivatives by u; NaN where the distortion has no inverse.

    Newton from the distorted point: along a radius the distortion is concave (barrel) or convex (pincushion), and
    either way that start lies on the side from which Newton's steps do not overshoot.
    """
    xt = (u - lens[2]) / lens[0]
    yt = (v - lens[3]) / lens[1]
    x, y = xt, yt
    for _ in range(LENS_STEPS):
        xd, yd, xx, xy, yy = _distort(x, y, lens)
        rx, ry = xt - xd, yt - yd
        det = xx * yy - xy * xy
        if not det > 0.0:
            break
        if abs(rx) < LENS_RESIDUAL and abs(ry) < LENS_RESIDUAL:
            scale = 1.0 / (det * lens[0])
            return x, y, yy * scale, -xy * scale
        x += (yy * rx - xy * ry) / det
        y += (xx * ry - xy * rx) / det
    return math.nan, math.nan, math.nan, math.nan


@njit(cache=True, nogil=True, inline="always")
def _ray(u, v, lens, port):  # type: ignore[no-untyped-def]
    """The ray of a pixel in the medium beyond the port, camera frame: origin, direction, and their derivatives by u.

    Without a port the origin is the pinhole and the direction (x, y, 1). With one, Snell's law at both faces keeps the
    part p of the unit direction along the faces, divided by the index; the origin lies on the outer face.
    """
    x, y, x_u, y_u = _undistort(u, v, lens)
    if port.size == 0:
        return (0.0, 0.0, 0.0), (x, y, 1.0), (0.0, 0.0, 0.0), (x_u, y_u, 0.0)
    nx, ny, nz = port[0], port[1], port[2]
    distance, thickness, glass, water = port[3], port[4], port[5], port[6]
    norm = 1.0 / math.sqrt(x * x + y * y + 1.0)
    dx, dy, dz = x * norm, y * norm, norm
    along = (dx * x_u + dy * y_u) * norm
    dx_u, dy_u, dz_u = x_u * norm - dx * along, y_u * norm - dy * along, -dz * along
    c = dx * nx + dy * ny + dz * nz
    c_u = dx_u * nx + dy_u * ny + dz_u * nz
    if not c > 0.0:  # the view does not meet the window
        c = math.nan
    cg = math.sqrt(1.0 - (1.0 - c * c) / (glass * glass))
    cw = math.sqrt(1.0 - (1.0 - c * c) / (water * water))
    cg_u = c * c_u / (glass * glass * cg)
    cw_u = c * c_u / (water * water * cw)
    px, py, pz = dx - c * nx, dy - c * ny, dz - c * nz
    px_u, py_u, pz_u = dx_u - c_u * nx, dy_u - c_u * ny, dz_u - c_u * nz
    run = distance / c + thickness / (glass * cg)
    run_u = -distance * c_u / (c * c) - thickness * cg_u / (glass * cg * cg)
    deep = distance + thickness
    origin = (px * run + deep * nx, py * run + deep * ny, pz * run + deep * nz)
    origin_u = (px_u * run + px * run_u, py_u * run + py * run_u, pz_u * run + pz * run_u)
    direction = (px / water + cw * nx, py / water + cw * ny, pz / water + cw * nz)
    direction_u = (px_u / water + cw_u * nx, py_u / water + cw_u * ny, pz_u / water + cw_u * nz)
    return origin, direction, origin_u, direction_u


@njit(cache=True, nogil=True, inline="always")
def _view_through_port(x, y, z, port):  # type: ignore[no-untyped-def]
    """Direction in which the pinhole sees a point that lies beyond the port; NaN for one that does not.

    With q the tangent of the angle in air, the lateral distance that the refracted ray reaches,
    D q + T q / sqrt(ng^2 + (ng^2 - 1) q^2) + h q / sqrt(nw^2 + (nw^2 - 1) q^2), rises with q and is concave: Newton
    from q = 0 comes from below and cannot overshoot.
    """
    nx, ny, nz = port[0], port[1], port[2]
    distance, thickness, glass, water = port[3], port[4], port[5], port[6]
    depth = x * nx + y * ny + z * nz
    beyond = depth - distance - thickness
    if not beyond > -1e-12:
        return math.nan, math.nan, math.nan
    beyond = max(beyond, 0.0)
    lx, ly, lz = x - depth * nx, y - depth * ny, z - depth * nz
    lateral = math.sqrt(lx * lx + ly * ly + lz * lz)
    if lateral == 0.0:
        return nx, ny, nz
    g2, w2 = glass * glass, water * water
    q = 0.0
    for _ in range(PORT_STEPS):
        sg = math.sqrt(g2 + (g2 - 1.0) * q * q)
        sw = math.sqrt(w2 + (w2 - 1.0) * q * q)
        missing = lateral - q * (distance + thickness / sg + beyond / sw)
        slope = distance + thickness * g2 / (sg * sg * sg) + beyond * w2 / (sw * sw * sw)
        step = missing / slope
        q += step
        if step <= 1e-15 * (1.0 + q):
            break
    q /= lateral
    return nx + q * lx, ny + q * ly, nz + q * lz


@njit(cache=True, nogil=True, inline="always")
def _normal(alpha, delta, beta, axis):  # type: ignore[no-untyped-def]
    """Unit normal of the sheet at encoder angle alpha, rig frame, and its derivative by alpha.

    Ry(gamma) Rx(theta) Rz(delta + alpha) Rx(-beta) [0, 1, 0]', the paper's equation (4) where theta = gamma = 0.
    """
    s, c = math.sin(alpha + delta), math.cos(alpha + delta)
    sb, cb = math.sin(beta), math.cos(beta)
    a, b, d = -s * cb, c * cb, -sb
    normal = (
        axis[0, 0] * a + axis[0, 1] * b + axis[0, 2] * d,
        axis[1, 0] * a + axis[1, 1] * b + axis[1, 2] * d,
        axis[2, 0] * a + axis[2, 1] * b + axis[2, 2] * d,
    )
    turning = (
        -axis[0, 0] * b + axis[0, 1] * a,
        -axis[1, 0] * b + axis[1, 1] * a,
        -axis[2, 0] * b + axis[2, 1] * a,
    )
    return normal, turning


@njit(cache=True, nogil=True, inline="always")
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, inline="always")
def _turned(rotation, a):  # type: ignore[no-untyped-def]
    return (
        rotation[0, 0] * a[0] + rotation[0, 1] * a[1] + rotation[0, 2] * a[2],
        rotation[1, 0] * a[0] + rotation[1, 1] * a[1] + rotation[1, 2] * a[2],
        rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def camera_rays(u: Floats, v: Floats, lens: Floats, port: Floats) -> tuple[Floats, Floats]:
    """Origins (n, 3) and unit directions (n, 3) of pixels in the camera frame; NaN rows where there is no ray."""
    origins = np.empty((u.size, 3))
    directions = np.empty((u.size, 3))
    for i in range(u.size):
        origin, direction, _, _ = _ray(u[i], v[i], lens, port)
        norm = 1.0 / math.sqrt(_dot(direction, direction))
        for k in range(3):
            origins[i, k] = origin[k] + 0.0 * norm  # NaN where the direction is
            directions[i, k] = direction[k] * norm
    return origins, directions


@njit(cache=True, nogil=True, error_model="numpy")
def camera_pixels(points: Floats, lens: Floats, port: Floats) -> Floats:
    """Pixels (n, 2) of points (n, 3) in the camera frame; NaN behind the camera, inside the port or where the
    distortion polynomial has turned back, which would show far points inside the image."""
    pixels = np.full((points.shape[0], 2), np.nan)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if port.size != 0:
            x, y, z = _view_through_port(x, y, z, port)
        if z > 0.0:
            xd, yd, xx, xy, yy = _distort(x / z, y / z, lens)
            if xx * yy - xy * xy > 0.0 and xx + yy > 0.0:
                pixels[i, 0] = lens[2] + lens[0] * xd
                pixels[i, 1] = lens[3] + lens[1] * yd
    return pixels


@njit(cache=True, nogil=True, error_model="numpy")
def triangulate(
    u: Floats,
    v: Floats,
    alpha: Floats,
    lens: Floats,
    port: Floats,
    rotation: Floats,
    centre: Floats,
    delta: float,
    beta: float,
    axis: Floats,
    apex: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Points (n, 3) where the rays of pixels meet the sheet at alpha (n,), and their derivatives by u and by alpha, all
    in the rig frame. NaN rows where the ray is parallel to the sheet or meets it behind the camera."""
    n = u.size
    points = np.full((n, 3), np.nan)
    by_u = np.full((n, 3), np.nan)
    by_alpha = np.full((n, 3), np.nan)
    last = math.nan
    normal, turning = _normal(0.0, delta, beta, axis)
    for i in range(n):
        if alpha[i] != last:  # points come profile by profile
            last = alpha[i]
            normal, turning = _normal(last, delta, beta, axis)
        origin_c, direction_c, origin_uc, direction_uc = _ray(u[i], v[i], lens, port)
        direction = _turned(rotation, direction_c)
        direction_u = _turned(rotation, direction_uc)
        origin = _turned(rotation, origin_c)
        origin_u = _turned(rotation, origin_uc)
        to_apex = (
            apex[0] - centre[0] - origin[0],
            apex[1] - centre[1] - origin[1],
            apex[2] - centre[2] - origin[2],
        )
        across = _dot(normal, direction)
        if not abs(across) > 1e-12:
            continue
        s = _dot(normal, to_apex) / across
        if not s > 0.0:
            continue
        s_u = -(_dot(normal, origin_u) + s * _dot(normal, direction_u)) / across
        s_alpha = (_dot(turning, to_apex) - s * _dot(turning, direction)) / across
        for k in range(3):
            points[i, k] = centre[k] + origin[k] + s * direction[k]
            by_u[i, k] = origin_u[k] + s_u * direction[k] + s * direction_u[k]
            by_alpha[i, k] = s_alpha * direction[k]
    return points, by_u, by_alpha


@njit(cache=True, nogil=True, inline="always")
def _hull(column, inverse_depth, nearest, farthest):  # type: ignore[no-untyped-def]
    """First and last column of one row where inverse depth (k,), linear between columns (k,), is between the two."""
    k = column.size
    first, last = column[-1] + 1.0, -1.0
    for j in range(1, k):
        before, now = inverse_depth[j - 1], inverse_depth[j]
        low, high = min(before, now), max(before, now)
        if not math.isnan(before + now) and high >= farthest and low <= nearest:
            rise = now - before
            enter, leave = 0.0, 1.0
            if rise != 0.0:
                t0, t1 = (farthest - before) / rise, (nearest - before) / rise
                enter, leave = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
            width = column[j] - column[j - 1]
            first = min(first, column[j - 1] + enter * width)
            last = max(last, column[j - 1] + leave * width)
    return first, last


@njit(cache=True, nogil=True, error_model="numpy")
def hulls(column: Floats, inverse_depth: Floats, nearest: float, farthest: float) -> tuple[Floats, Floats]:
    """inverse_depth_window of inverse depths (height, k) that are known already; NaN where there is no sheet."""
    first, last = np.empty(len(inverse_depth)), np.empty(len(inverse_depth))
    for row in range(len(inverse_depth)):
        first[row], last[row] = _hull(column, inverse_depth[row], nearest, farthest)
    return first, last


@njit(cache=True, nogil=True, error_model="numpy")
def inverse_depth_window(
    normal: Floats, to_apex: Floats, column: Floats, rays: Floats, nearest: float, farthest: float
) -> tuple[Floats, Floats]:
    """For each row, the hull of the columns at which a ray meets the sheet between two depths.

    normal   (3,) of the sheet, camera frame; to_apex (3,) from the pinhole, camera frame, m
    column   (k,) px, ascending: where the rays were sampled
    rays     (height, 6, k) origin and direction with z = 1, camera frame
    nearest, farthest   1/m, inverse depths along the camera's z; nearest > farthest

    Inverse depth is linear in the column for a pinhole, and nearly so behind a lens or a port, which is what makes
    sparse columns enough. Rows that cannot see the stripe have first beyond the last column and last = -1.
    """
    height, k = rays.shape[0], rays.shape[2]
    inverse_depth = np.empty(k)
    first = np.full(height, column[-1] + 1.0)
    last = np.full(height, -1.0)
    offset = normal[0] * to_apex[0] + normal[1] * to_apex[1] + normal[2] * to_apex[2]
    for row in range(height):
        ray = rays[row]
        for j in range(k):
            across = normal[0] * ray[3, j] + normal[1] * ray[4, j] + normal[2] * ray[5, j]
            gap = offset - (normal[0] * ray[0, j] + normal[1] * ray[1, j] + normal[2] * ray[2, j])
            inverse_depth[j] = across / (gap + ray[2, j] * across)
        first[row], last[row] = _hull(column, inverse_depth, nearest, farthest)
    return first, last
