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
from garbi_map.export.georeference import Georeference
from garbi_map.export.raster import write_raster

BANDS = (
    ("distance", "m", "first map to second, along the normal; positive is gained"),
    ("level of detection", "m", "what no change exceeds in 95 % of the cells"),
    ("significant", "", "1 in a patch that changed, 0 where not"),
)
_COLUMNS = (
    "number", "kind", "x_m", "y_m", "area_m2", "gained_m3", "lost_m3", "sigma_m3", "largest_m", "moved_m", "move_x_m",
    "move_y_m",
)  # fmt: skip


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


def write_changes_geojson(path: Path, patches: Sequence[Patch], change: Change, labels: NDArray[np.int32]) -> None:
    """The patches as polygons in the system of the first map's files, which is metres, not degrees; GIS programs open it."""
    from rasterio.features import shapes
    from rasterio.transform import Affine

    ((west, south, _),) = change.reference.placed(np.array([[*change.origin, 0.0]]))
    side = change.cell * change.reference.scale
    to_map = Affine(side, 0.0, west, 0.0, side, south)
    outlines: dict[int, list[object]] = {}
    for shape, value in shapes(labels, mask=labels > 0, transform=to_map, connectivity=8):
        outlines.setdefault(int(value), []).append(shape["coordinates"])
    features = [
        {
            "type": "Feature",
            "properties": dict(zip(_COLUMNS, _row(patch, change.reference), strict=True)),
            "geometry": {
                "type": "MultiPolygon",
                "coordinates": [ring for one in patch.label for ring in outlines.get(one, [])],
            },
        }
        for patch in patches
    ]
    write_text(path, json.dumps({"type": "FeatureCollection", "name": "changes", "features": features}) + "\n")


def _row(patch: Patch, reference: Georeference) -> list[object]:
    """The table's values, to a tenth of a millimetre and a thousandth of a cubic centimetre."""
    ((x, y, _),) = reference.placed(np.array([[*patch.place, 0.0]])).round(4).tolist()
    move: list[object] = [None, None, None]
    if patch.move is not None and patch.moved is not None:
        move = [round(value, 4) for value in (patch.moved, *patch.move)]
    volumes = [round(value, 9) for value in (patch.gained, patch.lost, patch.sigma)]
    return [patch.number, patch.kind, x, y, round(patch.area, 6), *volumes, round(patch.largest, 4), *move]
