"""The map as a picture: relief shaded from the north-west, depth as colour, a scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import written_aside
from garbi_map.export.palette import depth_colours, height_range
from garbi_map.export.settings import ExportSettings
from garbi_map.seabed import Seabed, fill_holes

_PAPER = (255, 255, 255)
_VOID = (238, 240, 242)
_INK = (40, 33, 27)  # blue, green, red, as OpenCV wants it


def write_hillshade(
    path: Path, seabed: Seabed, settings: ExportSettings, title: str = "Seabed map", placed: bool = False
) -> None:
    """Write a PNG, north up. Raises GarbiError where the file cannot be written."""
    with written_aside(path) as aside:
        aside.write_bytes(png(hillshade(seabed, settings, title, north_name(placed))))


def north_name(placed: bool) -> str:
    """What is up in a map that is placed on Earth, or is not."""
    return "grid north" if placed else "y (north)"


def png(picture: NDArray[np.uint8]) -> bytes:
    """A picture (rows, columns, 3), blue, green, red, as the bytes of a PNG file."""
    import cv2

    return cv2.imencode(".png", picture)[1].tobytes()


def hillshade(seabed: Seabed, settings: ExportSettings, title: str, north: str) -> NDArray[np.uint8]:
    """The picture (rows, columns, 3), blue, green, red: map, scale bar, north arrow, depth legend and title."""
    elevation, _ = fill_holes(seabed.elevation, round(settings.widest_hole / seabed.cell))
    elevation, cell = fitted(elevation, seabed.cell, settings.hillshade_pixels)
    low, high = height_range(elevation)
    shade = relief(elevation, cell, settings.sun_azimuth, settings.sun_elevation, settings.exaggeration)
    colours = depth_colours(elevation, low, high)[..., ::-1] * shade[..., None]
    relief_map = np.where(np.isfinite(elevation)[..., None], np.clip(colours, 0, 255), _VOID).astype(np.uint8)[::-1]
    return _framed(relief_map, cell, low, high, title, north, settings.widest_hole)


def fitted(
    band: NDArray[np.float32], cell: float, pixels: int, enlarge: bool = True
) -> tuple[NDArray[np.float32], float]:
    """A raster enlarged or averaged by a whole factor to about `pixels` on its longer side; a pixel's side, m."""
    longest = max(band.shape)
    if longest <= pixels:
        factor = max(1, pixels // longest) if enlarge else 1
        return np.repeat(np.repeat(band, factor, 0), factor, 1), cell / factor
    factor = -(-longest // pixels)
    padded = np.pad(band, [(0, -side % factor) for side in band.shape], constant_values=np.nan)
    blocks = padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor)
    known = np.isfinite(blocks)
    count = known.sum((1, 3))
    total = np.where(known, blocks, 0).sum((1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(np.float32), cell * factor


def relief(
    elevation: NDArray[np.float32], cell: float, azimuth: float, sun: float, exaggeration: float
) -> NDArray[np.float32]:
    """Brightness about 1 of a surface (row 0 in the south) under a sun and a bright sky (Lambert's cosine)."""
    smooth = smoothed(elevation, rim=1e-3)
    north, east = np.gradient(exaggeration * np.where(np.isfinite(smooth), smooth, np.nanmean(smooth)), cell)
    a, s = np.radians(azimuth), np.radians(sun)
    lit = np.sin(s) - np.cos(s) * (east * np.sin(a) + north * np.cos(a))
    lit = np.maximum(lit / np.sqrt(1 + east**2 + north**2), 0.0) / np.sin(s)
    return (0.35 + 0.65 * np.minimum(lit, 1.5)).astype(np.float32)


def smoothed(elevation: NDArray[np.float32], rim: float = 0.5) -> NDArray[np.float32]:
    """A surface without what is finer than a pixel and a half, which is noise; as far as the share `rim` is known."""
    import cv2

    known = np.isfinite(elevation).astype(np.float32)
    weight = cv2.GaussianBlur(known, (0, 0), 1.5)
    smooth = cv2.GaussianBlur(np.where(known > 0, elevation, 0).astype(np.float32), (0, 0), 1.5)
    return np.divide(smooth, weight, out=np.full_like(smooth, np.nan), where=weight > rim)


def _framed(
    picture: NDArray[np.uint8], pixel: float, low: float, high: float, title: str, north: str, hole: float
) -> NDArray[np.uint8]:
    """The map on paper, with what is needed to read it."""
    import cv2

    sans = cv2.FontFace("sans")
    size = int(np.clip(max(picture.shape) / 55, 16, 40))
    margin, legend = 2 * size, 10 * size
    height = max(picture.shape[0], 16 * size)
    width = max(picture.shape[1], 18 * size)
    page = np.full((height + 7 * size + margin, width + legend + 2 * margin, 3), _PAPER, np.uint8)
    top, left = margin + 2 * size, margin
    page[top : top + picture.shape[0], left : left + picture.shape[1]] = picture

    def write(text: str, x: float, y: float, weight: int = 400, scale: float = 1.0, align: Any = 0) -> None:
        cv2.putText(page, text, (round(x), round(y)), _INK, sans, round(size * scale), weight, align)

    write(_shortened(title, round(1.6 * (width + legend) / size / 1.3)), left, margin + 0.5 * size, 600, 1.3)
    _scale_bar(page, left, top + height + 2 * size, picture.shape[1] * pixel, pixel, size, write)
    note = f"grey was not seen, holes up to {metres(hole)} are interpolated"
    write(note, left, top + height + 4.4 * size, 400, 0.8)
    _legend(page, left + width + 2 * size, top + 4 * size, height - 5 * size, low, high, size, write)
    tip = (left + width + 2 * size + size // 2, top)
    cv2.arrowedLine(page, (tip[0], tip[1] + 2 * size), tip, _INK, max(2, size // 8), cv2.LINE_AA, 0, 0.35)
    write(north, tip[0] + size, tip[1] + 1.4 * size, 600, 0.9)
    return page


def _scale_bar(page: NDArray, left: int, y: int, extent: float, pixel: float, size: int, write: Any) -> None:
    """A bar of a round length, about a quarter of the map."""
    import cv2

    length = round_step(extent / 4)
    end = left + round(length / pixel)
    cv2.rectangle(page, (left, y), (end, y + size // 3), _INK, 1, cv2.LINE_AA)
    cv2.rectangle(page, (left, y), ((left + end) // 2, y + size // 3), _INK, -1, cv2.LINE_AA)
    write(metres(length), end + 0.6 * size, y + 0.6 * size)


def _legend(page: NDArray, x: int, y: int, height: int, low: float, high: float, size: int, write: Any) -> None:
    """The ramp with round depths beside it, shallow on top."""
    import cv2

    write("depth -z, m", x, y - 0.6 * size, 600, 0.9)
    ramp = depth_colours(np.linspace(high, low, height), low, high)[..., ::-1]
    page[y : y + height, x : x + size] = ramp[:, None]
    cv2.rectangle(page, (x, y), (x + size, y + height), _INK, 1)
    step = round_step((high - low) / 4)
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step:
        at = y + round(height * (high - value) / (high - low))
        cv2.line(page, (x + size, at), (x + size + size // 3, at), _INK, 1, cv2.LINE_AA)
        write(f"{-value + 0.0:.{digits}f}", x + 1.6 * size, at + 0.33 * size, 400, 0.9)


def round_step(length: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is at most `length`."""
    power = 10.0 ** np.floor(np.log10(max(length, 1e-9)))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= length * (1 + 1e-9)) * power)


def metres(length: float) -> str:
    """A length as a surveyor writes it."""
    if length >= 1:
        return f"{length:g} m"
    return f"{100 * length:g} cm" if length >= 0.01 else f"{1000 * length:g} mm"


def _shortened(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"
