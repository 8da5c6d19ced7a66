"""What surveyors open: valid for the libraries they use, with system, units and no-data right."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import trimesh
from numpy.typing import NDArray
from seabed_scene import dome, scan

from garbi_map.errors import GarbiError
from garbi_map.export import (
    ExportSettings,
    Georeference,
    bathymetry,
    write_contours,
    write_glb,
    write_ply,
    write_seabed_tif,
)
from garbi_map.export.contours import contour_interval, contours
from garbi_map.export.s44 import ORDERS
from garbi_map.export.survey import place_line, survey_table
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register import Agreement, Registered
from garbi_map.seabed import Seabed, SeabedSettings, build_seabed, triangulate

UTM = Georeference(rasterio.crs.CRS.from_string("EPSG:32631+5829").to_wkt(), (512_345.25, 4_650_123.5, 0.0), 0.9997)


@pytest.fixture(scope="module")
def seabed() -> Seabed:
    """A dome on a floor."""
    return build_seabed(lambda: [scan(dome, k) for k in range(3)], SeabedSettings())[0]


def grid(elevation: NDArray[np.float32], sigma: float = 1e-4, sweeps: int = 2) -> Seabed:
    """A map of cells of 5 mm, NaN where nothing is known."""
    known = np.isfinite(elevation)
    band = np.where(known, np.float32(sigma), np.float32(np.nan))
    count = known.astype(np.int32)
    return Seabed((0.0, 0.0), 0.005, elevation, band, 6 * count, band, band, sweeps * count)


def test_the_raster_is_cloud_optimised(tmp_path: Path) -> None:
    """By the rules of GDAL's own check: tiles, overviews by halves, directories in order, then data, coarsest first."""
    x, y = np.meshgrid(np.arange(1500) * 0.005, np.arange(1200) * 0.005)
    write_seabed_tif(tmp_path / "s.tif", grid((-10 + 0.1 * np.sin(x) * np.cos(y)).astype(np.float32)), UTM)
    with rasterio.open(tmp_path / "s.tif") as file:
        assert file.is_tiled and file.block_shapes[0] == (512, 512)
        overviews = file.overviews(1)
        assert overviews == [2, 4] and all(file.overviews(band) == overviews for band in file.indexes)
        levels = [None, *range(len(overviews))]
        directories = [int(file.get_tag_item("IFD_OFFSET", "TIFF", 1, ovr=level)) for level in levels]
        data = [int(file.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", 1, ovr=level)) for level in levels]
        assert directories == sorted(directories) and directories[0] < 1000
        assert data == sorted(data, reverse=True) and max(directories) < min(data)
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


def test_the_raster_says_what_is_in_it(tmp_path: Path, seabed: Seabed) -> None:
    """Bands, units, no-data, statistics, a compound system, and how to come back to `map`."""
    write_seabed_tif(tmp_path / "s.tif", seabed, UTM)
    with rasterio.open(tmp_path / "s.tif") as file:
        assert file.descriptions == ("elevation", "uncertainty", "density", "standard deviation")
        assert file.units == ("m", "m", "points", "m") and all(np.isnan(value) for value in file.nodatavals)
        assert "5829" in file.crs.to_wkt() and "32631" in file.crs.to_wkt()
        for band, values in enumerate((seabed.elevation, seabed.uncertainty), 1):
            tags = file.tags(band)
            assert float(tags["STATISTICS_MEAN"]) == pytest.approx(np.nanmean(values), rel=1e-4)
            assert float(tags["STATISTICS_VALID_PERCENT"]) == pytest.approx(100 * np.isfinite(values).mean(), abs=0.02)
        assert "0.9997" in file.tags()["from_map"]
        np.testing.assert_array_equal(file.read(1)[::-1], seabed.elevation)


@pytest.mark.parametrize("reference", [UTM, Georeference()])
def test_contours_open_in_gdal(tmp_path: Path, seabed: Seabed, reference: Georeference) -> None:
    """Lines in three dimensions with elevation and depth, in the system of the map, be it local."""
    write_contours(tmp_path / "c.gpkg", seabed, ExportSettings(contour_interval=0.02), reference)
    info = pyogrio.read_info(tmp_path / "c.gpkg")
    _, _, geometry, (elevation, depth, bold) = pyogrio.raw.read(tmp_path / "c.gpkg")
    assert info["geometry_type"] == "LineString Z" and list(info["fields"]) == ["elevation", "depth", "is_index"]
    assert ("not georeferenced" in info["crs"]) == reference.is_local
    for line, level in zip(geometry, elevation, strict=True):
        vertices = np.frombuffer(line[9:]).reshape(-1, 3)  # after byte order, type and count
        assert (vertices[:, 2] == level).all()
        inside = reference.unplaced(vertices)
        # about the centre of the dome the contour of a height is a circle
        radius = np.hypot(inside[:, 0] - 0.3, inside[:, 1] - 0.3)
        if level > 0.02:
            np.testing.assert_array_equal(vertices[0], vertices[-1])
            assert np.abs(radius - np.sqrt(0.15**2 - level**2)).max() < 0.006
    np.testing.assert_array_equal(depth, -elevation)
    np.testing.assert_array_equal(bold, np.isin(np.round(elevation / 0.02), [0, 5]))
    assert {0.02, 0.04, 0.1, 0.14} <= set(np.round(elevation, 6))


def test_contours_are_as_dense_as_the_eye_wants_and_the_noise_allows() -> None:
    """Round intervals, about twenty of them; wider where the map is not that sure."""
    slope = np.tile(np.linspace(-10.0, -9.0, 200, dtype=np.float32), (50, 1))
    assert contour_interval(grid(slope)) == pytest.approx(0.05)
    assert contour_interval(grid(slope, sigma=0.03)) == pytest.approx(0.2)
    levels = sorted({round(level, 9) for _, level, _ in contours(grid(slope), 0.1, 0.0)})
    np.testing.assert_allclose(levels, np.arange(-9.9, -9.05, 0.1), atol=1e-6)


def test_a_map_without_contours_is_an_empty_layer(tmp_path: Path) -> None:
    """One cell, and a plane: a file that opens."""
    for shape in ((1, 1), (30, 30)):
        write_contours(
            tmp_path / "c.gpkg", grid(np.full(shape, -3.03, np.float32)), ExportSettings(contour_interval=1.0)
        )
        assert pyogrio.read_info(tmp_path / "c.gpkg")["features"] == 0


def test_a_full_disk_is_one_clear_line(tmp_path: Path, seabed: Seabed) -> None:
    """SQLite's own errors, too."""
    with pytest.raises(GarbiError, match=r"c\.gpkg: cannot be written"):
        write_contours(tmp_path / "no" / "c.gpkg", seabed, ExportSettings())


def test_the_surface_opens_as_ply(tmp_path: Path, seabed: Seabed) -> None:
    """In `map`, doubles, coloured, with the way to the grid in its comments."""
    mesh = triangulate(seabed)
    write_ply(tmp_path / "s.ply", mesh, UTM)
    read = trimesh.load(tmp_path / "s.ply", process=False)
    np.testing.assert_array_equal(read.vertices, mesh.vertices)
    np.testing.assert_array_equal(read.faces, mesh.triangles)
    colours = read.visual.vertex_colors.astype(int)
    assert colours[np.argmax(mesh.vertices[:, 2]), :3].sum() > colours[np.argmin(mesh.vertices[:, 2]), :3].sum() + 100
    head = (tmp_path / "s.ply").read_bytes().split(b"end_header")[0].decode()
    assert "property double x" in head and "easting = 512345.25 + 0.9997 x" in head and "5829" in head


def test_the_model_tells_how_it_lies_on_earth(tmp_path: Path, seabed: Seabed) -> None:
    """glTF stays in `map`, near zero, where float32 is fine; its extras have system, shift and scale."""
    write_glb(tmp_path / "s.glb", triangulate(seabed), UTM)
    data = (tmp_path / "s.glb").read_bytes()
    extras = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])["asset"]["extras"]
    assert Georeference.from_dictionary(extras, extras["crs"]) == UTM
    assert np.abs(trimesh.load(tmp_path / "s.glb").bounds).max() < 2.0


