"""Every file says the same when a second library reads it, and is never there by half."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import laspy
import numpy as np
import pytest
import rasterio
import trimesh
from PIL import Image
from seabed_scene import dome, plane, scan

from garbi_map.errors import GarbiError
from garbi_map.export import (
    CloudWriter,
    ExportSettings,
    Georeference,
    read_cloud,
    write_contours,
    write_glb,
    write_hillshade,
    write_ply,
    write_seabed_tif,
    write_text,
    write_trajectory,
    written_aside,
)
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import AcceptedPoints, Seabed, SeabedSettings, build_seabed, triangulate


@pytest.fixture(scope="module")
def seabed() -> Seabed:
    """A dome on a floor, with a strip to the east that was not seen."""
    posed = [scan(dome, k) for k in range(3)] + [scan(dome, 3, begin=0.9, length=0.2, profiles=30)]
    return build_seabed(lambda: posed, SeabedSettings())[0]


def points(count: int = 1000, begin: tuple[float, float, float] = (3.0, -4.0, -21.0)) -> AcceptedPoints:
    """Random points, a nanosecond-exact millisecond apart."""
    rng = np.random.default_rng(count)
    return AcceptedPoints(
        1_790_000_000_123_456_789 + 1_000_000 * np.arange(count),
        rng.normal(begin, 0.5, (count, 3)),
        rng.uniform(1e-4, 1e-2, count).astype(np.float32),
        rng.uniform(0, 255, count).astype(np.float32),
        np.zeros(count, np.uint8),
    )


def nothing_else(folder: Path, *names: str) -> bool:
    """Whether the folder holds exactly these files, hidden ones included."""
    return {path.name for path in folder.iterdir()} == set(names)


def test_stamps_of_the_trajectory_are_exact_to_the_nanosecond(tmp_path: Path) -> None:
    """Beyond what a double holds."""
    stamps = np.array([1_790_000_000_000_000_001, 1_790_000_000_987_654_321, 1_790_000_001_000_000_000])
    quaternion = np.array([[0, 0, 0, 1.0], [0.5, 0.5, 0.5, 0.5], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]])
    position = np.array([[1.0, 2.0, -3.0], [0.1234567, 0, 0], [-100, 50, -20.5]])
    write_trajectory(tmp_path / "t.tum", Trajectory(stamps, position, quaternion, np.zeros((3, 6, 6))))
    lines = (tmp_path / "t.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [
        "1790000000.000000001",
        "1790000000.987654321",
        "1790000001.000000000",
    ]
    read = np.loadtxt(tmp_path / "t.tum")
    np.testing.assert_allclose(read[:, 1:4], position, atol=5.1e-7)
    np.testing.assert_allclose(read[:, 4:], quaternion, atol=5.1e-10)


def test_the_cloud_comes_back_within_its_scale(tmp_path: Path) -> None:
    """Three writes, one file: coordinates to 5 micrometres, time, intensity, sigma."""
    parts = [points(1000), points(10), points(500, (40.0, 30.0, -25.0))]
    with CloudWriter(tmp_path / "cloud.laz") as writer:
        for part in parts:
            writer.write(part)
    assert writer.count == 1510
    cloud = laspy.read(tmp_path / "cloud.laz")
    assert str(cloud.header.version) == "1.4"
    assert cloud.point_format.id == 6
    true = np.concatenate([p.points for p in parts])
    order = np.argsort(cloud["sigma"])  # COPC orders by place
    here = np.argsort(np.concatenate([p.sigma for p in parts]))
    np.testing.assert_allclose(np.asarray(cloud.xyz)[order], true[here], atol=5.1e-6)
    np.testing.assert_allclose(cloud.header.mins, np.asarray(cloud.xyz).min(0), atol=1e-9)
    stamps, sigma, intensity = (
        np.concatenate([getattr(p, name) for p in parts])[here] for name in ("stamp_ns", "sigma", "intensity")
    )
    np.testing.assert_allclose(cloud.gps_time[order], stamps * 1e-9, atol=3e-7)
    np.testing.assert_array_equal(cloud["sigma"][order], sigma)
    np.testing.assert_allclose(cloud.intensity[order] / 256, intensity, atol=0.01)
    assert "not georeferenced" in cloud.header.vlrs.get("WktCoordinateSystemVlr")[0].string


def test_a_georeferenced_cloud_keeps_its_micrometres(tmp_path: Path) -> None:
    """At a northing of 4,650 km a float32 steps by half a metre; the file does not."""
    own = Georeference(rasterio.crs.CRS.from_epsg(32631).to_wkt(), (512_345.25, 4_650_123.5, 0.0))
    part = points()
    with CloudWriter(tmp_path / "cloud.laz", reference=own) as writer:
        writer.write(part)
    cloud = laspy.read(tmp_path / "cloud.laz")
    read, order, here = np.asarray(cloud.xyz), np.argsort(cloud["sigma"]), np.argsort(part.sigma)
    np.testing.assert_allclose(read[order] - [512_345.25, 4_650_123.5, 0.0], part.points[here], atol=5.5e-6)
    back, true = read_cloud(tmp_path / "cloud.laz"), part.points[here]
    np.testing.assert_allclose(back[order], true, atol=5.5e-6)


def test_a_cloud_without_points_is_a_cloud(tmp_path: Path) -> None:
    """An empty file that opens."""
    with CloudWriter(tmp_path / "cloud.laz"):
        pass
    assert len(laspy.read(tmp_path / "cloud.laz").points) == 0


def test_the_raster_is_the_grid_north_up(tmp_path: Path, seabed: Seabed) -> None:
    """Bands, no-data, places, a local CRS that says so, cloud-optimised."""
    write_seabed_tif(tmp_path / "seabed.tif", seabed)
    with rasterio.open(tmp_path / "seabed.tif") as file:
        assert file.descriptions == ("elevation", "uncertainty", "density", "standard deviation")
        assert file.units == ("m", "m", "points", "m")
        assert np.isnan(file.nodata)
        assert "not georeferenced" in file.crs.to_wkt()
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        top, side = dome(np.array(0.3), np.array(0.3)), 0.45
        (at_top, *_), (at_side, *_) = file.sample([(0.3, 0.3), (side, 0.3)])
        assert at_top == pytest.approx(top, abs=0.002)
        assert at_side == pytest.approx(0.0, abs=0.02)
        np.testing.assert_array_equal(file.read(1)[::-1], seabed.elevation)
        np.testing.assert_array_equal(file.read(2)[::-1], seabed.uncertainty)
        np.testing.assert_array_equal(np.nan_to_num(file.read(3)[::-1]), seabed.density)
        assert np.isnan(file.read(3)[::-1][~seabed.known]).all()
        assert file.bounds.left == pytest.approx(seabed.origin[0])
        assert file.bounds.bottom == pytest.approx(seabed.origin[1])


def test_a_georeferenced_raster_is_where_it_should_be(tmp_path: Path, seabed: Seabed) -> None:
    """UTM 31N, and a height datum."""
    own = Georeference(rasterio.crs.CRS.from_epsg(32631).to_wkt(), (512_345.25, 4_650_123.5, -2.0), 0.9996)
    write_seabed_tif(tmp_path / "seabed.tif", seabed, own)
    with rasterio.open(tmp_path / "seabed.tif") as file:
        assert file.crs.to_epsg() == 32631
        (found, *_) = next(file.sample([(512_345.25 + 0.3 * 0.9996, 4_650_123.5 + 0.3 * 0.9996)]))
        assert file.transform.a == pytest.approx(0.005 * 0.9996, rel=1e-12)
        assert found == pytest.approx(0.15 - 2.0, abs=0.002)


def test_the_model_stands_upright_in_gltf(tmp_path: Path, seabed: Seabed) -> None:
    """glTF is y up: up in `map` is y there, north is -z; colours come with it."""
    mesh = triangulate(seabed)
    write_glb(tmp_path / "seabed.glb", mesh)
    scene = trimesh.load(tmp_path / "seabed.glb")
    read = scene.to_geometry()
    assert len(read.faces) == len(mesh.triangles)
    x, y, z = np.asarray(read.vertices).T
    np.testing.assert_allclose(np.sort(x), np.sort(mesh.vertices[:, 0]), atol=1e-6)
    np.testing.assert_allclose(y.max(), mesh.vertices[:, 2].max(), atol=1e-6)
    top = np.argmax(y)
    assert (x[top], -z[top]) == pytest.approx((0.3, 0.3), abs=0.03)
    assert np.mean(read.face_normals[:, 1] > 0) > 0.99
    (own,) = scene.geometry.values()
    height = np.asarray(own.vertices)[:, 1]
    colours = own.visual.vertex_attributes["color"].astype(int)
    assert colours[np.argmax(height), :3].sum() > colours[np.argmin(height), :3].sum() + 100


def test_the_model_obeys_the_container(tmp_path: Path, seabed: Seabed) -> None:
    """Lengths, alignment and bounds as glTF 2.0 asks."""
    write_glb(tmp_path / "seabed.glb", triangulate(seabed))
    data = (tmp_path / "seabed.glb").read_bytes()
    assert data[:4] == b"glTF"
    assert int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    assert length % 4 == 0
    document = json.loads(data[20 : 20 + length])
    assert document["buffers"][0]["byteLength"] == len(data) - 28 - length
    assert all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"])
    position = document["accessors"][0]
    assert all(low < high for low, high in zip(position["min"], position["max"], strict=True))


def test_the_hillshade_is_a_picture_with_the_map_in_it(tmp_path: Path, seabed: Seabed) -> None:
    """The dome is lit from the north-west; what was not seen is pale; a long title does not break it."""
    write_hillshade(tmp_path / "h.png", seabed, ExportSettings(hillshade_pixels=800), "x" * 500)
    with Image.open(tmp_path / "h.png") as picture:
        picture.verify()
    picture = cv2.imread(str(tmp_path / "h.png")).astype(float)
    factor = 800 // max(seabed.elevation.shape)
    size = int(np.clip(factor * max(seabed.elevation.shape) / 55, 16, 40))
    top, left = 4 * size, 2 * size

    def at(x: float, y: float) -> np.ndarray:
        row = top + factor * (seabed.elevation.shape[0] - (y - seabed.origin[1]) / seabed.cell)
        column = left + factor * (x - seabed.origin[0]) / seabed.cell
        return picture[round(row) - 2 : round(row) + 3, round(column) - 2 : round(column) + 3].mean((0, 1))

    assert at(0.24, 0.36).sum() > at(0.36, 0.24).sum() + 100
    np.testing.assert_allclose(at(0.75, 0.3), (238, 240, 242), atol=1)


def test_a_map_of_one_cell_can_be_drawn_and_written(tmp_path: Path) -> None:
    """The smallest map breaks nothing."""
    band = np.array([[-3.0]], np.float32)
    one = Seabed((0.0, 0.0), 0.005, band, -band, np.ones((1, 1), np.int32), 0 * band, band, np.ones((1, 1), np.int32))
    write_hillshade(tmp_path / "h.png", one, ExportSettings())
    write_seabed_tif(tmp_path / "s.tif", one)
    with rasterio.open(tmp_path / "s.tif") as file:
        assert file.read(1) == -3.0


class Stop(Exception):
    """What interrupts a writer."""


def test_an_interrupted_cloud_leaves_nothing_and_the_old_one_alone(tmp_path: Path) -> None:
    """Stopped half-way: the earlier file is still there, whole, and nothing else."""
    with CloudWriter(tmp_path / "cloud.laz") as writer:
        writer.write(points(7))
    with pytest.raises(Stop), CloudWriter(tmp_path / "cloud.laz") as writer:
        writer.write(points(1000))
        raise Stop
    assert len(laspy.read(tmp_path / "cloud.laz").points) == 7
    assert nothing_else(tmp_path, "cloud.laz")


def test_every_writer_that_fails_leaves_nothing(
    tmp_path: Path, seabed: Seabed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk refuses at the last moment."""

    def refuse(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    trajectory = Trajectory(np.array([1]), np.zeros((1, 3)), np.array([[0, 0, 0, 1.0]]), np.zeros((1, 6, 6)))
    for write in (
        lambda: write_trajectory(tmp_path / "t.tum", trajectory),
        lambda: write_seabed_tif(tmp_path / "s.tif", seabed),
        lambda: write_glb(tmp_path / "s.glb", triangulate(seabed)),
        lambda: write_ply(tmp_path / "s.ply", triangulate(seabed)),
        lambda: write_contours(tmp_path / "c.gpkg", seabed, ExportSettings()),
        lambda: write_hillshade(tmp_path / "h.png", seabed, ExportSettings()),
        lambda: write_text(tmp_path / "r.json", "{}"),
    ):
        with pytest.raises(GarbiError, match="cannot be written: No space left"):
            write()
        assert nothing_else(tmp_path)


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path: Path, seabed: Seabed) -> None:
    """No traceback of a library."""
    with pytest.raises(GarbiError, match=r"r\.json: cannot be written: No such file"):
        write_text(tmp_path / "no" / "r.json", "{}")
    with pytest.raises(GarbiError, match=r"s\.tif: cannot be written: No such file"):
        write_seabed_tif(tmp_path / "no" / "s.tif", seabed)
    with (
        pytest.raises(GarbiError, match=r"c\.laz: cannot be written: No such file"),
        CloudWriter(tmp_path / "no" / "c.laz") as writer,
    ):
        writer.write(points(3))


