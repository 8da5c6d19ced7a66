"""Two maps of one site: laid on each other, and what changed between them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio
from scipy.spatial.transform import Rotation

from garbi_map.compare import CompareSettings, Comparison, align, compare_maps, open_map_folder
from garbi_map.compare.files import write_outlines
from garbi_map.compare.settings import AlignmentSettings
from garbi_map.errors import GarbiError
from garbi_map.export import Georeference
from garbi_map.view.show import recording_of
from tests.two_maps import Height, floor, with_dome, write_folder

WGS84 = pyproj.Geod(ellps="WGS84")
TURN = Rotation.from_euler("ZYX", [2.1, 0.01, -0.006]).as_matrix()
SHIFT = (3.2, -7.1, -11.0)
HEAP = ((0.25, 0.15), 0.06, 0.01)
"""A heap of 1 cm, 6 cm about its middle."""
STONE = 0.04
SETTINGS = CompareSettings(align=AlignmentSettings(yaw_step=4.0))
"""Half as many headings are enough for a metre, and take half as long."""


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("first") / "before", with_dome(floor, (-0.3, -0.2), STONE, 0.035))


@pytest.fixture(scope="module")
def found(before: Path, tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    """Later, from another origin: a stone of 35 mm has moved by 5 cm, and a heap of 1 cm is new."""
    folder = tmp_path_factory.mktemp("second")
    later = with_dome(with_dome(floor, (-0.26, -0.17), STONE, 0.035), *HEAP)
    after = write_folder(folder / "after", later, TURN, SHIFT, seed=1)
    return compare_maps(before, after, folder / "change", SETTINGS)


def heaped(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    zero: Height = lambda x, y: np.zeros_like(x)  # noqa: E731
    return with_dome(zero, *HEAP)(x, y)


def test_the_free_origin_is_found_whatever_the_heading(found: Comparison) -> None:
    """Turned by 120 degrees, tilted by half a degree, 14 m away: laid on within a tenth of a millimetre."""
    corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.4, 0.4)])
    back = found.motion.apply(corners @ TURN.T + SHIFT)
    np.testing.assert_allclose(back, corners, atol=1e-4)
    off = np.linalg.norm(back - corners, axis=1).max()
    assert off < 5 * np.sqrt(np.trace(found.motion.covariance[3:, 3:])) + 5e-5


def test_what_changed_is_found_and_nothing_else(found: Comparison) -> None:
    """One thing moved, one appeared."""
    assert sorted(patch.kind for patch in found.patches) == ["appeared", "moved"]


def test_a_moved_thing_is_told_with_its_way(found: Comparison) -> None:
    """By (4, 3) cm, from where it was."""
    moved = next(patch for patch in found.patches if patch.move is not None)
    assert moved.move is not None
    np.testing.assert_allclose(moved.move, (0.04, 0.03), atol=0.003)
    np.testing.assert_allclose(moved.place, (-0.3, -0.2), atol=0.015)


def test_the_volume_of_a_heap_is_right_within_its_uncertainty(found: Comparison) -> None:
    """Of a half ellipsoid: two thirds of base times height."""
    heap = next(patch for patch in found.patches if patch.kind == "appeared")
    true = 2 / 3 * np.pi * 0.06**2 * 0.01
    assert abs(heap.gained - true) < 3 * heap.sigma + 0.03 * true
    assert heap.largest == pytest.approx(0.01, abs=0.001)


def test_the_level_of_detection_holds_where_nothing_changed(found: Comparison) -> None:
    """At least 95 % of the unchanged cells are below it, and it is far below the centimetre."""
    change = found.change
    rows, columns = change.distance.shape
    x, y = np.meshgrid(
        change.origin[0] + (np.arange(columns) + 0.5) * change.cell,
        change.origin[1] + (np.arange(rows) + 0.5) * change.cell,
    )
    far = (np.hypot(x - 0.25, y - 0.15) > 0.09) & (np.hypot(x + 0.28, y + 0.185) > 0.12) & change.compared
    assert far.sum() > 30_000
    assert (np.abs(change.distance) < change.detection)[far].mean() > 0.95
    assert np.median(change.detection[far]) < 0.001
    assert not (found.labels[far] > 0).any()


def test_files_are_read_by_other_programs(found: Comparison, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The raster by rasterio, tables as text; the recording is what `garbi view` finds in the folder."""
    folder = found.second.path.parent / "change"
    with rasterio.open(folder / "change.tif") as file:
        assert file.descriptions == ("distance", "level of detection", "significant")
        assert file.units[0] == "m"
        significant = file.read(3)
        assert np.nansum(significant) == np.count_nonzero((found.labels > 0) & found.change.compared)
        row, column = file.index(0.25, 0.15)
        assert significant[row, column] == 1
        assert file.read(1)[row, column] == pytest.approx(0.01, abs=0.001)
    with (folder / "changes.csv").open() as table:
        lines = list(csv.DictReader(table))
    assert [line["kind"] for line in lines] == [patch.kind for patch in found.patches]
    assert not (folder / "changes.geojson").exists()  # RFC 7946 knows no local system
    report = json.loads((folder / "report.json").read_text())
    assert len(report["changes"]) == 2
    assert "1 thing moved" in (folder / "report.html").read_text()
    assert recording_of(folder) == folder / "compare.rrd"


