"""Depth contours as lines that a GIS opens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.geopackage import Feature, Layer, LineString, write_layer
from garbi_map.export.georeference import Georeference
from garbi_map.export.hillshade import fitted, metres, smoothed
from garbi_map.export.palette import height_range
from garbi_map.export.settings import ExportSettings
from garbi_map.seabed import Seabed, fill_holes

_LINES = 20
"""About so many contours from the deepest to the shallowest."""
_INDEX = 5
"""Every fifth contour is drawn bold."""
_SURE = 4.0
"""Contours are at least so many times a cell's sigma apart: closer ones draw noise."""
_PIXELS = 2000
"""Of the longer side of the raster that is contoured."""
_SHORTEST = 24
"""Pixels of its length below which a contour is a speck."""
_SIMPLE = 0.2
"""Pixels by which a line may leave the contour."""


def write_contours(path: Path, seabed: Seabed, settings: ExportSettings, reference: Georeference | None = None) -> None:
    """Write the contours of the elevation, smoothed over a few cells, as a GeoPackage of 3-D lines.

    Attributes: elevation and depth (m), and whether it is an index contour. Raises GarbiError where the file cannot be
    written.
    """
    own = reference or Georeference()
    interval = settings.contour_interval or contour_interval(seabed)
    lines = [
        Feature(
            LineString(own.placed(line)), (level + own.shift[2], -(level + own.shift[2]), int(number % _INDEX == 0))
        )
        for number, level, line in contours(seabed, interval, settings.widest_hole)
    ]
    attributes = {"elevation": "REAL", "depth": "REAL", "is_index": "BOOLEAN"}
    layer = Layer("contours", f"contours every {metres(interval)}, elevation in m", LineString, attributes)
    write_layer(path, layer, lines, own.wkt)


def contour_interval(seabed: Seabed) -> float:
    """1, 2 or 5 times a power of ten, m: about twenty between deepest and shallowest, and well above the noise."""
    low, high = height_range(seabed.elevation)
    least = max((high - low) / _LINES, _SURE * float(np.median(seabed.uncertainty[seabed.known])))
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least * (1 - 1e-9)) * power)


def contours(seabed: Seabed, interval: float, widest_hole: float) -> list[tuple[int, float, NDArray[np.float64]]]:
    """Number of the level, level (m) and vertices (n, 3) in `map` of each contour line."""
    import contourpy
    import cv2

    elevation, _ = fill_holes(seabed.elevation, round(widest_hole / seabed.cell))
    elevation, pixel = fitted(elevation, seabed.cell, _PIXELS, enlarge=False)
    elevation = smoothed(elevation)
    if min(elevation.shape) < 2 or not np.isfinite(elevation).any():
        return []
    trace: Any = contourpy.contour_generator(z=np.ma.masked_invalid(elevation), line_type=contourpy.LineType.Separate)
    first, last = np.ceil(np.nanmin(elevation) / interval), np.floor(np.nanmax(elevation) / interval)
    found = []
    for number in range(int(first), int(last) + 1):
        for line in trace.lines(number * interval):
            if np.abs(np.diff(line, axis=0)).sum() < _SHORTEST:
                continue
            ring = bool((line[0] == line[-1]).all())
            kept = cv2.approxPolyDP(line[: len(line) - ring].astype(np.float32)[:, None], _SIMPLE, ring)[:, 0]
            kept = np.r_[kept, kept[:1]] if ring else kept
            place = np.asarray(seabed.origin) + (kept.astype(np.float64) + 0.5) * pixel
            found.append((number, number * interval, np.c_[place, np.full(len(place), number * interval)]))
    return found
