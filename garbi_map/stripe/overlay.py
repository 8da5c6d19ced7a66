"""A picture of what the detector saw in an image."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.log.records import Image
from garbi_map.stripe.decode import UnusableImage, decode
from garbi_map.stripe.detector import Candidates, StripeDetector

SCALE = 2
"""Pixels of the picture per pixel of the image."""
BAR = 20.0
"""The bars of sigma are this many times too long, to be seen at all."""
_CANDIDATE, _CHOICE, _SIGMA, _CLIPPED = (255, 160, 0), (60, 60, 255), (0, 220, 255), (255, 0, 255)


def draw_overlay(image: NDArray[np.uint8], found: Candidates) -> NDArray[np.uint8]:
    """Picture (2 h, 2 w, 3) BGR of an image (h, w) or (h, w, 3): candidates blue, the choice red (magenta where it is
    clipped), and a yellow bar of 20 sigma to either side of it."""
    import cv2

    coloured = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    height, width = coloured.shape[:2]
    picture = cv2.resize(coloured, (SCALE * width, SCALE * height), interpolation=cv2.INTER_NEAREST)
    row, number = np.nonzero(np.isfinite(found.u))
    for r, u in zip(row.tolist(), found.u[row, number], strict=True):
        cv2.circle(picture, _at(u, r), 3, _CANDIDATE, 1)
    chosen = np.flatnonzero(found.chosen >= 0)
    pick = found.chosen[chosen]
    columns = (chosen, found.u[chosen, pick], found.sigma[chosen, pick], found.saturated[chosen, pick])
    for r, u, sigma, clipped in zip(*(values.tolist() for values in columns), strict=True):
        cv2.line(picture, _at(u - BAR * sigma, r), _at(u + BAR * sigma, r), _SIGMA, 1)
        cv2.circle(picture, _at(u, r), 1, _CLIPPED if clipped else _CHOICE, -1)
    text = f"{len(chosen)} of {height} rows, width {found.spread:.2f} px, noise {found.noise:.1f}"
    cv2.putText(picture, text, (8, SCALE * height - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)


def _at(u: float, row: int) -> tuple[int, int]:
    return round(SCALE * (float(u) + 0.5)), round(SCALE * (float(row) + 0.5))


def write_overlays(
    folder: Path,
    images: Iterable[Image],
    detector: StripeDetector,
    alpha_of: Callable[[int], float] | None = None,
) -> int:
    """A PNG per usable image, named after its stamp; how many. Raises GarbiError where the folder refuses."""
    import cv2

    count = 0
    for image in images:
        try:
            pixels = decode(image, detector.image_size, detector.settings.max_pixels)
        except UnusableImage:
            continue
        found = detector.candidates(pixels, None if alpha_of is None else alpha_of(image.stamp_ns))
        name = folder / f"stripe_{image.stamp_ns}.png"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            aside = name.with_name(f".{name.name}")
            aside.write_bytes(cv2.imencode(".png", draw_overlay(pixels, found))[1].tobytes())
            aside.replace(name)
        except OSError as error:
            raise GarbiError(f"{name}: cannot be written: {error.strerror}") from error
        count += 1
    return count
