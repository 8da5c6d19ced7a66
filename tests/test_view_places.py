"""What a recording shows lies where it must, as seen through Rerun's viewer without a screen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from rigs import make_rig
from typer.testing import CliRunner

from garbi_map.cli.view import view
from garbi_map.log import Image, LogWriter, Mount
from tools.headless import HeadlessViewer, headless

app = typer.Typer()
app.command()(view)

START = 1_790_000_000_000_000_000
WIDTH, HEIGHT = 96, 72  # few, so that half a pixel is seen in the picture
COLUMN = 60.0
SECONDS = 4


def striped() -> bytes:
    """A JPEG with a green stripe whose centre is the centre of the pixels of one column."""
    green = 190.0 * np.exp(-0.5 * ((np.arange(WIDTH) - COLUMN) / 2.0) ** 2)
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels[:, :, 1] = np.round(green).astype(np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 97])[1].tobytes()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a still vehicle whose laser stays where it is but turns a little, as a recording."""
    folder = tmp_path_factory.mktemp("view")
    image = striped()
    rig = make_rig()
    camera = replace(rig.camera, width=WIDTH, height=HEIGHT, alpha_u=101.0, alpha_v=102.0, u0=46.0, v0=36.0)
    rig = replace(rig, camera=camera)
    with LogWriter(folder / "dive.mcap") as log:
        log.attach("rig.yaml", "application/yaml", rig.to_yaml().encode())
        log.write_mounts(START, {"rig": Mount(np.array([0.3, 0.0, -0.2])), "imu_link": Mount(), "dvl_link": Mount()})
        for step in range(SECONDS * 100):
            stamp = START + step * 10_000_000
            log.write_encoder(stamp, 0.35 + 0.001 * step / 100)
            log.write_imu(stamp, [0, 0, 0], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3) * 1e-4)
            if step % 10 == 0:
                log.write_pressure(stamp, 2e5)
                log.write_dvl(stamp, [0.1, 0, 0], np.eye(3) * 1e-5)
                log.write_image(Image(stamp, stamp, "jpeg", image))
    out = folder / "log.rrd"
    done = CliRunner().invoke(app, [str(folder / "dive.mcap"), "--save", str(out)])
    assert done.exit_code == 0, done.output
    return out


@pytest.fixture(scope="module")
def viewer(recording: Path) -> Iterator[HeadlessViewer]:
    """The viewer with that recording open; skipped where the machine cannot draw."""
    with ExitStack() as opened:
        try:
            found = opened.enter_context(headless(recording))
        except Exception as reason:
            pytest.skip(f"the headless viewer does not start: {reason}")
        yield found


def picture(viewer: HeadlessViewer, tab: str, tmp_path: Path) -> np.ndarray:
    """What a view shows in the middle of the log, BGR."""
    begin, end = viewer.span_ns
    viewer.picture(tmp_path / "view.png", (begin + end) // 2, tab, alone=True)
    seen = cv2.imread(str(tmp_path / "view.png"))
    assert seen is not None
    return seen.astype(np.float64)


def test_every_entity_has_a_place_in_the_map(viewer: HeadlessViewer) -> None:
    """From each entity that is drawn a chain of transforms leads to the map's frame."""
    parent = {edge["child"]: edge["parent"] for edge in viewer.client.get_transform_graph()["edges"]}
    drawn = [
        entity.entity_path for entity in viewer.client.get_recording_schema().entities if "/map/" in entity.entity_path
    ]
    assert len(drawn) > 8
    for path in drawn:
        frame = f"tf#{path}"
        while frame in parent and frame != "tf#/map":
            frame = parent[frame]
        assert frame == "tf#/map", path


def test_the_stripe_is_drawn_on_its_pixels(viewer: HeadlessViewer, tmp_path: Path) -> None:
    """What is drawn lies in the middle of the light that it marks, to a fifth of a pixel of the camera."""
    seen = picture(viewer, "Camera, with the stripe as found", tmp_path)
    blue, green, red = np.moveaxis(seen, -1, 0)
    columns = np.arange(seen.shape[1])
    drawn = (red > 120) & (red > green + 30) & (blue < 120)
    lit = (green > 40) & (green > red + 25)  # the light left and right of what is drawn
    assert drawn.any(axis=1).mean() > 0.7
    rows = np.flatnonzero(drawn.any(axis=1) & lit.any(axis=1))
    middle = np.median([columns[drawn[row]].mean() for row in rows])
    first, last = (np.median([pick(columns[lit[row]]) for row in rows]) for pick in (np.min, np.max))
    scale = drawn.any(axis=1).sum() / HEIGHT
    assert scale > 4
    assert abs(middle - (first + last) / 2) < 0.2 * scale


def test_the_vehicle_and_its_profile_are_in_the_picture(viewer: HeadlessViewer, tmp_path: Path) -> None:
    """The yellow hull and the green profile are seen whole: away from the borders of the 3-D view."""
    seen = picture(viewer, "Vehicle", tmp_path)[60:]
    blue, green, red = np.moveaxis(seen, -1, 0)
    for found in ((red > 150) & (green > 110) & (blue < 100), (green > 120) & (red < 110)):
        rows, columns = np.nonzero(found)
        assert len(rows) > 150
        assert columns.min() > 5 and columns.max() < seen.shape[1] - 5
        assert rows.min() > 5 and rows.max() < seen.shape[0] - 5
