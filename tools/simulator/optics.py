"""One image: the stripe, its skirt, the lit water, marine snow, daylight, and the sensor.

All in the rig frame and in grey levels; the physics and its sources are in README.md beside this file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from garbi_map.rig import Rig
from tools.simulator import kernels
from tools.simulator.scenario import Scenario
from tools.simulator.seabed import Scene
from tools.simulator.sheet import SLICES, WEIGHTS, Cast, LitLine, Plane, cast_slice, plane_at

COARSE = 4  # px, of the image in which the skirt is computed
EDGE = 0.01  # m, between neighbouring rays' ranges: more is an edge
DAYLIGHT = np.array([0.85, 1.0, 0.35], np.float32)  # blue, green, red under some metres of water
ABSORPTION = np.array([0.9, 1.0, 5.0], np.float32)  # of daylight, relative to green
NOISE_TABLE = 1 << 22
SNOW_LEVEL = 60.0  # grey level of the median particle in the sheet, 1 m from laser and camera


@dataclass(frozen=True)
class View:
    """What a rig at one place sees: `cast` in the rig frame, `albedo` (n,) of points (n, 3) there, `up` (3,)."""

    cast: Cast
    albedo: Callable[[Floats], NDArray[np.float32]]
    up: Floats


def view_of(scene: Scene, position: Floats, rotation: Rotation, time: float) -> View:
    """The scene from a rig at position (3,) m with rotation map <- rig, at a time (s)."""
    matrix = rotation.as_matrix()

    def cast(origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
        distance, normal = scene.cast(origin @ matrix.T + position, direction @ matrix.T, time)
        return distance, normal @ matrix

    return View(cast, lambda points: scene.texture.at(points @ matrix.T + position), matrix[2])


class Renderer:
    """The camera of a scenario. Stateless once made: images may be rendered in any order and on several threads."""

    def __init__(self, scenario: Scenario, rig: Rig) -> None:
        self.scenario = scenario
        self.rig = rig
        camera, water = scenario.camera, scenario.water
        self._forward = water.scattering * water.forward_sharpness
        self._beam = water.absorption + water.scattering  # what leaves the sharp image
        self._diffuse = self._beam - self._forward  # what leaves the image
        shape = (rig.camera.height, rig.camera.width)
        v, u = np.mgrid[: shape[0], : shape[1]]
        eye, sight = rig.rays(u.ravel(), v.ravel())
        self._eye = eye.reshape(*shape, 3).astype(np.float32)
        if np.ptp(eye, axis=0).max() < 1e-9:
            self._eye = np.ascontiguousarray(self._eye[:1, :1])
        self._sight = sight.reshape(*shape, 3).astype(np.float32)
        axis = rig.camera.rotation[:, 2]
        self._vignette = ((self._sight @ axis) ** 4).astype(np.float32)
        # Pixel area as a solid angle is cos^3 / (alpha_u alpha_v); the lens adds the fourth cosine (in the vignette).
        self._pixel = 1.0 / (rig.camera.alpha_u * rig.camera.alpha_v)
        step = camera.ambient_step
        grid = (-(-shape[0] // step), -(-shape[1] // step))
        rows, columns = (np.mgrid[: grid[0], : grid[1]] + 0.5) * step - 0.5
        coarse = rig.rays(columns.ravel(), rows.ravel())
        self._grid, self._coarse_eye, self._coarse_sight = grid, *coarse
        self._coarse_vignette = ((self._coarse_sight @ axis) ** 4)[:, None]
        self._crosstalk = np.array([camera.laser_blue, 1.0, camera.laser_red], np.float32)
        self._per_level = camera.full_well / 255.0
        self.power = 1.0
        self.power = camera.exposure / self._test_exposure()

    @cached_property
    def _noise(self) -> NDArray[np.float32]:
        """Drawing 1.3 million normal numbers costs a third of an image: rows begin anywhere in a table of them."""
        return np.random.default_rng(self.scenario.seed).standard_normal(NOISE_TABLE, dtype=np.float32)

    def image(self, view: View, alpha: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The image (h, w, 3) BGR at a laser angle; what is random in it comes from `rng`."""
        laser, daylight = self.light(view, alpha, rng)
        camera = self.scenario.camera
        height, width = laser.shape
        start = rng.integers(0, len(self._noise) - 3 * width, height)
        return kernels.expose(
            laser, daylight, self._noise, start, self._crosstalk, camera.black, self._per_level, camera.read_noise
        )

    def light(
        self, view: View, alpha: float, rng: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Laser light (h, w) and daylight (h, w, 3), grey levels, before the sensor."""
        camera, water = self.scenario.camera, self.scenario.water
        plane = plane_at(self.rig, alpha, self.scenario.laser)
        behind, daylight = self._daylight(view)
        lines = self.stripe_lines(plane, view)
        middle = lines[len(SLICES) // 2][0]
        laser = np.zeros(self._vignette.shape, np.float32)
        if water.backscatter > 0:
            self._add_lit_water(laser, plane, middle, behind)
        for line, energy in lines:
            kernels.draw_line(laser, line.pixel, energy, line.range, camera.psf, EDGE)
        if self._forward > 0:
            self._add_skirt(laser, lines)
        self._add_snow(laser, daylight, plane, middle, rng)
        return laser, daylight

    def stripe_lines(self, plane: Plane, view: View) -> list[tuple[LitLine, Floats]]:
        """The slices of the sheet where they land, with the sharp energy (k,) that each ray brings into the image."""
        laser = self.scenario.laser
        lines = [cast_slice(self.rig, plane, laser, offset, view.cast) for offset in SLICES]
        return [
            (line, weight * self.sharp_energy(line, plane, view)) for line, weight in zip(lines, WEIGHTS, strict=True)
        ]

    def sharp_energy(self, line: LitLine, plane: Plane, view: View) -> Floats:
        """Light (k,), summed over the pixels it falls on, that each ray of a line brings into the image unscattered."""
        spread = 1.0 / (1.0 + plane.tangent**2) * (plane.tangent[1] - plane.tangent[0])  # rad between rays
        energy = np.zeros(len(line.range))
        seen = np.flatnonzero(line.seen)
        away, point = line.distance[seen], line.point[seen]
        lens = (point - self.rig.camera.centre) @ self.rig.camera.rotation[:, 2] / away
        kept = np.exp(-self._beam * (line.range[seen] + away))
        energy[seen] = (
            self.power * spread[seen] * view.albedo(point) / np.pi * line.cosine[seen] * lens / away**2 * kept
        )
        return energy

    def _test_exposure(self) -> float:
        """Peak of the stripe on mean ground, square to the view, at the exposure range, with unit power."""
        where = self.scenario.camera.exposure_range
        albedo = self.scenario.seabed.albedo

        def wall(origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
            reach = (where - origin[:, 0]) / np.maximum(direction[:, 0], 1e-6)
            return reach, np.broadcast_to([-1.0, 0.0, 0.0], origin.shape)

        view = View(wall, lambda points: np.full(len(points), albedo, np.float32), np.array([0.0, 0.0, 1.0]))
        towards = np.arctan2(-self.rig.laser.y, where) - self.rig.laser.delta
        plane = plane_at(self.rig, float(towards), self.scenario.laser)
        image = np.zeros(self._vignette.shape, np.float32)
        for line, energy in self.stripe_lines(plane, view):
            kernels.draw_line(image, line.pixel, energy, line.range, self.scenario.camera.psf, EDGE)
        return float(image.max())

    def _daylight(self, view: View) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where each line of sight ends (h, w) m, and daylight (h, w, 3): the ground, dimmed, and its veil."""
        shape = self._vignette.shape
        distance, normal = view.cast(self._coarse_eye, self._coarse_sight)
        distance = np.minimum(distance, 30.0)
        point = self._coarse_eye + distance[:, None] * self._coarse_sight
        shade = view.albedo(point) / self.scenario.seabed.albedo * (0.6 + 0.4 * np.maximum(normal @ view.up, 0))
        kept = np.exp(-(self._diffuse * distance)[:, None] * ABSORPTION)
        light = self.scenario.camera.ambient * DAYLIGHT * (shade[:, None] * kept + (1 - kept)) * self._coarse_vignette
        return self._enlarged(distance)[: shape[0], : shape[1]], self._enlarged(light)[: shape[0], : shape[1]]

    def _enlarged(self, values: Floats) -> NDArray[np.float32]:
        """Values on the coarse grid, (n,) or (n, 3), at every pixel."""
        step, grid = self.scenario.camera.ambient_step, self._grid
        coarse = values.reshape(*grid, *values.shape[1:]).astype(np.float32)
        full = cv2.resize(coarse, (grid[1] * step, grid[0] * step), interpolation=cv2.INTER_LINEAR)
        return np.asarray(full, np.float32)

    def _add_lit_water(
        self, laser: NDArray[np.float32], plane: Plane, line: LitLine, behind: NDArray[np.float32]
    ) -> None:
        """The lit sheet between laser and seabed, softened by the lens like everything else."""
        reach = np.minimum(line.range, 30.0).astype(np.float32)
        lit = np.zeros_like(laser)
        kernels.add_lit_water(
            lit,
            self._eye,
            self._sight,
            self._vignette,
            behind,
            np.stack([plane.apex, plane.normal, plane.ahead, plane.aside]).astype(np.float32),
            reach,
            float(plane.tangent[0]),
            float(plane.tangent[1] - plane.tangent[0]),
            self._diffuse,
            self.power * self.scenario.water.backscatter * self._pixel,
        )
        cv2.GaussianBlur(lit, (0, 0), self.scenario.camera.psf, dst=lit)
        laser += lit

    def _add_skirt(self, laser: NDArray[np.float32], lines: list[tuple[LitLine, Floats]]) -> None:
        """Small-angle scattering: energy that left the sharp stripe arrives beside it (Jaffe 1990)."""
        shape = tuple(-(-n // COARSE) for n in laser.shape)
        coarse = np.zeros(shape, np.float32)
        away = 0.0
        total = 0.0
        for line, energy in lines:
            seen = line.seen
            skirt = energy[seen] * np.expm1(self._forward * (line.range[seen] + line.distance[seen]))
            kernels.add_bilinear(coarse, line.pixel[seen], skirt, COARSE)
            away += float((skirt * line.distance[seen]).sum())
            total += float(skirt.sum())
        if total <= 0:
            return
        width = self.scenario.water.forward_angle * away / total * self.rig.camera.alpha_u / COARSE
        coarse = cv2.filter2D(coarse, -1, _skirt_kernel(max(width, 1.0)), borderType=cv2.BORDER_CONSTANT)
        size = (shape[1] * COARSE, shape[0] * COARSE)
        laser += cv2.resize(coarse, size)[: laser.shape[0], : laser.shape[1]] / COARSE**2

    def _add_snow(
        self,
        laser: NDArray[np.float32],
        daylight: NDArray[np.float32],
        plane: Plane,
        line: LitLine,
        rng: np.random.Generator,
    ) -> None:
        """Particles: bright where they cross the sheet, faint and blurred in daylight near the lens."""
        water, camera = self.scenario.water, self.scenario.camera
        relative = water.snow_brightness * SNOW_LEVEL * 2 * np.pi * camera.psf**2
        depth = np.minimum(line.range, 4.0) / np.sqrt(1 + plane.tangent**2)  # m, along `ahead`
        area = 0.5 * depth**2 * (plane.tangent[1] - plane.tangent[0])
        thickness = np.sqrt(2 * np.pi) * self.scenario.laser.width
        ray = rng.choice(len(area), rng.poisson(water.snow * thickness * area.sum()), p=area / area.sum())
        along = depth[ray] * np.sqrt(rng.uniform(size=len(ray)))
        point = plane.apex + along[:, None] * (plane.ahead + plane.tangent[ray, None] * plane.aside)
        reach = along * np.sqrt(1 + plane.tangent[ray] ** 2)
        size = rng.lognormal(0.0, 0.9, len(ray))
        blur = camera.psf * (1 + 0.3 * np.minimum(size, 4.0))
        pixel = self.rig.project(point)
        away = np.linalg.norm(point - self.rig.camera.centre, axis=1)
        spot = relative * size / (reach * away**2) * np.exp(-self._diffuse * (reach + away - 2))
        shown = np.isfinite(pixel[:, 0])
        kernels.draw_points(laser, pixel[shown], spot[shown], blur[shown])
        near, far = 0.1, 0.5  # m: farther ones drown in the noise
        volume = self._pixel * laser.size * (far**3 - near**3) / 3
        count = rng.poisson(water.snow * volume)
        where = rng.uniform([0, 0], [laser.shape[1], laser.shape[0]], (count, 2))
        away = np.cbrt(rng.uniform(near**3, far**3, count))
        glow = 0.4 * camera.ambient * water.snow_brightness * rng.lognormal(0.0, 0.9, count) / away**2
        for channel in range(3):
            kernels.draw_points(
                daylight[..., channel], where, glow * DAYLIGHT[channel], camera.psf * (0.6 + 0.3 / away)
            )


def _skirt_kernel(width: float) -> NDArray[np.float32]:
    """The inverse transform of exp(-width |frequency|) in the plane: width / (2 pi (r^2 + width^2)^1.5)."""
    radius = int(np.ceil(12 * width))
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return (width / (2 * np.pi * (x**2 + y**2 + width**2) ** 1.5)).astype(np.float32)