def registered(sigma: float = 1e-3, absolute: float = 0.02) -> Registered:
    """Poses with these sigmas along every axis, inside the map and against its origin."""
    stamps = np.arange(3)
    paths = [
        Trajectory(stamps, np.zeros((3, 3)), np.tile([0, 0, 0, 1.0], (3, 1)), np.tile(one**2 * np.eye(6), (3, 1, 1)))
        for one in (absolute, sigma)
    ]
    nothing = np.zeros(0, np.float32)
    return Registered(*paths, [], np.zeros(0), 0, Agreement(np.zeros((0, 2), np.float32), nothing, nothing, (0, 0)), {})


def test_what_orders_allow_is_the_standards_formula() -> None:
    """S-44 6.1.0: at 10 m, Special order allows 0.261 m, Exclusive 0.168 m, order 2 1.026 m."""
    allowed = {order.name: float(order.allowed_depth_error(np.array(10.0))) for order in ORDERS}
    assert allowed == pytest.approx(
        {"Order 2": 1.0261, "Order 1b": 0.5166, "Order 1a": 0.5166, "Special": 0.2610, "Exclusive": 0.1677}, abs=5e-5
    )


def test_inside_and_earth_are_told_apart() -> None:
    """Millimetres inside, decimetres below the water level: 1.96 sigma of depth, 2.45 sigma of position."""
    flat = grid(np.full((400, 400), -10.0, np.float32), sigma=2e-3)
    flat = replace(flat, absolute=np.full_like(flat.uncertainty, 0.1))
    found = bathymetry(flat, registered(), 0.02, True, 0.3)
    assert found.tvu_inside_m == pytest.approx(1.96 * 2e-3, rel=1e-5)
    assert found.tvu_earth_m == pytest.approx(1.96 * 0.1, rel=1e-5)
    assert found.thu_inside_m == pytest.approx(2.45 * np.hypot(1e-3, 0.005 / np.sqrt(12)))
    assert found.thu_earth_m == pytest.approx(2.45 * np.sqrt(0.02**2 + 0.005**2 / 12 + 0.3**2))
    by_name = {order.name: order for order in found.orders}
    assert by_name["Exclusive"].inside_share == 1.0 and by_name["Exclusive"].earth_share == 0.0
    assert by_name["Special"].earth_share == 1.0 and by_name["Special"].earth_position
    assert by_name["Exclusive"].covered and by_name["Exclusive"].features