def test_an_exception_inside_removes_what_was_written_aside(tmp_path: Path) -> None:
    """And it is still that exception."""
    with pytest.raises(Stop), written_aside(tmp_path / "x.bin") as aside:
        aside.write_bytes(b"half")
        raise Stop
    assert nothing_else(tmp_path)


def test_sweeps_without_accepted_points_are_skipped(tmp_path: Path) -> None:
    """An empty write between two others."""
    empty = points(5)
    empty = replace(
        empty,
        points=empty.points[:0],
        stamp_ns=empty.stamp_ns[:0],
        sigma=empty.sigma[:0],
        intensity=empty.intensity[:0],
    )
    with CloudWriter(tmp_path / "cloud.laz") as writer:
        for part in (empty, points(4), empty):
            writer.write(part)
    assert len(laspy.read(tmp_path / "cloud.laz").points) == 4


def test_the_whole_chain_puts_a_slope_where_it_is(tmp_path: Path) -> None:
    """Sweeps to LAZ: points lie on the floor within their noise."""
    posed = [scan(plane, k) for k in range(2)]
    with CloudWriter(tmp_path / "cloud.laz") as writer:
        build_seabed(lambda: posed, SeabedSettings(), take=writer.write)
    x, y, z = np.asarray(laspy.read(tmp_path / "cloud.laz").xyz).T
    assert len(x) == 2 * 60 * 300
    assert np.std(z - plane(x, y)) == pytest.approx(0.0005, rel=0.2)


def test_a_smaller_budget_makes_room_for_less() -> None:
    """What the program itself takes is no room."""
    assert 0 < ExportSettings(memory=1.0).room_for(200) < ExportSettings().room_for(200) / 3
    with pytest.raises(ValueError, match="memory"):
        ExportSettings(memory=0.5)
