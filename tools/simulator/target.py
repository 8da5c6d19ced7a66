"""Calibration targets before a rig, rendered: every pixel's rays are followed to the target's faces.

The stripe has the profile of a Gaussian sheet about the rig's own laser model, window included.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.targets import AnyTarget
from garbi_map.log.records import Floats
from garbi_map.rig import Rig

PIXELS = 6000  # of a printed face's longer side


@dataclass(frozen=True)
class Look:
    """How the images come out: grey levels, px, m.

    samples  rays per pixel along each side; psf: 1 sigma of the lens, px; noise: 1 sigma, grey levels
    paper, ink, wall   grey level of the target and of what is behind; green: of the stripe on paper
    sheet    1 sigma of the sheet's thickness, m; margin: the board beyond what is printed, m
    """

    samples: int = 3
    psf: float = 0.7
    noise: float = 2.0
    paper: float = 130.0
    ink: float = 25.0
    wall: float = 45.0
    green: float = 110.0
    sheet: float = 0.0012
    margin: float = 0.05


@dataclass(frozen=True)
class Placed:
    """reflect (n,) grey levels of all rays; those `on` (k,) the target, and where they meet it, points (k, 3) m, rig
    frame."""

    reflect: Floats
    on: NDArray[np.int64]
    points: Floats


class Booth:
    """A rig that looks at a target. One set of rays serves all images."""

    def __init__(self, rig: Rig, target: AnyTarget, look: Look | None = None) -> None:
        self.rig, self.target, self.look = rig, target, look or Look()
        camera, samples = rig.camera, self.look.samples
        step = (np.arange(samples) + 0.5) / samples - 0.5
        u = (np.arange(camera.width)[:, None] + step).ravel()
        v = (np.arange(camera.height)[:, None] + step).ravel()
        columns, rows = np.meshgrid(u, v)
        self._origin, self._direction = camera.rays(columns.ravel(), rows.ravel())
        self._printed = [_printed(face.size, face.black) for face in target.faces]

    def placed(self, rotation: Rotation, translation: Floats) -> Placed:
        """What the camera sees of the target at camera <- target, m."""
        look, camera = self.look, self.rig.camera
        count = len(self._origin)
        reach, reflect = np.full(count, np.inf), np.full(count, look.wall)
        for face, (texture, scale) in zip(self.target.faces, self._printed, strict=True):
            place, normal = rotation.apply(face.origin) + translation, rotation.apply(face.normal)
            to = ((place - self._origin) @ normal) / (self._direction @ normal)
            there = self._origin + to[:, None] * self._direction - place
            x, y = there @ rotation.apply(face.u), there @ rotation.apply(face.v)
            near = (to > 0) & (to < reach)
            near &= (x > -look.margin) & (x < face.size[0] + look.margin)
            near &= (y > -look.margin) & (y < face.size[1] + look.margin)
            reach[near] = to[near]
            column, row = np.floor(x[near] * scale).astype(int), np.floor(y[near] * scale).astype(int)
            printed = (column >= 0) & (row >= 0) & (row < texture.shape[0]) & (column < texture.shape[1])
            value = np.full(len(column), look.paper)
            value[printed] = np.where(texture[row[printed], column[printed]], look.ink, look.paper)
            reflect[near] = value
        on = np.flatnonzero(np.isfinite(reach))
        points = self._origin[on] + reach[on, None] * self._direction[on]
        return Placed(reflect, on, points @ camera.rotation.T + camera.centre)

    def image(self, placed: Placed, alpha: float | None, rng: np.random.Generator) -> NDArray[np.uint8]:
        """BGR (h, w, 3) with the stripe at alpha, if any; what is random in it comes from rng."""
        look, camera, reflect = self.look, self.rig.camera, placed.reflect
        laser = np.zeros(len(reflect))
        if alpha is not None:
            away = np.linalg.norm(placed.points - self.rig.laser.apex, axis=1)
            off = self.rig.laser.off_sheet(placed.points, alpha) * away
            light = look.green * reflect[placed.on] / look.paper
            laser[placed.on] = light * np.exp(-0.5 * (off / look.sheet) ** 2)
        shape = (camera.height, look.samples, camera.width, look.samples)
        still = reflect.reshape(shape).mean(axis=(1, 3))[..., None]
        green = laser.reshape(shape).mean(axis=(1, 3))[..., None]
        mean = still + green * np.array([0.1, 1.0, 0.05])
        blurred = cv2.GaussianBlur(mean, (0, 0), look.psf) if look.psf > 0 else mean
        noisy = blurred + look.noise * rng.normal(size=blurred.shape)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def _printed(size: Floats, black: Floats) -> tuple[NDArray[np.bool_], float]:
    """What is black on a face, as an image, and its pixels per metre."""
    scale = PIXELS / float(size.max())
    texture = np.zeros((int(np.ceil(size[1] * scale)), int(np.ceil(size[0] * scale))), bool)
    for x, y, width, height in np.round(black * scale).astype(int):
        texture[y : y + height, x : x + width] = True
    return texture, scale
