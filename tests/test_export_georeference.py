"""Where on Earth a map is: against PROJ's own geodesics, in every file, and back again."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import pyproj
import pytest
import rasterio
import trimesh
from conftest import Garbi
from dive_logs import SAMPLE
from hypothesis import given, settings
from hypothesis import strategies as st
from rasterio.crs import CRS

from garbi_map.config import load_config
from garbi_map.errors import GarbiError
from garbi_map.evaluate import evaluate, read_truth
from garbi_map.export import ExportSettings, Georeference, Located, Origin, locate, read_cloud
from garbi_map.export.origin import check_origin, utm_zone
from garbi_map.log.frames import east_north_up
from garbi_map.log.records import Fixes, Imu, Navigation, Pressure
from garbi_map.navigate.trajectory import Trajectory

PLACES = [(41.9794, 2.8214), (-33.9, 18.42), (60.4, 5.3), (78.2, 15.6), (0.01, 179.99), (-77.0, 166.6)]
GEOD = pyproj.Geod(ellps="WGS84")


def navigation(fixes: Fixes | None = None, north: bool = True, pressure: bool = True) -> Navigation:
    """A log of ten seconds with the sensors that matter here."""
    stamps = np.arange(11) * 1_000_000_000
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (11, 1)) if north else np.full((11, 4), np.nan)
    imu = Imu(stamps, stamps, np.zeros((11, 3)), np.zeros((11, 3)), attitude, np.zeros((11, 3, 3)))
    return Navigation(imu=imu, fixes=fixes, pressure=Pressure(stamps, stamps, np.full(11, 2e5)) if pressure else None)


def path(speed: tuple[float, float] = (0.1, 0.0), start: tuple[float, float] = (0.0, 0.0)) -> Trajectory:
    """Ten seconds along a line."""
    position = np.c_[np.array(start) + np.linspace(0, 10, 11)[:, None] * speed, np.full(11, -3.0)]
    return Trajectory(np.arange(11) * 1_000_000_000, position, np.tile([0, 0, 0, 1.0], (11, 1)), np.zeros((11, 6, 6)))


def horizontal(wkt: str) -> pyproj.CRS:
    """The horizontal part of a compound system."""
    return pyproj.CRS.from_wkt(wkt).sub_crs_list[0]


@pytest.mark.parametrize("projection", ["utm", "local"])
@pytest.mark.parametrize(("latitude", "longitude"), PLACES)
def test_a_point_at_a_bearing_and_distance_is_there(latitude: float, longitude: float, projection: str) -> None:
    """PROJ's geodesics agree to 0.05 mm at 100 m and to 5 mm at 1 km, scale and convergence included."""
    found = locate(navigation(), (path(), path()), Origin(latitude, longitude, 0.0), projection)  # type: ignore[arg-type]
    there = pyproj.Transformer.from_crs(4326, horizontal(found.reference.wkt), always_xy=True)
    azimuth = np.arange(0.0, 360.0, 30.0)
    for distance, bound in ((100.0, 5e-5), (1000.0, 5e-3)):
        ends = GEOD.fwd(np.full(12, longitude), np.full(12, latitude), azimuth, np.full(12, distance))
        true = np.stack(there.transform(*ends[:2]), axis=1)
        # heading 0: the map's x axis points north, its y axis west
        along, left = distance * np.cos(np.radians(azimuth)), -distance * np.sin(np.radians(azimuth))
        points = np.c_[along, left, np.zeros(12)] @ found.transform[:3, :3].T
        assert np.abs(found.reference.placed(points)[:, :2] - true).max() < bound


@pytest.mark.parametrize(("latitude", "longitude"), PLACES)
def test_scale_and_convergence_are_those_of_proj(latitude: float, longitude: float) -> None:
    """As PROJ's analytic factors have them."""
    found = locate(navigation(), (path(), path()), Origin(latitude, longitude))
    factors = pyproj.Proj(horizontal(found.reference.wkt)).get_factors(longitude, latitude)
    assert found.reference.scale == pytest.approx(factors.meridional_scale, abs=1e-8)
    assert np.degrees(found.convergence) == pytest.approx(factors.meridian_convergence, abs=1e-6)


def test_the_local_projection_keeps_metres() -> None:
    """Scale 1 and no convergence at the origin: what is measured in the file is what is on the ground."""
    found = locate(navigation(), (path(), path()), Origin(60.4, 5.3), "local")
    assert found.reference.scale == pytest.approx(1.0, abs=1e-8)
    assert found.convergence == pytest.approx(0.0, abs=1e-9)
    assert CRS.from_wkt(found.reference.wkt).is_projected


def test_systems_are_compound_and_honest_about_heights() -> None:
    """The water level of the day where pressure tells the depth, else the first pose; never a chart datum."""
    deep = pyproj.CRS.from_wkt(locate(navigation(), (path(), path()), Origin(41.9, 2.8)).reference.wkt)
    assert [part.to_epsg() for part in deep.sub_crs_list] == [32631, 5829]
    south = pyproj.CRS.from_wkt(locate(navigation(), (path(), path()), Origin(-33.9, 18.4)).reference.wkt)
    assert south.sub_crs_list[0].to_epsg() == 32734
    dry = locate(navigation(pressure=False), (path(), path()), Origin(41.9, 2.8))
    assert "first pose" in pyproj.CRS.from_wkt(dry.reference.wkt).sub_crs_list[1].name
    assert any("not from a chart datum" in note for note in locate(navigation(), (path(), path()), Origin(1, 2)).notes)


