"""A finished map as it lies on disk, read again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map import __version__
from garbi_map.errors import GarbiError
from garbi_map.export.georeference import LOCAL_WKT, Georeference
from garbi_map.export.raster import BANDS

Floats = NDArray[np.float64]

_FILES = ("seabed.tif", "cloud.laz", "report.json", "config.yaml")
_BANDS = tuple(name for name, _, _ in BANDS)
_AT_ONCE = 1_000_000
"""Points of a cloud that are decoded at once."""


@dataclass(frozen=True)
class MapFolder:
    """What `garbi map` wrote. Rasters (rows, columns): row 0 in the south, column 0 in the west, NaN where not seen.

    origin        (x, y) of the outer corner of cell (0, 0), m, in the map's frame
    elevation     float64, m
    uncertainty   float64, 1 sigma of the elevation, m
    reference     how its files lie in their reference system, which only they are written in
    """

    path: Path
    title: str
    created: str
    origin: tuple[float, float]
    cell: float
    elevation: Floats
    uncertainty: Floats
    reference: Georeference

    @property
    def known(self) -> NDArray[np.bool_]:
        """(rows, columns) cells that hold a measurement."""
        return np.isfinite(self.elevation)

    def cells(self) -> Floats:
        """The known cells as points (k, 3) m, in the order of the raster."""
        row, column = np.nonzero(self.known)
        return np.stack(
            [
                self.origin[0] + (column + 0.5) * self.cell,
                self.origin[1] + (row + 0.5) * self.cell,
                self.elevation[row, column],
            ],
            axis=1,
        )

    def cloud(self, most: int) -> Floats:
        """The points (n, 3) m of cloud.laz, evenly thinned to at most so many. Raises GarbiError."""
        import laspy

        path = self.path / "cloud.laz"
        parts = []
        try:
            with laspy.open(path) as file:
                stride = max(1, -(-file.header.point_count // most))
                first = 0
                for chunk in file.chunk_iterator(_AT_ONCE):
                    chosen = slice(-first % stride, None, stride)
                    parts.append(np.stack([np.asarray(chunk[axis])[chosen] for axis in "xyz"], axis=1))
                    first += len(chunk)
        except Exception as error:  # its decoder has exceptions of its own
            raise GarbiError(f"{path}: cannot be read as LAZ: {' '.join(str(error).split())}") from error
        points = np.concatenate(parts) if parts else np.zeros((0, 3))
        if not len(points):
            raise GarbiError(f"{path}: holds no points; build the map again")
        return self.reference.unplaced(points)


def open_map_folder(path: Path) -> MapFolder:
    """Read a map that is finished and of a version that is known.

    Raises GarbiError for what is no map, half-built or damaged, and for the map of a newer garbi.
    """
    if not path.is_dir():
        raise GarbiError(f"{path}: no such folder; give two folders that garbi map has written")
    missing = [name for name in _FILES if not (path / name).is_file()]
    if missing:
        begun = (path / ".work").exists() or len(missing) < len(_FILES)
        what = "an unfinished map" if begun else "not a map"
        raise GarbiError(f"{path}: {what}: {', '.join(missing)} missing; build it with garbi map LOG -o {path}")
    report = _report(path / "report.json")
    made_by = str(report.get("versions", {}).get("garbi", "0"))
    if _numbers(made_by) > _numbers(__version__):
        raise GarbiError(f"{path}: made by garbi {made_by}, newer than this garbi {__version__}; update garbi")
    origin, cell, bands, reference = _read_raster(path / "seabed.tif")
    elevation, uncertainty = bands
    if not np.isfinite(elevation).any():
        raise GarbiError(f"{path / 'seabed.tif'}: holds no measured cell; build the map again")
    return MapFolder(
        path, str(report.get("title", path.name)), str(report.get("created", "")), origin, cell, elevation,
        uncertainty, reference,
    )  # fmt: skip


def _report(path: Path) -> dict[str, Any]:
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise GarbiError(f"{path}: cannot be read: {' '.join(str(error).split())}") from error
    if not isinstance(report, dict) or not isinstance(report.get("versions", {}), dict):
        raise GarbiError(f"{path}: not the report of a map; build it again with garbi map")
    return report


def _read_raster(path: Path) -> tuple[tuple[float, float], float, tuple[Floats, Floats], Georeference]:
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(path) as file:
            names = [str(name) for name in file.descriptions]
            absent = [name for name in _BANDS if name not in names]
            if absent:
                raise GarbiError(f"{path}: has no band {', '.join(absent)}; build the map again with garbi map")
            cell, west, north = file.transform.a, file.transform.c, file.transform.f
            if not (cell > 0 and np.isclose(file.transform.e, -cell) and file.transform.b == file.transform.d == 0):
                raise GarbiError(f"{path}: its cells are not square and north up; build the map again with garbi map")
            layers = [file.read(names.index(name) + 1, out_dtype="float64")[::-1] for name in _BANDS[:2]]
            south = north - file.height * cell
            told = json.loads(file.tags().get("from_map", '{"shift": [0, 0, 0], "scale": 1}'))
            reference = Georeference.from_dictionary(told, file.crs.to_wkt() if file.crs else LOCAL_WKT)
    except (OSError, RasterioError, ValueError, KeyError, TypeError) as error:
        raise GarbiError(f"{path}: cannot be read as GeoTIFF: {' '.join(str(error).split())}") from error
    ((x, y, _),) = reference.unplaced(np.array([[west, south, 0.0]]))
    return (float(x), float(y)), cell / reference.scale, (layers[0] - reference.shift[2], layers[1]), reference


def _numbers(version: str) -> tuple[int, ...]:
    """The leading numbers of a version, to compare by."""
    numbers = []
    for part in version.split("."):
        if not part.isdecimal():
            break
        numbers.append(int(part))
    return tuple(numbers)
