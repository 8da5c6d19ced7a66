"""What a comparison leaves on disk: a raster and tables that other programs open."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import write_text
from garbi_map.compare.change import Change
from garbi_map.compare.patches import Patch
from garbi_map.export.geopackage import Feature, Layer, MultiPolygon, Value, write_layer
from garbi_map.export.georeference import Georeference
from garbi_map.export.raster import write_raster

BANDS = (
    ("distance", "m", "first map to second, along the normal; positive is gained"),
    ("level of detection", "m", "what no change exceeds in 95 % of the cells"),
    ("significant", "", "1 in a patch that changed, 0 where not"),
)
_COLUMNS = {
    "number": "INTEGER", "kind": "TEXT", "x_m": "REAL", "y_m": "REAL", "area_m2": "REAL", "gained_m3": "REAL",
    "lost_m3": "REAL", "sigma_m3": "REAL", "mean_m": "REAL", "largest_m": "REAL", "detection_m": "REAL", "moved_m": "REAL",
    "move_x_m": "REAL", "move_y_m": "REAL",
}  # fmt: skip
"""Of the table, with the SQL types of their values."""
_DEGREES = 9
"""Decimals of longitude and latitude: a tenth of a millimetre."""

Rings = list[NDArray[np.float64]]


def write_change_tif(path: Path, change: Change, labels: NDArray[np.int32]) -> None:
    """Cloud-optimised GeoTIFF of three float32 bands on the first map's grid, no-data NaN, north up."""
    layers = (change.distance, change.detection, np.where(change.compared, labels > 0, np.nan))
    write_raster(path, BANDS, layers, (change.origin[0], change.origin[1]), change.cell, change.reference)


def write_changes_csv(path: Path, patches: Sequence[Patch], reference: Georeference) -> None:
    """One line for each patch, with a heading that says the units; places as in the first map's files."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    writer.writerows(_row(patch, reference) for patch in patches)
    write_text(path, text.getvalue())


def write_outlines(out: Path, patches: Sequence[Patch], change: Change, labels: NDArray[np.int32]) -> None:
    """The patches as polygons with all that the table says: changes.gpkg in the system of the first map's files and, where
    that is on Earth, changes.geojson (RFC 7946: longitude and latitude)."""
    reference = change.reference
    number = np.zeros(labels.max(initial=0) + 1, np.int32)
    for patch in patches:
        number[list(patch.label)] = patch.number  # what moved is one thing, where it was and where it is
    outlines = _outlines(change, number[labels])
    shapes = [MultiPolygon(outlines[patch.number]) for patch in patches]
    rows = [_row(patch, reference) for patch in patches]
    layer = Layer("changes", "what changed between two maps; m, m² and m³ of the ground", MultiPolygon, _COLUMNS)
    features = [Feature(shape, row) for shape, row in zip(shapes, rows, strict=True)]
    write_layer(out / "changes.gpkg", layer, features, reference.wkt)
    geojson = out / "changes.geojson"
    if reference.is_local:
        geojson.unlink(missing_ok=True)  # of maps that were compared here before
        return
    collection = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": dict(zip(_COLUMNS, row, strict=True)),
                "geometry": {"type": "MultiPolygon", "coordinates": _on_earth(shape, reference.wkt)},
            }
            for shape, row in zip(shapes, rows, strict=True)
        ],
    }
    write_text(geojson, json.dumps(collection) + "\n")


def _outlines(change: Change, patch: NDArray[np.int32]) -> dict[int, list[Rings]]:
    """The polygons of each number in a raster of patches, 0 for none, in the first map's system.

    Parts that touch at a corner only are polygons of their own.
    """
    from rasterio.features import shapes
    from rasterio.transform import Affine

    ((west, south, _),) = change.reference.placed(np.array([[*change.origin, 0.0]]))
    side = change.cell * change.reference.scale
    to_map = Affine(side, 0.0, west, 0.0, side, south)
    found: dict[int, list[Rings]] = {}
    for shape, number in shapes(patch, mask=patch > 0, transform=to_map, connectivity=4):
        rings = [np.array(ring, np.float64) for ring in shape["coordinates"]]
        found.setdefault(int(number), []).append(
            [ring if _is_anticlockwise(ring) == (k == 0) else ring[::-1] for k, ring in enumerate(rings)]
        )
    return found


def _is_anticlockwise(ring: NDArray[np.float64]) -> bool:
    x, y = (ring - ring[0]).T
    return bool((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0)


def _on_earth(shape: MultiPolygon, wkt: str) -> list[list[list[list[float]]]]:
    """Longitude and latitude of a shape's vertices, degrees."""
    from rasterio.warp import transform

    def placed(ring: NDArray[np.float64]) -> list[list[float]]:
        return np.round(np.transpose(transform(wkt, "OGC:CRS84", *ring.T)), _DEGREES).tolist()

    return [[placed(ring) for ring in rings] for rings in shape.polygons]


def _row(patch: Patch, reference: Georeference) -> list[Value]:
    """The table's values; volumes to a thousandth of a cubic centimetre, places to a tenth of a millimetre."""
    ((x, y, _),) = reference.placed(np.array([[*patch.place, 0.0]])).round(4).tolist()
    move: list[Value] = [None, None, None]
    if patch.move is not None and patch.moved is not None:
        move = [round(value, 4) for value in (patch.moved, *patch.move)]
    volumes = [round(value, 9) for value in (patch.gained, patch.lost, patch.sigma)]
    heights = [round(value, 5) for value in (patch.mean, patch.largest, patch.detection)]
    return [patch.number, patch.kind, x, y, round(patch.area, 6), *volumes, *heights, *move]
