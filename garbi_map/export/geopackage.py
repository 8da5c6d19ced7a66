"""Lines as a GeoPackage (OGC 12-128r18), an SQLite file that every GIS opens."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import written_aside

_SYSTEM = 100_000
"""Number of our reference system in the file: not one of EPSG's."""
_TABLES = """
PRAGMA application_id = 0x47504B47;
PRAGMA user_version = 10300;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
    description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
    min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name),
    column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
    srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id), z TINYINT NOT NULL, m TINYINT NOT NULL,
    PRIMARY KEY (table_name, column_name));
INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined Cartesian', -1, 'NONE', -1, 'undefined', NULL),
    ('Undefined geographic', 0, 'NONE', 0, 'undefined', NULL),
    ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    || 'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]', NULL);
"""


@dataclass(frozen=True)
class LineString:
    """Vertices (n, 3) m, and its attributes in the order of the layer's."""

    vertices: NDArray[np.float64]
    attributes: tuple[float | int, ...]


def write_lines(
    path: Path, layer: str, description: str, attributes: dict[str, str], lines: Sequence[LineString], wkt: str
) -> None:
    """Write one layer of lines in a reference system; attributes: name -> SQL type.

    Raises GarbiError where the file cannot be written.
    """
    with written_aside(path) as aside:
        try:
            with closing(sqlite3.connect(aside, isolation_level=None)) as file:
                _fill(file, layer, description, attributes, lines, wkt)
        except sqlite3.Error as error:
            raise OSError(None, str(error)) from error


def _fill(
    file: sqlite3.Connection,
    layer: str,
    description: str,
    attributes: dict[str, str],
    lines: Sequence[LineString],
    wkt: str,
) -> None:
    file.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN;" + _TABLES)
    columns = "".join(f", {name} {kind}" for name, kind in attributes.items())
    file.execute(f"CREATE TABLE {layer} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom LINESTRING{columns})")
    system = (wkt.split('"')[1], _SYSTEM, "garbi", _SYSTEM, wkt)
    file.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)", system)
    file.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id)"
        " VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?)",
        (layer, layer, description, *_bounds(lines), _SYSTEM),
    )
    file.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'LINESTRING', ?, 1, 0)", (layer, _SYSTEM))
    rows = ((_geometry(line.vertices), *line.attributes) for line in lines)
    file.executemany(f"INSERT INTO {layer} VALUES (NULL, ?{', ?' * len(attributes)})", rows)
    file.execute("COMMIT")


def _geometry(vertices: NDArray[np.float64]) -> bytes:
    """A GeoPackage geometry: header with the bounds, then WKB of a LineString Z, little endian."""
    (min_x, min_y), (max_x, max_y) = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    head = struct.pack("<2sBBi4d", b"GP", 0, 0b011, _SYSTEM, min_x, max_x, min_y, max_y)
    return head + struct.pack("<BII", 1, 1002, len(vertices)) + vertices.astype("<f8").tobytes()


def _bounds(lines: Sequence[LineString]) -> list[float | None]:
    """Least x and y, greatest x and y."""
    if not lines:
        return [None] * 4
    low, high = (np.array([end(line.vertices[:, :2], axis=0) for line in lines]) for end in (np.min, np.max))
    return [*low.min(axis=0).tolist(), *high.max(axis=0).tolist()]
