"""cloud.laz is a COPC: every point once, an even sample from afar, whatever the memory and the order of arrival."""

from __future__ import annotations

import itertools
import struct
import tracemalloc
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from garbi_map.export import CloudWriter, Georeference, also_copc, copc, octree
from garbi_map.export.octree import SAMPLES, Cube, nodes
from garbi_map.seabed import AcceptedPoints

LOCAL = Georeference()
_COLUMNS = ("stamp_ns", "points", "sigma", "intensity", "verdict")


def floor(count: int, seed: int = 0, size: tuple[float, float] = (4.0, 2.0)) -> AcceptedPoints:
    """Points on a rippled floor, ten metres down, in the order of time, each with a sigma of its own."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, size[0], count), rng.uniform(0, size[1], count)
    points = np.c_[x, y, -10 + 0.05 * np.sin(20 * x)]
    return AcceptedPoints(
        1_790_000_000_000_000_000 + np.arange(count) * 10_000,
        points,
        rng.uniform(1e-4, 1e-2, count).astype(np.float32),
        rng.uniform(0, 255, count).astype(np.float32),
        np.zeros(count, np.uint8),
    )


def written(
    path: Path, points: AcceptedPoints, parts: int = 4, reference: Georeference = LOCAL, at_once: int = 1_000_000
) -> Path:
    """The points in so many sweeps."""
    with CloudWriter(path, reference=reference, at_once=at_once) as writer:
        ends = np.linspace(0, len(points.points), parts + 1).astype(int)
        for begin, end in itertools.pairwise(ends):
            writer.write(AcceptedPoints(*(getattr(points, name)[begin:end] for name in _COLUMNS)))
    return path


def in_time(cloud: laspy.LasData | laspy.ScaleAwarePointRecord) -> NDArray[np.float64]:
    """x, y, z, time and sigma of every point, in the order of time."""
    columns = np.c_[cloud.x, cloud.y, cloud.z, cloud.gps_time, cloud["sigma"]]
    return columns[np.argsort(columns[:, 3], kind="stable")]


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, AcceptedPoints]:
    """A file of 200,000 points, far from its origin."""
    points = floor(200_000)
    reference = Georeference(LOCAL.wkt, (512_345.25, 4_650_123.5, 0.0), 0.9997)
    return written(tmp_path_factory.mktemp("copc") / "cloud.laz", points, reference=reference), points


def test_any_reader_finds_every_point(cloud: tuple[Path, AcceptedPoints]) -> None:
    """As an ordinary LAZ file."""
    path, points = cloud
    read = in_time(laspy.read(path))
    true = points.points * (0.9997, 0.9997, 1.0) + (512_345.25, 4_650_123.5, 0.0)
    np.testing.assert_allclose(read[:, :3], true, atol=5.5e-6)
    np.testing.assert_allclose(read[:, 3], points.stamp_ns * 1e-9, atol=3e-7)
    np.testing.assert_array_equal(read[:, 4].astype(np.float32), points.sigma)


def test_a_copc_reader_finds_every_point(cloud: tuple[Path, AcceptedPoints]) -> None:
    """All levels together are the cloud; each point is in one of them."""
    path, points = cloud
    with laspy.CopcReader.open(path) as reader:
        everything = in_time(reader.query())
        levels = [len(reader.query(level=level)) for level in range(6)]
        info = reader.copc_info
    np.testing.assert_array_equal(everything, in_time(laspy.read(path)))
    assert sum(levels) == len(points.points) and 0 < levels[0] < levels[1]
    np.testing.assert_allclose([info.gps_min, info.gps_max], points.stamp_ns[[0, -1]] * 1e-9, atol=3e-7)


def test_a_window_gives_what_is_in_it(cloud: tuple[Path, AcceptedPoints]) -> None:
    """The hierarchy's cubes hold what they say."""
    path, _ = cloud
    everything = in_time(laspy.read(path))
    low, high = np.array([512_346.0, 4_650_123.9]), np.array([512_347.0, 4_650_124.6])
    with laspy.CopcReader.open(path) as reader:
        found = in_time(reader.query(laspy.copc.Bounds(mins=low, maxs=high)))
    inside = ((everything[:, :2] >= low) & (everything[:, :2] <= high)).all(axis=1)
    np.testing.assert_array_equal(found, everything[inside])


