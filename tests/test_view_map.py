"""map.rrd: what it holds, how large it is, and that it is complete or absent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from garbi_map.config import Config
from garbi_map.seabed import Mesh, Seabed
from garbi_map.view import record_map, style
from garbi_map.view.budget import share_out
from garbi_map.view.cloud import FinishedMap
from garbi_map.view.settings import ViewSettings
from garbi_map.view.surface import vertex_normals
from garbi_map.view.thin import runs, thinned
from tests.view_scene import IMAGES, OFFSET, SEABED_Z, START, Scene, make_scene, recorded


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_scene(tmp_path_factory.mktemp("dive"))


@pytest.fixture(scope="module")
def recording(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.rrd"
    record_map(path, scene.dive, scene.store, scene.built, scene.mesh)
    return path


@pytest.fixture(scope="module")
def content(recording: Path) -> dict[str, dict[str, list]]:
    return recorded(recording)


def rows(content: dict[str, dict[str, list]], path: str, column: str) -> list:
    """The rows of a column that are not empty."""
    return [row for row in content[path][column] if row is not None]


def test_the_points_of_the_map_lie_on_the_seabed(content: dict) -> None:
    """The scene's seabed is the plane z = -11.3 m, and every point is coloured in every way."""
    steps = rows(content, style.POINTS.path, "Points3D:positions")
    points = np.concatenate([np.array(step) for step in steps])
    assert len(points) > 3000
    np.testing.assert_allclose(points[:, 2], SEABED_Z, atol=1e-4)
    for colouring in style.COLOURINGS:
        colours = rows(content, style.POINTS.path, colouring.component)
        assert [len(row) for row in colours] == [len(step) for step in steps]


def test_the_map_grows_with_time(content: dict) -> None:
    """New points come several times in a sweep, not later than a quarter of a second after they were measured."""
    stamps = np.array(rows(content, style.POINTS.path, "stamp"))
    assert len(stamps) >= 10
    assert (np.diff(stamps) > 0).all()
    assert np.diff(stamps).max() <= 300_000_000


def test_images_are_as_they_were_recorded(scene: Scene, content: dict) -> None:
    """The bytes of the log, not decoded and encoded again."""
    blobs = rows(content, style.IMAGE, "EncodedImage:blob")
    images = [bytes(image.data) for image in scene.dive.log.images()]
    assert [bytes(blob[0]) for blob in blobs] == images


def test_the_stripe_is_drawn_where_the_image_shows_it(scene: Scene, content: dict) -> None:
    """Under every drawn pixel of the stripe the image is as green as the line that was painted into it."""
    from garbi_map.stripe.decode import decode

    stripes = rows(content, style.STRIPE.path, "Points2D:positions")
    assert len(stripes) == IMAGES
    for image, stripe in list(zip(scene.dive.log.images(), stripes, strict=True))[::15]:
        pixels = np.round(np.array(stripe)).astype(int)
        pixels = pixels[(pixels[:, 0] > 2) & (pixels[:, 0] < 765)]
        assert len(pixels) > 50
        assert np.median(decode(image)[pixels[:, 1], pixels[:, 0], 1]) > 150


def test_drift_is_this_path_minus_that_of_navigation_alone(content: dict) -> None:
    """The scene's navigation is off by a constant; the curve says by how much, in mm."""
    drift = np.array(rows(content, style.DRIFT_POSITION.path, "Scalars:scalars"))
    np.testing.assert_allclose(drift, np.tile(-1e3 * OFFSET, (IMAGES, 1)), atol=1e-6)


def test_the_residual_tells_this_map_from_navigation_alone(content: dict) -> None:
    """On a flat seabed a height that is wrong by 10 mm is a misfit of 10 mm."""
    misfit = np.array(rows(content, style.MISFIT.path, "Scalars:scalars"))
    np.testing.assert_allclose(misfit, [[0.0, 10.0]] * 2, atol=0.1)


def test_losses_are_named(content: dict) -> None:
    """Each loss is a line of the text log."""
    assert rows(content, style.LOSSES, "TextLog:text") == [["3 images: a damaged JPEG"]]


def test_there_is_one_timeline(content: dict) -> None:
    """Nothing but the stamp: no time of logging, no tick."""
    for columns in content.values():
        assert not {"log_time", "log_tick"} & set(columns)
    first = min(stamp for columns in content.values() for stamp in columns.get("stamp", []) if stamp is not None)
    assert first == START


