"""Compiled image formation."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Image = NDArray[np.float32]


@njit(cache=True, nogil=True, fastmath=True)
def _deposit(image: Image, u: float, v: float, energy: float, sigma: float) -> None:
    """Add a Gaussian of that total energy at column u, row v."""
    height, width = image.shape
    radius = int(4.0 * sigma) + 1
    column, row = round(u), round(v)
    if column < -radius or row < -radius or column >= width + radius or row >= height + radius:
        return
    scale = 0.5 / (sigma * sigma)
    peak = energy * scale / math.pi
    left, right = max(column - radius, 0), min(column + radius + 1, width)
    along = np.empty(2 * radius + 1, np.float32)
    for c in range(left, right):
        along[c - left] = math.exp(-scale * (c - u) ** 2)
    for r in range(max(row - radius, 0), min(row + radius + 1, height)):
        across = np.float32(peak * math.exp(-scale * (r - v) ** 2))
        for c in range(left, right):
            image[r, c] += across * along[c - left]


@njit(cache=True, nogil=True)
def draw_points(image: Image, pixel: NDArray, energy: NDArray, sigma: NDArray) -> None:
    """Add Gaussian spots: pixel (n, 2), energy (n,), sigma (n,) px."""
    for i in range(len(energy)):
        _deposit(image, pixel[i, 0], pixel[i, 1], energy[i], sigma[i])


@njit(cache=True, nogil=True)
def draw_line(image: Image, pixel: NDArray, energy: NDArray, reach: NDArray, sigma: float, jump: float) -> None:
    """Add a chain of rays' energies, blurred by sigma (px).

    pixel (k, 2), NaN where not seen; energy (k,); reach (k,) m. Half of a ray's energy is spread halfway towards each
    neighbour, unless their reach differs by more than `jump` (m), which is an edge."""
    for i in range(len(energy)):
        if not math.isfinite(pixel[i, 0]):
            continue
        for other in (i - 1, i + 1):
            half = 0.5 * energy[i]
            if other < 0 or other >= len(energy) or not math.isfinite(pixel[other, 0]):
                _deposit(image, pixel[i, 0], pixel[i, 1], half, sigma)
                continue
            du, dv = 0.5 * (pixel[other, 0] - pixel[i, 0]), 0.5 * (pixel[other, 1] - pixel[i, 1])
            if abs(reach[other] - reach[i]) > jump:
                du, dv = 0.0, 0.0
            pieces = int(math.hypot(du, dv) / (0.5 * sigma)) + 1
            for piece in range(pieces):
                w = (piece + 0.5) / pieces
                _deposit(image, pixel[i, 0] + w * du, pixel[i, 1] + w * dv, half / pieces, sigma)


@njit(cache=True, nogil=True)
def add_bilinear(image: Image, pixel: NDArray, energy: NDArray, cell: int) -> None:
    """Add energies to an image whose pixels are cell x cell of the full one's; pixel (n, 2) of the full image."""
    height, width = image.shape
    for i in range(len(energy)):
        if not math.isfinite(pixel[i, 0]):
            continue
        x, y = (pixel[i, 0] + 0.5) / cell - 0.5, (pixel[i, 1] + 0.5) / cell - 0.5
        c, r = math.floor(x), math.floor(y)
        for rr in range(max(r, 0), min(r + 2, height)):
            for cc in range(max(c, 0), min(c + 2, width)):
                image[rr, cc] += np.float32(energy[i] * (1 - abs(x - cc)) * (1 - abs(y - rr)))


