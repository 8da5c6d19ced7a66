"""What the viewer makes of a recording, without a screen: nothing complains, and what must be seen is there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from behaviours.decisions import DecisionWriter
from garbi_map.view import record_map, style
from garbi_map.view.show import Wishes, save_log
from tests.test_view_decisions import TICKS, decision
from tests.view_scene import IMAGES, PERIOD_NS, START, make_scene
from tools.headless import HeadlessViewer, headless

LATE = START + (IMAGES - 2) * PERIOD_NS


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The recording of a map, and that of its log."""
    folder = tmp_path_factory.mktemp("pictures")
    scene = make_scene(folder)
    record_map(folder / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    assert save_log(scene.log, Wishes(), folder / "log.rrd") == []
    return folder / "map.rrd", folder / "log.rrd"


@pytest.fixture(scope="module")
def of_decisions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[HeadlessViewer]:
    folder = tmp_path_factory.mktemp("decisions")
    with DecisionWriter(folder / "decisions.mcap") as writer:
        for number in range(TICKS):
            writer.write(decision(number))
    assert save_log(folder / "decisions.mcap", Wishes(), folder / "decisions.rrd") == []
    yield from opened(folder / "decisions.rrd")


def opened(recording: Path) -> Iterator[HeadlessViewer]:
    try:
        with headless(recording) as viewer:
            yield viewer
    except (RuntimeError, ConnectionError) as error:
        pytest.skip(f"no headless viewer here: {error}")


@pytest.fixture(scope="module")
def of_map(recordings: tuple[Path, Path]) -> Iterator[HeadlessViewer]:
    yield from opened(recordings[0])


@pytest.fixture(scope="module")
def of_log(recordings: tuple[Path, Path]) -> Iterator[HeadlessViewer]:
    yield from opened(recordings[1])


def seen(viewer: HeadlessViewer, path: Path, stamp_ns: int, tab: str) -> NDArray[np.int64]:
    """A view alone, (h, w, 3) RGB."""
    import cv2

    viewer.picture(path, stamp_ns, tab, alone=True)
    picture = cv2.imread(str(path))
    assert picture is not None
    return picture[:, :, ::-1].astype(np.int64)


def near(picture: NDArray[np.int64], colour: style.Colour, reach: int = 60) -> int:
    """Pixels that are about of a colour."""
    return int((np.abs(picture - np.array(colour)).sum(axis=2) < reach).sum())


def test_no_view_complains(of_map: HeadlessViewer) -> None:
    """Neither of missing transforms nor of anything else."""
    assert of_map.reports() == []


def test_every_entity_has_a_place(of_map: HeadlessViewer) -> None:
    """A path of transforms leads from each entity to the root."""
    frames = of_map.frames()
    assert f"/{style.POINTS.path}" in frames
    assert f"/{style.STRIPE.path}" in frames
    assert [path for path, placed in frames.items() if not placed] == []


def test_the_vehicle_and_the_map_are_in_the_picture(of_map: HeadlessViewer, tmp_path: Path) -> None:
    """The yellow hull stands over the map, which fills more of the picture as time passes."""
    early = seen(of_map, tmp_path / "early.png", START + 3 * PERIOD_NS, "Sweep")
    late = seen(of_map, tmp_path / "late.png", LATE, "Sweep")
    assert near(late, style.HULL) > 1000
    background = np.abs(late - np.array(style.BACKGROUND)).sum(axis=2) < 12
    assert 0.5 < background.mean() < 0.98
    changed = np.abs(late - early).sum(axis=2) > 60
    assert changed.sum() > 5000


def test_the_finished_surface_is_a_closed_picture(of_map: HeadlessViewer, tmp_path: Path) -> None:
    """The flat seabed is one patch: next to nothing of what it encloses is not seabed."""
    from scipy.ndimage import binary_fill_holes

    picture = seen(of_map, tmp_path / "surface.png", LATE, "Surface")
    red, _, blue = np.moveaxis(picture, -1, 0)
    teal = (blue > red + 20) & (picture.sum(axis=2) > 110) & (blue < 160)  # the camera's frame is bluer
    assert teal.sum() > 2000
    assert teal.sum() > 0.97 * binary_fill_holes(teal).sum()


def test_the_drawn_stripe_lies_on_the_stripe_of_the_image(of_map: HeadlessViewer, tmp_path: Path) -> None:
    """Where the picture is orange it is green beside it, and nowhere else."""
    picture = seen(of_map, tmp_path / "camera.png", START + 20 * PERIOD_NS, "Camera, with the stripe as found")
    orange = np.argwhere(np.abs(picture - np.array(style.OURS)).sum(axis=2) < 40)
    green = (picture[:, :, 1] > 120) & (picture[:, :, 0] < 130)
    assert len(orange) > 100
    beside = np.array([green[row, max(column - 8, 0) : column + 9].any() for row, column in orange])
    assert beside.mean() > 0.95


def test_a_log_shows_vehicle_profile_and_stripe(of_log: HeadlessViewer, tmp_path: Path) -> None:
    """A log as it was recorded: nothing complains; hull, profile and stripe are seen."""
    assert of_log.reports() == []
    vehicle = seen(of_log, tmp_path / "vehicle.png", LATE, "Vehicle")
    assert near(vehicle, style.HULL) > 1000
    assert near(vehicle, style.PROFILE.colour, 120) > 200
    camera = seen(of_log, tmp_path / "camera.png", LATE, "Camera, with the stripe as found")
    assert near(camera, style.OURS) > 100


def test_a_decision_shows_who_wants_what(of_decisions: HeadlessViewer, tmp_path: Path) -> None:
    """Before something moves ahead: travel's arrow, the command, the safe set; after: the ball, and avoidance's arrow."""
    assert of_decisions.reports() == []
    assert [path for path, placed in of_decisions.frames().items() if not placed] == []
    begin, end = of_decisions.span_ns
    tab = "Surroundings, the vehicle stands still"
    before = seen(of_decisions, tmp_path / "before.png", begin + (end - begin) // 10, tab)
    after = seen(of_decisions, tmp_path / "after.png", end - (end - begin) // 10, tab)
    for picture in (before, after):
        assert near(picture, style.HULL) > 1000
        assert near(picture, style.SAFE.colour, 90) > 100
        assert near(picture, style.COMMAND.colour, 90) > 50
    alarm = [near(picture, style.MOVING.colour) for picture in (before, after)]
    assert alarm[0] < 30 and alarm[1] > 300
