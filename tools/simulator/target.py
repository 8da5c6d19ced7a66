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
from tools.simulator import kernels

PIXELS = 6000  # of a printed face's longer side
DARK = 6.0  # sheet's sigmas, beyond which it gives no light that a grey level could show


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
    """What every pixel's rays meet: reflect (p, s) grey levels of p pixels' s rays, and where they meet the target,
    points (p, s, 3) m, rig frame, NaN beside it; width (p,) m over which those of a pixel spread; still (h, w) the image
    without a stripe."""

    reflect: Floats
    points: Floats
    width: Floats
    still: Floats


class Booth:
    """A rig that looks at a target. One set of rays serves all images."""

    def __init__(self, rig: Rig, target: AnyTarget, look: Look | None = None) -> None:
        self.rig, self.target, self.look = rig, target, look or Look()
        camera, samples = rig.camera, self.look.samples
        step = (np.arange(samples) + 0.5) / samples - 0.5
        u = (np.arange(camera.width)[:, None] + step).ravel()
        v = (np.arange(camera.height)[:, None] + step).ravel()
        shape = (camera.height, samples, camera.width, samples)
        # the rays of one pixel follow each other
        columns, rows = (grid.reshape(shape).transpose(0, 2, 1, 3).ravel() for grid in np.meshgrid(u, v))
        self._origin, self._direction = camera.rays(columns, rows)
        self._printed = [_printed(face.size, face.black) for face in target.faces]

    def placed(self, rotation: Rotation, translation: Floats) -> Placed:
        """What the camera sees of the target at camera <- target, m."""
        look, camera = self.look, self.rig.camera
        count = len(self._origin)
        reach, reflect = np.full(count, np.inf), np.full(count, look.wall)
        for face, (texture, scale) in zip(self.target.faces, self._printed, strict=True):
            place, axes = rotation.apply(face.origin) + translation, rotation.apply([face.u, face.v, face.normal])
            levels = (look.paper, look.ink)
            kernels.see_face(
                self._origin,
                self._direction,
                place,
                axes,
                face.size,
                look.margin,
                texture,
                scale,
                levels,
                reach,
                reflect,
            )
        reach[np.isinf(reach)] = np.nan
        points = (self._origin + reach[:, None] * self._direction) @ camera.rotation.T + camera.centre
        samples = reflect.reshape(-1, look.samples**2)
        points = points.reshape(*samples.shape, 3)
        still = samples.mean(axis=1).reshape(camera.height, camera.width)
        return Placed(samples, points, np.linalg.norm(points[:, -1] - points[:, 0], axis=1), still)

    def image(self, placed: Placed, alpha: float | None, rng: np.random.Generator) -> NDArray[np.uint8]:
        """BGR (h, w, 3) with the stripe at alpha, if any; what is random in it comes from rng."""
        look = self.look
        green = np.zeros(placed.still.size)
        if alpha is not None:
            middle = self._off(placed.points[:, look.samples**2 // 2], alpha)
            lit = np.flatnonzero(np.abs(middle) < DARK * look.sheet + placed.width)
            off = np.nan_to_num(self._off(placed.points[lit].reshape(-1, 3), alpha), nan=np.inf)
            off = off.reshape(len(lit), look.samples**2)
            light = look.green * placed.reflect[lit] / look.paper * np.exp(-0.5 * (off / look.sheet) ** 2)
            green[lit] = light.mean(axis=1)
        mean = placed.still[..., None] + green.reshape(placed.still.shape)[..., None] * np.array([0.1, 1.0, 0.05])
        blurred = cv2.GaussianBlur(mean, (0, 0), look.psf) if look.psf > 0 else mean
        noisy = blurred + look.noise * rng.standard_normal(blurred.shape, np.float32)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)

    def _off(self, points: Floats, alpha: float) -> Floats:
        """Distances (n,) m, about, of points (n, 3) from the sheet."""
        return self.rig.laser.off_sheet(points, alpha) * np.linalg.norm(points - self.rig.laser.apex, axis=1)


def _printed(size: Floats, black: Floats) -> tuple[NDArray[np.bool_], float]:
    """What is black on a face, as an image, and its pixels per metre."""
    scale = PIXELS / float(size.max())
    texture = np.zeros((int(np.ceil(size[1] * scale)), int(np.ceil(size[0] * scale))), bool)
    for x, y, width, height in np.round(black * scale).astype(int):
        texture[y : y + height, x : x + width] = True
    return texture, scale