@pytest.mark.parametrize(
    ("latitude", "longitude", "zone"),
    [(60.4, 5.3, 32), (55.9, 5.3, 31), (78.2, 15.6, 33), (78, 8.9, 31), (78, 9.1, 33), (78, 34, 37), (0, -180, 1),
     (0, 179.9, 60)],
)  # fmt: skip
def test_zones_know_their_exceptions(latitude: float, longitude: float, zone: int) -> None:
    """Bergen is in 32, Svalbard in 31, 33, 35 and 37."""
    assert utm_zone(latitude, longitude) == zone


def test_a_heading_turns_the_map() -> None:
    """Heading 90 is x east, as the frame is by itself; 0 is x north."""
    for heading, east in ((90.0, (1.0, 0.0)), (0.0, (0.0, 1.0)), (180.0, (0.0, -1.0)), (270.0, (-1.0, 0.0))):
        found = locate(navigation(), (path(), path()), Origin(0.0, 3.0, heading))
        np.testing.assert_allclose(found.transform[:2, 0], east, atol=1e-9)
    turned = path().moved(locate(navigation(), (path(), path()), Origin(0.0, 3.0, 0.0)).transform)
    np.testing.assert_allclose(turned.position[-1], [0.0, 1.0, -3.0], atol=1e-9)
    np.testing.assert_allclose(turned.rotation[-1].as_rotvec(), [0, 0, np.pi / 2], atol=1e-9)


def fixes(origin: tuple[float, float, float] | None, offset: tuple[float, float], noise: float = 0.0) -> Fixes:
    """Fixes along the path, whose own origin is not the map's; one of them is a kilometre off."""
    position = path().position + [*offset, 3.0] + noise * np.random.default_rng(1).standard_normal((11, 3))
    position[4] += 1000.0
    stamps = np.arange(11) * 1_000_000_000
    return Fixes(stamps, stamps, position, np.tile(4.0 * np.eye(3), (11, 1, 1)), origin)


def test_fixes_in_the_log_place_the_map() -> None:
    """At the latitude and longitude of its own origin, whatever the fixes' origin; an outlier has no say."""
    log = navigation(fixes((41.98, 2.82, 10.0), (120.0, -45.0)))
    found = locate(log, (path(), path()), None)
    assert found.origin is not None
    back = east_north_up(np.array([[found.origin.latitude, found.origin.longitude, 10.0]]), (41.98, 2.82, 10.0))
    np.testing.assert_allclose(back[0, :2], [120.0, -45.0], atol=1e-5)
    assert found.sigma == pytest.approx(2.0)
    given = locate(log, (path(), path()), Origin(10.0, 20.0), sigma=0.3)
    assert given.origin == Origin(10.0, 20.0) and given.sigma == 0.3


def test_a_map_that_nobody_places_is_local() -> None:
    """No fix, fixes of an acoustic frame of its own, fixes without a north: it says so, and is not turned."""
    for log in (
        navigation(),
        navigation(fixes(None, (0.0, 0.0))),
        navigation(fixes((41.98, 2.82, 0.0), (0.0, 0.0)), north=False),
    ):
        found = locate(log, (path(), path()), None)
        assert found.reference.is_local and found.turn == 0.0
        assert found.notes[0].startswith("Local: ")


def test_an_origin_without_a_north_wants_a_heading() -> None:
    """Before any work is done."""
    with pytest.raises(GarbiError, match="give LAT,LON,HEADING"):
        check_origin(navigation(north=False), Origin(41.0, 2.0), "utm")
    check_origin(navigation(north=False), Origin(41.0, 2.0, 15.0), "utm")
    with pytest.raises(GarbiError, match="UTM ends at"):
        check_origin(navigation(), Origin(86.0, 2.0), "utm")
    check_origin(navigation(), Origin(86.0, 2.0), "local")


@given(st.floats(-89.9, 89.9), st.floats(-180, 179.999), st.floats(0, 359.9))
def test_an_origin_reads_what_it_says(latitude: float, longitude: float, heading: float) -> None:
    """Back from its text."""
    found = Origin.parse(f"{latitude!r},{longitude!r},{heading!r}")
    assert found == Origin(latitude, longitude, heading)
    assert Origin.parse(f"1,{longitude + 360 if longitude < 0 else longitude - 360!r}").longitude == pytest.approx(
        longitude
    )


@settings(max_examples=60)
@given(st.text(max_size=30))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    """Never with another error."""
    try:
        Origin.parse(text)
    except ValueError as error:
        assert str(error)