@njit(cache=True, nogil=True, fastmath=True)
def add_lit_water(
    image: Image,
    eye: NDArray,
    sight: NDArray,
    vignette: Image,
    behind: Image,
    plane: NDArray,
    reach: NDArray,
    first: float,
    step: float,
    attenuation: float,
    strength: float,
) -> None:
    """Single scattering in the lit sheet: each line of sight crosses it once, before or behind where the sheet ends.

    eye (h, w, 3) or (1, 1, 3) and sight (h, w, 3): the lines of sight, rig frame; vignette (h, w); behind (h, w) m,
    where the line of sight ends; plane (4, 3): apex, normal, ahead, aside; reach (k,) m, of the sheet at tangents
    first, first + step, ...; attenuation 1/m of both paths; strength: grey levels times m.
    A sheet of thickness w has irradiance P / (r w) and is crossed over w / |sight . normal|: w cancels."""
    height, width = image.shape
    moving = eye.shape[0] > 1
    rays = len(reach)
    ax, ay, az = plane[0, 0], plane[0, 1], plane[0, 2]
    nx, ny, nz = plane[1, 0], plane[1, 1], plane[1, 2]
    fx, fy, fz = plane[2, 0], plane[2, 1], plane[2, 2]
    sx, sy, sz = plane[3, 0], plane[3, 1], plane[3, 2]
    ox, oy, oz = eye[0, 0, 0], eye[0, 0, 1], eye[0, 0, 2]
    for row in range(height):
        before = np.float32(np.nan)
        for column in range(width):
            if moving:
                ox, oy, oz = eye[row, column, 0], eye[row, column, 1], eye[row, column, 2]
            dx, dy, dz = sight[row, column, 0], sight[row, column, 1], sight[row, column, 2]
            slant = dx * nx + dy * ny + dz * nz
            t = ((ax - ox) * nx + (ay - oy) * ny + (az - oz) * nz) / slant
            if not 0.02 < t < 30.0:
                before = np.float32(np.nan)
                continue
            px, py, pz = ox + t * dx - ax, oy + t * dy - ay, oz + t * dz - az
            ahead = px * fx + py * fy + pz * fz
            if ahead < 0.02:
                before = np.float32(np.nan)
                continue
            place = ((px * sx + py * sy + pz * sz) / ahead - first) / step
            if place < 0.0 or place >= rays - 1:
                before = np.float32(np.nan)
                continue
            k = int(place)
            w = place - k
            end = reach[k] * (1.0 - w) + reach[k + 1] * w
            r = math.sqrt(px * px + py * py + pz * pz)
            gap = np.float32(end - r)
            # The share of the pixel that lies on the lit side, from how fast the gap closes between columns.
            slope = abs(gap - before)
            before = gap
            share = np.float32(1.0 if gap > 0.0 else 0.0)
            if slope > 0.0 and abs(gap) < slope:
                share = np.float32(min(max(float(gap / slope) + 0.5, 0.0), 1.0))
            if share <= 0.0 or t > behind[row, column] + 0.03:
                continue
            light = strength / (r * abs(slant)) * math.exp(-attenuation * (r + t))
            image[row, column] += np.float32(share * light * vignette[row, column])


@njit(cache=True, nogil=True, fastmath=True)
def expose(
    laser: Image,
    daylight: NDArray,
    noise: Image,
    start: NDArray,
    crosstalk: NDArray,
    black: float,
    per_level: float,
    read: float,
) -> NDArray[np.uint8]:
    """What the sensor makes of the light, BGR uint8: shot noise (per_level: electrons per grey level), read noise
    (electrons), black level, clipping.

    laser (h, w) and daylight (h, w, 3) grey levels; noise: a long table of standard normal numbers, of which row r
    takes 3 w from start[r] on; crosstalk (3,) of the laser."""
    height, width = laser.shape
    out = np.empty((height, width, 3), np.uint8)
    floor = np.float32((read / per_level) ** 2)
    gain = np.float32(1.0 / per_level)
    lowest = np.float32(black + 0.5)
    for row in range(height):
        at = start[row]
        for column in range(width):
            for channel in range(3):
                level = laser[row, column] * crosstalk[channel] + daylight[row, column, channel]
                value = level + lowest + math.sqrt(level * gain + floor) * noise[at]
                at += 1
                out[row, column, channel] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def see_face(  # type: ignore[no-untyped-def]
    origin, direction, place, axes, size, margin, texture, scale, levels, reach, reflect
) -> None:
    """What rays meet of a flat face, where nothing nearer was met: changes reach (n,) m and reflect (n,).

    origin, direction (n, 3); place (3,) of the face's corner, axes (3, 3) its x, y and normal, size (2,) m and its
    blank margin, m; texture (h, w), true where black, of `scale` pixels per metre; levels: of paper and of ink."""
    for i in range(len(reach)):
        ahead = before = 0.0
        for k in range(3):
            before += (place[k] - origin[i, k]) * axes[2, k]
            ahead += direction[i, k] * axes[2, k]
        to = before / ahead
        if not 0.0 < to < reach[i]:
            continue
        x = y = 0.0
        for k in range(3):
            there = origin[i, k] + to * direction[i, k] - place[k]
            x += there * axes[0, k]
            y += there * axes[1, k]
        if not (-margin < x < size[0] + margin and -margin < y < size[1] + margin):
            continue
        reach[i] = to
        column, row = math.floor(x * scale), math.floor(y * scale)
        printed = 0 <= column < texture.shape[1] and 0 <= row < texture.shape[0]
        reflect[i] = levels[1] if printed and texture[row, column] else levels[0]
