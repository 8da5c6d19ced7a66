"""Stripes without images: the rows where the sheet lands, with the noise that the detector has on rendered images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Floats
from garbi_map.stripe.types import Stripe
from tools.simulator.optics import Renderer, View
from tools.simulator.sheet import cast_slice, plane_at

# Measured on rendered images with a smoothed-derivative detector in clear water; haze adds a bias, not modelled.
FLOOR = 0.035  # px, what is left of the error without noise: curved and textured ground
BOUND = 2.0  # times the single-row bound for white noise: JPEG
RAYS = 2.1  # of the fan, to a row of the image
FAINTEST = 13.0  # grey levels: fainter peaks are found in less than half of the rendered rows
JUMP = 0.01  # m between neighbouring rays: an edge, across which no row is interpolated,
STEEP = 0.08  # m, unless up to this it goes on as steeply on both sides: ground under a grazing sheet


def cast_stripe(renderer: Renderer, view: View, alpha: float, stamp_ns: int, rng: np.random.Generator) -> Stripe:
    """The stripe of one moment: the nearest surface wins where a row meets two; noise from the peak's own light."""
    scenario, rig = renderer.scenario, renderer.rig
    plane = plane_at(rig, alpha, scenario.laser, round(RAYS * rig.camera.height))
    line = cast_slice(rig, plane, scenario.laser, 0.0, view.cast)
    energy = renderer.sharp_energy(line, plane, view)
    u, v = line.pixel.T
    reach = np.where(line.seen, line.range, 0.0)
    linked = line.seen[:-1] & line.seen[1:] & _smooth(np.diff(reach))
    first = np.flatnonzero(linked)
    low, high = np.minimum(v[first], v[first + 1]), np.maximum(v[first], v[first + 1])
    row = np.ceil(low)  # rays are denser than rows: a pair spans one row at most, but for grazing surfaces
    spans = (row <= high) & (high > low) & (row >= 0) & (row < rig.camera.height)
    first, row = first[spans], row[spans].astype(int)
    w = (row - v[first]) / (v[first + 1] - v[first])
    column = u[first] * (1 - w) + u[first + 1] * w
    away = line.distance[first]
    laser = scenario.laser
    thickness = laser.width + laser.divergence * line.range[first]
    width = np.hypot(scenario.camera.psf, thickness * rig.camera.alpha_u / away)
    level = 0.5 * (energy[first] + energy[first + 1]) / np.abs(v[first + 1] - v[first])
    peak = level / (np.sqrt(2 * np.pi) * width)
    order = np.lexsort((away, row))
    order = order[np.r_[True, np.diff(row[order]) > 0]] if len(order) else order
    order = order[(peak[order] > FAINTEST) & (column[order] > 0) & (column[order] < rig.camera.width - 1)]
    row, column, width, peak = row[order], column[order], width[order], peak[order]
    per_level = scenario.camera.full_well / 255.0
    noise = np.sqrt((scenario.camera.read_noise / per_level) ** 2 + 0.5 * peak / per_level)
    sigma = np.hypot(FLOOR, BOUND * noise / peak * np.sqrt(2 * width / np.sqrt(np.pi)))
    column = column + sigma * rng.normal(size=len(row))
    found = np.minimum(peak, 255.0)
    return Stripe(
        stamp_ns,
        row.astype(np.int32),
        column.astype(np.float32),
        sigma.astype(np.float32),
        found.astype(np.float32),
        peak > 252.0,
    )


def _smooth(change: Floats) -> NDArray[np.bool_]:
    """Whether a surface goes on between neighbouring rays, by the changes of range (n,) m from each to the next."""
    before, after = np.r_[np.inf, change[:-1]], np.r_[change[1:], np.inf]
    steady = (np.abs(change - before) < JUMP) & (np.abs(change - after) < JUMP)
    return (np.abs(change) < JUMP) | (steady & (np.abs(change) < STEEP))