def test_a_recording_without_images_still_shows_the_map(scene: Scene, tmp_path: Path) -> None:
    """Profiles stay, stripes and images go."""
    view = scene.dive.config.view.model_copy(update={"images": False})
    scene.dive.config = scene.dive.config.model_copy(update={"view": view})
    try:
        record_map(tmp_path / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    finally:
        scene.dive.config = Config()
    found = recorded(tmp_path / "map.rrd")
    assert "EncodedImage:blob" not in found[style.IMAGE]
    assert len(rows(found, style.PROFILE.path, "Points3D:positions")) == IMAGES


def test_every_third_image_brings_its_own_stripe(scene: Scene, tmp_path: Path) -> None:
    """No stripe is drawn on another image than its own."""
    view = scene.dive.config.view.model_copy(update={"every": 3})
    scene.dive.config = scene.dive.config.model_copy(update={"view": view})
    try:
        record_map(tmp_path / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    finally:
        scene.dive.config = Config()
    found = recorded(tmp_path / "map.rrd")
    stamps = [stamp for stamp in found[style.IMAGE]["stamp"] if stamp is not None]
    assert len(stamps) == IMAGES // 3
    assert [stamp for stamp in found[style.STRIPE.path]["stamp"] if stamp is not None] == stamps


def test_a_recording_that_fails_leaves_nothing_behind(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """map.rrd is complete or absent, and so is everything beside it."""
    from garbi_map.view import record

    def broken(*_: object) -> None:
        raise ValueError("in the middle")

    monkeypatch.setattr(record, "send_sweeps", broken)
    with pytest.raises(ValueError, match="in the middle"):
        record_map(tmp_path / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    assert list(tmp_path.iterdir()) == []


@given(
    log=st.integers(5_000_000, 10**11),
    share=st.floats(0.2, 1.0),
    seconds=st.floats(1.0, 1e4),
    sweeps=st.integers(1, 5000),
    profiles=st.integers(1, 10**6),
)
def test_a_recording_fits_its_budget(log: int, share: float, seconds: float, sweeps: int, profiles: int) -> None:
    """Whatever the log: mesh, points, profiles, curves and images together stay within the ratio, or at the least size."""
    budget = share_out(log, int(share * log), seconds, sweeps, profiles, ViewSettings())
    drawn = 24 * budget.triangles + 36 * sweeps * budget.points_per_sweep + 20 * profiles * budget.points_per_profile
    least = 400_000 + 36 * 50 * sweeps + 20 * 8 * profiles + 24_000
    assert drawn <= max(1.5 * log - share * log - 15_000 * seconds, 0.0) + least


@given(count=st.integers(0, 2000), most=st.integers(1, 500))
def test_thinning_keeps_order_and_ends(count: int, most: int) -> None:
    """At most so many, ascending, without repetition, first and last kept."""
    kept = thinned(count, most)
    assert len(kept) == min(count, most)
    assert (np.diff(kept) > 0).all()
    if count and most > 1:
        assert kept[0] == 0
        assert kept[-1] == count - 1


@given(st.lists(st.integers(0, 3), min_size=1, max_size=50))
def test_runs_are_where_values_change(values: list[int]) -> None:
    """Runs put end to end give the array back."""
    array = np.array(values)
    first, lengths = runs(array)
    np.testing.assert_array_equal(np.repeat(array[first], lengths), array)
    assert (np.diff(array[first]) != 0).all()


def test_normals_of_a_tilted_plane_are_the_plane_s() -> None:
    """z = 0.5 x: the normal is (-0.5, 0, 1) / sqrt(1.25) at every vertex."""
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    vertices = np.stack([x.ravel(), y.ravel(), 0.5 * x.ravel()], axis=1)
    squares = [(k, k + 1, k + 4, k + 3) for k in (0, 1, 3, 4)]
    triangles = np.array([t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))], np.int32)
    normals = vertex_normals(Mesh(vertices, triangles, np.zeros(9, bool)))
    np.testing.assert_allclose(normals, np.tile(np.array([-0.5, 0.0, 1.0]) / np.sqrt(1.25), (9, 1)), atol=1e-6)


def test_height_above_a_slope_is_not_that_above_its_cells() -> None:
    """On z = 0.5 x + 0.2 y, cells of 1 cm: points on the plane are on the surface wherever they lie in a cell."""
    x, y = (np.arange(20) + 0.5) * 0.01, (np.arange(10) + 0.5) * 0.01
    ones = np.ones((10, 20), np.float32)
    plane = (0.5 * x[None, :] + 0.2 * y[:, None]).astype(np.float32)
    count = np.ones((10, 20), np.int32)
    seabed = Seabed((0.0, 0.0), 0.01, plane, 0.001 * ones, count, 0.001 * ones, 100 * ones, count)
    points = np.random.default_rng(1).uniform([0, 0, 0], [0.2, 0.1, 0], (500, 3))
    points[:, 2] = 0.5 * points[:, 0] + 0.2 * points[:, 1] + 0.003
    np.testing.assert_allclose(FinishedMap.of(seabed, (0, 1)).beside(points), 0.003, atol=1e-6)