def test_outlines_open_in_gdal_with_their_system(found: Comparison) -> None:
    """Valid polygons, as large as the table says, around the cells of the raster; the system says that it is local."""
    folder = found.second.path.parent / "change"
    info = pyogrio.read_info(folder / "changes.gpkg")
    assert info["geometry_type"] == "MultiPolygon" and "not georeferenced" in info["crs"]
    with (folder / "changes.csv").open() as table:
        lines = list(csv.DictReader(table))
    assert list(info["fields"]) == list(lines[0])
    query = "SELECT kind, area_m2, mean_m, largest_m, detection_m, ST_Area(geom), ST_IsValid(geom) FROM changes"
    _, _, _, columns = pyogrio.raw.read(folder / "changes.gpkg", sql=query)
    kind, area, mean, largest, detection, drawn, valid = columns
    assert kind.tolist() == [line["kind"] for line in lines] and valid.all()
    np.testing.assert_allclose(drawn, area, rtol=1e-3)
    assert (detection < mean).all() and (mean <= np.abs(largest)).all() and (detection > 0).all()
    cells = [np.isin(found.labels, patch.label) for patch in found.patches]
    rows, columns_ = np.nonzero(cells[0])
    x, y = (
        found.change.origin[k] + np.array([n.min(), n.max() + 1]) * found.change.cell
        for k, n in ((0, columns_), (1, rows))
    )
    _, bounds = pyogrio.read_bounds(folder / "changes.gpkg")
    np.testing.assert_allclose(bounds[:, 0], [x[0], y[0], x[1], y[1]], atol=1e-9)


def test_parts_that_touch_at_a_corner_and_holes_are_valid_polygons(found: Comparison, tmp_path: Path) -> None:
    """A checkerboard of four cells, and a ring about a hole."""
    labels = np.zeros_like(found.labels)
    labels[20:22, 20:22] = np.eye(2)
    labels[40:43, 40:43] = 2
    labels[41, 41] = 0
    shapes = [replace(found.patches[0], number=number, label=(number,)) for number in (1, 2)]
    write_outlines(tmp_path, shapes, found.change, labels)
    query = "SELECT ST_NumGeometries(geom), ST_Area(geom), ST_IsValid(geom) FROM changes"
    _, _, _, (parts, area, valid) = pyogrio.raw.read(tmp_path / "changes.gpkg", sql=query)
    assert valid.all() and parts.tolist() == [2, 1]
    np.testing.assert_allclose(area, np.array([2, 8]) * found.change.cell**2)


