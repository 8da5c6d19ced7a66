"""The elevation grid as a cloud-optimised GeoTIFF."""

from __future__ import annotations

import json
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


def write_seabed_tif(path: Path, seabed: Seabed, reference: Georeference | None = None) -> None:
    """Bands elevation, uncertainty, density and standard deviation (float32, no-data NaN), north up.

    Raises GarbiError where the file cannot be written.
    """
    import rasterio
    from rasterio.transform import from_origin

    own = reference or Georeference()
    rows, columns = seabed.elevation.shape
    ((west, north, up),) = own.placed(np.array([[seabed.origin[0], seabed.origin[1] + rows * seabed.cell, 0.0]]))
    layers: tuple[NDArray, ...] = (
        seabed.elevation.astype(np.float64) + up,
        seabed.uncertainty,
        np.where(seabed.known, seabed.density, np.nan),
        seabed.standard_deviation,
    )
    with rasterio.MemoryFile() as memory:
        with memory.open(
            driver="COG",
            width=columns,
            height=rows,
            count=len(BANDS),
            dtype="float32",
            nodata=np.nan,
            crs=rasterio.crs.CRS.from_wkt(own.wkt),
            transform=from_origin(west, north, seabed.cell * own.scale, seabed.cell * own.scale),
            compress="ZSTD",
            predictor="YES",
            overview_resampling="average",
            bigtiff="IF_SAFER",
            statistics="YES",
            geotiff_version="1.1",  # readers take the vertical part of the system from no older one
        ) as file:
            for number, (layer, (name, unit, what)) in enumerate(zip(layers, BANDS, strict=True), 1):
                file.write(layer[::-1].astype(np.float32), number)
                file.set_band_description(number, name)
                file.set_band_unit(number, unit)
                file.update_tags(number, description=what)
            file.update_tags(AREA_OR_POINT="Area", software="garbi", from_map=json.dumps(own.from_map()))
        with written_aside(path) as aside:
            aside.write_bytes(memory.getbuffer())