def test_what_nobody_knows_is_not_told() -> None:
    """No pressure, no depth; no sigma of the origin, no position on Earth; the table says so."""
    flat = grid(np.full((50, 50), 0.5, np.float32))
    found = bathymetry(flat, registered(), 0.02, False, None)
    assert found.depth_m is found.tvu_earth_m is found.thu_earth_m is None
    assert all(order.earth_share is order.earth_position is None for order in found.orders)
    assert "not to be told" in survey_table(found) and "not known" in survey_table(found)
    assert survey_table(None) == place_line(None, None) == ""


def test_a_gap_hides_a_cube_and_costs_an_order() -> None:
    """A hole of 0.6 m hides Exclusive order's cube and not Special's; one sweep is no double coverage."""
    elevation = np.full((400, 400), -10.0, np.float32)
    elevation[100:220, 140:260] = np.nan
    found = bathymetry(grid(elevation), registered(), 0.02, True, 0.1)
    by_name = {order.name: order for order in found.orders}
    assert found.widest_gap_m == pytest.approx(0.6, abs=0.011)
    assert by_name["Special"].features and not by_name["Exclusive"].features
    assert found.covered_once == pytest.approx(1 - 120**2 / 400**2, abs=1e-3)
    once = bathymetry(replace(grid(np.full((400, 400), -10.0, np.float32), sweeps=1)), registered(), 0.02, True, 0.1)
    assert once.orders[3].covered and not once.orders[4].covered and once.covered_twice == 0.0
