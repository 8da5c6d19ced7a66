"""The elevation grid as a cloud-optimised GeoTIFF."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import written_aside
from garbi_map.export.georeference import Georeference
from garbi_map.seabed.types import Seabed

BANDS = (
    ("elevation", "m", "height; depth is its negative"),
    ("uncertainty", "m", "1 sigma of the elevation, inside the map"),
    ("density", "points", "accepted points in the cell"),
    ("standard deviation", "m", "spread of the points in the cell about the local slope"),
)
ABSOLUTE = (
    "absolute uncertainty",
    "m",
    "1 sigma of the elevation on Earth: path, calibration and water level included",
)


def write_seabed_tif(path: Path, seabed: Seabed, reference: Georeference | None = None) -> None:
    """Bands elevation, uncertainty, density, standard deviation and, where it is known, absolute uncertainty (float32,
    no-data NaN), north up.

    Raises GarbiError where the file cannot be written.
    """
    own = reference or Georeference()
    bands = list(BANDS)
    layers: list[NDArray] = [
        seabed.elevation.astype(np.float64) + own.shift[2],
        seabed.uncertainty,
        np.where(seabed.known, seabed.density, np.nan),
        seabed.standard_deviation,
    ]
    if seabed.absolute is not None:
        bands.append(ABSOLUTE)
        layers.append(seabed.absolute)
    write_raster(path, bands, layers, (seabed.origin[0], seabed.origin[1]), seabed.cell, own)


def write_raster(
    path: Path,
    bands: Sequence[tuple[str, str, str]],
    layers: Sequence[NDArray],
    origin: tuple[float, float],
    cell: float,
    reference: Georeference,
) -> None:
    """A cloud-optimised GeoTIFF of float32 bands, no-data NaN, north up.

    bands: name, unit and description of each; layers (rows, columns): row 0 in the south; origin (x, y) of the outer corner
    of cell (0, 0), and cell, m in `map`. Raises GarbiError where the file cannot be written.
    """
    import rasterio
    from rasterio.transform import from_origin

    rows, columns = layers[0].shape
    ((west, north, _),) = reference.placed(np.array([[origin[0], origin[1] + rows * cell, 0.0]]))
    with rasterio.MemoryFile() as memory:
        with memory.open(
            driver="COG",
            width=columns,
            height=rows,
            count=len(bands),
            dtype="float32",
            nodata=np.nan,
            crs=rasterio.crs.CRS.from_wkt(reference.wkt),
            transform=from_origin(west, north, cell * reference.scale, cell * reference.scale),
            compress="ZSTD",
            predictor="YES",
            overview_resampling="average",
            bigtiff="IF_SAFER",
            statistics="YES",
            geotiff_version="1.1",  # readers take the vertical part of the system from no older one
        ) as file:
            for number, (layer, (name, unit, what)) in enumerate(zip(layers, bands, strict=True), 1):
                file.write(layer[::-1].astype(np.float32), number)
                file.set_band_description(number, name)
                file.set_band_unit(number, unit)
                file.update_tags(number, description=what)
            file.update_tags(AREA_OR_POINT="Area", software="garbi", from_map=json.dumps(reference.from_map()))
        with written_aside(path) as aside:
            aside.write_bytes(memory.getbuffer())