@pytest.mark.parametrize("text", ["41", "a,b", "91,0", "41;2", "41,2,400", "nan,2", "41,2,3,4", ""])
def test_a_bad_origin_is_wrong_usage(garbi: Garbi, tmp_path: Path, text: str) -> None:
    """Exit status 2, the reason on stderr, nothing written."""
    ended = garbi("map", tmp_path / "no.mcap", "-o", tmp_path / "map", "--origin", text)
    assert ended.status == 2 and "--origin" in ended.err and "Traceback" not in ended.err
    assert not (tmp_path / "map").exists()


def test_coordinates_come_back() -> None:
    """Placed and unplaced to a nanometre at 5,000 km."""
    own = Georeference("x", (512_345.25, 4_650_123.5, -2.0), 0.9997)
    points = np.random.default_rng(0).uniform(-100, 100, (100, 3))
    np.testing.assert_allclose(own.unplaced(own.placed(points)), points, atol=2e-9)
    assert Georeference.from_dictionary(own.from_map(), "x") == own


@pytest.fixture(scope="module")
def placed(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of a dive near Bergen, where UTM is scaled up and turned by three degrees."""
    from garbi_map.config import Config
    from garbi_map.pipeline import build_map

    out = tmp_path_factory.mktemp("placed") / "map"
    config = Config()
    build_map([dive], out, config.model_copy(update={"export": ExportSettings(origin="60.4,5.3")}))
    return out


def test_every_file_lies_at_the_same_place(placed: Path) -> None:
    """Cloud, raster and contours in the grid, the mesh in `map`, and the report tells how to come from one to the other."""
    report = json.loads((placed / "report.json").read_text())
    own = Georeference.from_dictionary(report["place"], report["place"]["crs"])
    mesh = trimesh.load(placed / "seabed.ply").vertices
    box = own.placed(np.array([mesh.min(axis=0), mesh.max(axis=0)]))
    cloud = laspy.read(placed / "cloud.laz")
    np.testing.assert_allclose([cloud.header.mins[:2], cloud.header.maxs[:2]], box[:, :2], atol=0.02)
    assert (
        pyproj.CRS.from_wkt(cloud.header.vlrs.get("WktCoordinateSystemVlr")[0].string).sub_crs_list[0].to_epsg()
        == 32632
    )
    back = read_cloud(placed / "cloud.laz")
    np.testing.assert_allclose(own.placed(back), np.asarray(cloud.xyz), atol=1e-9)
    with rasterio.open(placed / "seabed.tif") as raster:
        assert pyproj.CRS.from_wkt(raster.crs.to_wkt()).sub_crs_list[1].to_epsg() == 5829
        assert raster.transform.a == -raster.transform.e == pytest.approx(0.005 * own.scale, rel=1e-12)
        bounds = np.reshape(raster.bounds, (2, 2))
        here = np.array([value[0] for value in raster.sample(np.asarray(cloud.xyz)[:2000, :2])])
        assert np.nanmedian(np.abs(here - np.asarray(cloud.z)[:2000])) < 0.002
    np.testing.assert_allclose(bounds, box[:, :2], atol=0.02)
    west, south, east, north = pyogrio.read_info(placed / "contours.gpkg")["total_bounds"]
    box += [[-0.01], [0.01]]
    assert (box[0, :2] < (west, south)).all() and (box[1, :2] > (east, north)).all()
    there = pyproj.Transformer.from_crs(horizontal(own.wkt), 4326, always_xy=True).transform(*own.shift[:2])
    np.testing.assert_allclose(there, [5.3, 60.4], atol=1e-9)


def test_a_placed_map_is_evaluated_as_ever(placed: Path) -> None:
    """Against the truth of the simulator, which is not on Earth."""
    found = evaluate(placed, read_truth([SAMPLE]))
    assert found.trajectory is not None and found.trajectory.ate_rmse_mm < 5.0


def test_a_map_stays_where_it_was_begun(placed: Path, dive: Path, garbi: Garbi) -> None:
    """Another origin for the same folder is refused in one line, and changes nothing."""
    before = (placed / "report.json").read_bytes()
    ended = garbi("map", dive, "-o", placed, "--origin", "41.9,2.8")
    assert ended.status == 1 and "begun with another origin" in ended.err and ended.err.count("\n") == 1
    assert (placed / "report.json").read_bytes() == before


def test_a_place_survives_the_database() -> None:
    """As JSON and back, given or found."""
    for origin in (Origin(60.4, 5.3, 12.0), None):
        found = locate(navigation(fixes((41.98, 2.82, 10.0), (1.0, 2.0))), (path(), path()), origin)
        assert Located.from_json(found.to_json()) == found
        assert found.is_at(origin) and not found.is_at(Origin(0.0, 0.0))


def test_the_configuration_places_it_again(placed: Path) -> None:
    """config.yaml holds the origin: given back, it makes the same map."""
    assert load_config(placed / "config.yaml").export.place == Origin(60.4, 5.3)
    (placed / "bad.yaml").write_text("export: {origin: somewhere}")
    with pytest.raises(GarbiError, match=r"export\.origin: .*'somewhere' is no place"):
        load_config(placed / "bad.yaml")
