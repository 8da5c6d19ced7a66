"""Lines and polygons as a GeoPackage (OGC 12-128r18), an SQLite file that every GIS opens."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import written_aside

Floats = NDArray[np.float64]
Value = float | int | str | None

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
    """Vertices (n, 3), m."""

    vertices: Floats
    name: ClassVar[str] = "LINESTRING"
    has_z: ClassVar[bool] = True

    @property
    def corners(self) -> Floats:
        """Every vertex, (n, 2) m."""
        return self.vertices[:, :2]

    def wkb(self) -> bytes:
        """As well-known binary, little endian."""
        return struct.pack("<BII", 1, 1002, len(self.vertices)) + self.vertices.astype("<f8").tobytes()


@dataclass(frozen=True)
class MultiPolygon:
    """Of each polygon its closed rings (n, 2), m: first the outline, anticlockwise, then the holes, clockwise."""

    polygons: list[list[Floats]]
    name: ClassVar[str] = "MULTIPOLYGON"
    has_z: ClassVar[bool] = False

    @property
    def corners(self) -> Floats:
        """Every vertex, (n, 2) m."""
        return np.concatenate(list(chain(*self.polygons)))

    def wkb(self) -> bytes:
        """As well-known binary, little endian."""
        text = struct.pack("<BII", 1, 6, len(self.polygons))
        for rings in self.polygons:
            text += struct.pack("<BII", 1, 3, len(rings))
            text += b"".join(struct.pack("<I", len(ring)) + ring.astype("<f8").tobytes() for ring in rings)
        return text


Geometry = LineString | MultiPolygon


@dataclass(frozen=True)
class Layer:
    """What a file holds: features of one kind, with attributes: name -> SQL type."""

    name: str
    description: str
    kind: type[LineString] | type[MultiPolygon]
    attributes: dict[str, str]


@dataclass(frozen=True)
class Feature:
    """A geometry, and its attributes in the order of the layer's."""

    geometry: Geometry
    attributes: Sequence[Value]


def write_layer(path: Path, layer: Layer, features: Sequence[Feature], wkt: str) -> None:
    """Write one layer in a reference system.

    Raises GarbiError where the file cannot be written.
    """
    with written_aside(path) as aside:
        try:
            with closing(sqlite3.connect(aside, isolation_level=None)) as file:
                _fill(file, layer, features, wkt)
        except sqlite3.Error as error:
            raise OSError(None, str(error)) from error


def _fill(file: sqlite3.Connection, layer: Layer, features: Sequence[Feature], wkt: str) -> None:
    file.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN;" + _TABLES)
    name, kind = layer.name, layer.kind
    columns = "".join(f", {attribute} {type_}" for attribute, type_ in layer.attributes.items())
    file.execute(f"CREATE TABLE {name} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {kind.name}{columns})")
    system = (wkt.split('"')[1], _SYSTEM, "garbi", _SYSTEM, wkt)
    file.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)", system)
    bounds = [_bounds(feature.geometry) for feature in features]
    file.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id)"
        " VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?)",
        (name, name, layer.description, *_around(bounds), _SYSTEM),
    )
    file.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)", (name, kind.name, _SYSTEM, int(kind.has_z))
    )
    rows = ((_blob(one.geometry, own), *one.attributes) for one, own in zip(features, bounds, strict=True))
    file.executemany(f"INSERT INTO {name} VALUES (NULL, ?{', ?' * len(layer.attributes)})", rows)
    file.execute("COMMIT")


def _blob(geometry: Geometry, bounds: Floats) -> bytes:
    """A GeoPackage geometry: header with the bounds, then WKB."""
    min_x, min_y, max_x, max_y = bounds
    return struct.pack("<2sBBi4d", b"GP", 0, 0b011, _SYSTEM, min_x, max_x, min_y, max_y) + geometry.wkb()


def _bounds(geometry: Geometry) -> Floats:
    """Least x and y, greatest x and y."""
    corners = geometry.corners
    return np.r_[corners.min(axis=0), corners.max(axis=0)]


def _around(bounds: list[Floats]) -> list[float | None]:
    """The same of all."""
    if not bounds:
        return [None] * 4
    every = np.array(bounds)
    return [*every[:, :2].min(axis=0).tolist(), *every[:, 2:].max(axis=0).tolist()]