def test_outlines_on_earth_are_geojson_too(found: Comparison, tmp_path: Path) -> None:
    """RFC 7946: longitude and latitude of WGS 84, outlines anticlockwise, no system named; PROJ puts them where the
    GeoPackage has them in the compound system of the map."""
    crs = rasterio.crs.CRS.from_string("EPSG:32631+5829")
    placed = replace(found.change, reference=Georeference(crs.to_wkt(), (512_345.25, 4_650_123.5, 0.0), 0.9996))
    write_outlines(tmp_path, found.patches, placed, found.labels)
    collection = json.loads((tmp_path / "changes.geojson").read_text())
    assert collection.keys() == {"type", "features"}
    system = pyproj.CRS(pyogrio.read_info(tmp_path / "changes.gpkg")["crs"])
    assert system.is_compound and system.sub_crs_list[0].to_epsg() == 32631
    grid = pyproj.Transformer.from_crs("OGC:CRS84", 32631, always_xy=True)
    _, bounds = pyogrio.read_bounds(tmp_path / "changes.gpkg")
    for one, patch, box in zip(collection["features"], found.patches, bounds.T, strict=True):
        assert one["properties"]["kind"] == patch.kind and one["geometry"]["type"] == "MultiPolygon"
        polygons = [[np.array(ring) for ring in rings] for rings in one["geometry"]["coordinates"]]
        areas = [[WGS84.polygon_area_perimeter(*ring.T)[0] for ring in rings] for rings in polygons]
        assert all(outline > 0 and max(holes, default=-1) < 0 for outline, *holes in areas)
        assert sum(sum(own) for own in areas) == pytest.approx(patch.area, rel=1e-3)
        places = np.column_stack(grid.transform(*np.concatenate([rings[0] for rings in polygons]).T))
        np.testing.assert_allclose([*places.min(axis=0), *places.max(axis=0)], box, atol=2e-4)
    assert pyogrio.read_info(tmp_path / "changes.geojson")["crs"] == "EPSG:4326"
    write_outlines(tmp_path, found.patches, found.change, found.labels)
    assert not (tmp_path / "changes.geojson").exists()  # what another comparison left is not this one's


def test_a_map_compared_with_itself_has_not_changed(before: Path, tmp_path: Path) -> None:
    """And its origin stays where it is."""
    same = compare_maps(before, before, tmp_path / "change", SETTINGS)
    assert same.patches == []
    np.testing.assert_allclose(same.motion.shift, 0.0, atol=1e-6)
    assert "Nothing changed" in (tmp_path / "change" / "report.html").read_text()


def test_maps_of_different_sites_are_refused(before: Path, tmp_path: Path) -> None:
    """Ripples alone are not the same site."""

    def elsewhere(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.9 * floor(y + 0.7, 0.3 - x) + 0.012 * np.sin(23 * x - 31 * y)

    other = write_folder(tmp_path / "other", elsewhere, seed=3)
    with pytest.raises(GarbiError, match="cannot be laid on each other"):
        align(open_map_folder(before), open_map_folder(other), SETTINGS.align)


def test_a_flat_site_is_not_aligned_by_its_noise(tmp_path: Path) -> None:
    """Nothing tells where two maps of a bare plane lie."""
    maps = [
        open_map_folder(write_folder(tmp_path / str(seed), lambda x, y: 0.0 * x, seed=seed, points=60_000))
        for seed in (0, 1)
    ]
    with pytest.raises(GarbiError, match="cannot be laid on each other"):
        align(maps[0], maps[1], SETTINGS.align)


def test_a_map_on_earth_is_compared_in_metres_of_the_ground(before: Path, tmp_path: Path) -> None:
    """Read back, it is the local map, whatever the scale and the size of its coordinates; the raster lies on Earth."""
    utm = Georeference(rasterio.crs.CRS.from_epsg(32631).to_wkt(), (512_345.25, 4_650_123.5, 0.0), 0.9996)
    folder = write_folder(tmp_path / "placed", with_dome(floor, (-0.3, -0.2), STONE, 0.035), reference=utm)
    local, placed = open_map_folder(before), open_map_folder(folder)
    assert placed.cell == pytest.approx(local.cell, rel=1e-12) and placed.reference == utm
    np.testing.assert_allclose(placed.origin, local.origin, atol=2e-9)
    np.testing.assert_array_equal(placed.elevation, local.elevation)
    one, other = (np.sort(folder.cloud(10**6), axis=0) for folder in (local, placed))
    np.testing.assert_allclose(one, other, atol=1.1e-5)
    found = compare_maps(folder, before, tmp_path / "change", SETTINGS)
    assert not found.patches
    with rasterio.open(tmp_path / "change" / "change.tif") as change, rasterio.open(folder / "seabed.tif") as seabed:
        assert change.crs == seabed.crs
        np.testing.assert_allclose(change.bounds, seabed.bounds, atol=1e-6)