def test_from_afar_the_sample_is_even(cloud: tuple[Path, AcceptedPoints]) -> None:
    """The root holds one point for each of its cells that has any."""
    path, _ = cloud
    with laspy.CopcReader.open(path) as reader:
        root, info = reader.query(level=0), reader.copc_info
        corner = info.center - info.halfsize
    assert info.spacing == pytest.approx(2 * info.halfsize / 2**SAMPLES)

    def cells(points: laspy.LasData | laspy.ScaleAwarePointRecord) -> NDArray[np.int64]:
        return np.floor((np.c_[points.x, points.y, points.z] - corner) / info.spacing + 1e-9).astype(int)

    held, there = cells(root), cells(laspy.read(path))
    assert len(np.unique(held, axis=0)) == len(held) == len(np.unique(there, axis=0))


def test_the_layout_is_that_of_the_specification(cloud: tuple[Path, AcceptedPoints]) -> None:
    """What a reader looks at first, by its offsets: LAS 1.4, `copc` at 377, version 1, format 6, the info's 160 bytes."""
    data = cloud[0].read_bytes()
    assert data[:4] == b"LASF" and (data[24], data[25]) == (1, 4)
    assert data[377:381] == b"copc" and struct.unpack("<HH", data[393:397]) == (1, 160)
    assert data[104] & 0x3F == 6 and struct.unpack("<H", data[105:107]) == (34,)
    assert data[429 + 72 : 429 + 160] == bytes(88)
    offset, size = struct.unpack("<2Q", data[429 + 40 : 429 + 56])
    assert offset + size == len(data) and size % 32 == 0
    entries = [struct.unpack("<iiiiQii", data[at : at + 32]) for at in range(offset, offset + size, 32)]
    assert sum(entry[6] for entry in entries) == 200_000
    assert len({entry[:4] for entry in entries}) == len(entries)
    ends = sorted((entry[4], entry[4] + entry[5]) for entry in entries)
    assert all(one[1] == two[0] for one, two in itertools.pairwise(ends))


def test_memory_changes_nothing_for_a_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cloud that is sorted on disk, part by part, is the cloud that is sorted in memory."""
    points = floor(60_000, size=(40.0, 30.0))
    whole = in_time(laspy.read(written(tmp_path / "a.laz", points)))
    monkeypatch.setattr(copc, "_BLOCK", 7_000)
    path = written(tmp_path / "b.laz", points, at_once=5_000)
    np.testing.assert_array_equal(in_time(laspy.read(path)), whole)
    with laspy.CopcReader.open(path) as reader:
        np.testing.assert_array_equal(in_time(reader.query()), whole)
        assert len(reader.root_page.entries) > 8
    assert {file.name for file in tmp_path.iterdir()} == {"a.laz", "b.laz"}


def test_memory_does_not_grow_with_the_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four times the points, no more memory; and no more than is said of those that are sorted at a time."""
    for module, name, value in ((octree, "SAMPLES", 4), (octree, "_LEAF", 400), (copc, "_BLOCK", 5_000)):
        monkeypatch.setattr(module, name, value)  # nodes are as small beside the whole as those of many millions
    peaks = []
    for number, length in enumerate((30.0, 120.0)):
        points = floor(round(2_500 * length), size=(40.0, length))
        tracemalloc.start()
        written(tmp_path / f"{number}.laz", points, parts=round(length), at_once=30_000)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]
    assert peaks[1] < 30_000 * copc.POINT_BYTES


def test_the_same_points_give_the_same_bytes(tmp_path: Path) -> None:
    """However many sweeps they come in: whoever compares maps compares files."""
    points = floor(30_000)
    one, other = (written(tmp_path / f"{parts}.laz", points, parts) for parts in (1, 7))
    assert one.read_bytes() == other.read_bytes()


def test_the_second_name_is_the_same_file(tmp_path: Path) -> None:
    """No second copy where the file system has links; written anew, both are."""
    path = written(tmp_path / "cloud.laz", floor(500))
    also_copc(path)
    assert (tmp_path / "cloud.copc.laz").samefile(path)
    written(path, floor(700))
    also_copc(path)
    assert laspy.read(tmp_path / "cloud.copc.laz").header.point_count == 700


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 3000), st.integers(0, 2**31 - 2), st.integers(0, 40))
def test_every_point_is_in_one_node_and_inside_it(count: int, spread: int, seed: int) -> None:
    """From points that all coincide to the largest coordinates that there are."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(-(spread // 2), spread // 2 + 1, (count, 3))
    cube = Cube.about(steps.min(axis=0), steps.max(axis=0))
    side = 2.0**cube.bits
    seen = np.zeros(count, int)
    for (level, *place), rows in nodes(cube.codes(steps)):
        seen[rows] += 1
        edge = side / 2**level
        inside = (steps[rows] - cube.corner) / edge - place
        assert len(rows) and (inside >= 0).all() and (inside < 1).all()
    assert (seen == 1).all()
