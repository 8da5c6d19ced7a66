"""`garbi calibrate` from rendered images to a rig file, and what it refuses in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from rigs import FORWARD, make_rig
from typer.testing import CliRunner

from garbi_map.calibrate import run
from garbi_map.calibrate.files import dump, read_camera_info, read_known, write_camera_info
from garbi_map.calibrate.uncertainty import errors_at
from garbi_map.cli import calibrate as _command  # noqa: F401  (registers the command)
from garbi_map.cli.app import app
from garbi_map.errors import GarbiError
from garbi_map.rig import Rig, camera_entries, load_rig
from tools.simulator.calibration_log import write_sweeps
from tools.simulator.target import Booth, Look
from tools.simulator.target_points import poses_before, target_of

BOARD = "kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.07\nborder: 0.04\n"
LATENCY = 0.004


def small_rig() -> Rig:
    """Half the size of the usual one, for speed; the camera is the rig's frame."""
    rig = make_rig()
    camera = rig.camera
    half = {name: getattr(camera, name) / 2 for name in ("alpha_u", "alpha_v", "u0", "v0")}
    pose = {"position": (0.0, 0.0, 0.0), "quaternion": tuple(FORWARD.as_quat().tolist())}
    return Rig(replace(camera, width=384, height=288, **half, **pose), rig.laser)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with target.yaml, images of the target, logs of sweeps over it, and the true camera's rig file."""
    folder = tmp_path_factory.mktemp("calibration")
    rng, rig = np.random.default_rng(3), small_rig()
    (folder / "target.yaml").write_text(BOARD)
    booth = Booth(rig, target_of(BOARD), Look(samples=3, sheet=0.0024))
    poses = poses_before(list(np.linspace(0.8, 1.5, 9)), rng, centre=(0.28, 0.17))
    (folder / "images").mkdir()
    for i in range(9):
        image = booth.image(booth.placed(poses.rotation[i], poses.translation[i]), None, rng)
        cv2.imwrite(str(folder / "images" / f"{i}.png"), image)
    poses = poses_before([0.9, 1.3, 1.7], rng, tilt=0.3, centre=(0.28, 0.17))
    chain = [(poses.rotation[i], poses.translation[i]) for i in range(3)]
    write_sweeps(folder / "sweeps.mcap", booth, chain, (0.05, 0.62), 16, 1, latency=LATENCY)
    write_sweeps(folder / "no_encoder.mcap", booth, chain[:1], (0.05, 0.62), 4, 1, encoder=False)
    (folder / "true_camera.yaml").write_text(dump({"camera": camera_entries(rig.camera)}))
    return folder


def test_from_images_to_a_rig_that_measures(bench: Path):
    """camera and then laser: millimetres at a metre, the latency of the encoder, covariances, reports."""
    runner = CliRunner()
    target = ["--target", str(bench / "target.yaml")]
    camera, rig = bench / "camera.yaml", bench / "rig.yaml"
    info = ["--write-camera-info", str(bench / "info.yaml"), "--report", str(bench / "camera_report")]
    done = runner.invoke(app, ["calibrate", "camera", str(bench / "images"), *target, "-o", str(camera), *info])
    assert done.exit_code in (0, 3), done.output
    assert "solved for: camera.alpha_u" in done.output
    with pytest.raises(GarbiError, match="laser is missing"):
        load_rig(camera)
    report = ["--report", str(bench / "laser_report")]
    sweeps = ["calibrate", "laser", str(bench / "sweeps.mcap"), *target, "--rig", str(camera), "-o", str(rig), *report]
    done = runner.invoke(app, sweeps)
    assert done.exit_code in (0, 3), done.output
    assert "sheet: not tested, 4 poses" in done.output
    assert "held: camera.k3" in done.output
    found, truth = load_rig(rig), small_rig()
    assert np.sqrt(np.nanmean(errors_at(truth, found, 1.2) ** 2)) < 4e-3
    entries = yaml.safe_load(rig.read_text())
    assert entries["laser"]["calibration"]["encoder_latency_s"] == pytest.approx(LATENCY, abs=1e-3)
    assert np.array(entries["laser"]["calibration"]["covariance"]).shape[0] >= 8
    assert entries["camera"]["calibration"]["hold_out_px"] < 0.3
    assert read_camera_info(bench / "info.yaml").alpha_u == pytest.approx(read_known(camera).camera.alpha_u)
    for report in ("camera_report", "laser_report"):
        page = (bench / report / "report.html").read_text()
        assert "<svg" in page
        assert "Advice" in page
        assert "http" not in page.replace("http-equiv", "")


def refused(bench: Path, tmp_path: Path, log: str, board: str = BOARD, match: str = "") -> None:
    """The laser's calibration says so in one line and writes nothing."""
    (tmp_path / "target.yaml").write_text(board)
    output = tmp_path / "rig.yaml"
    with pytest.raises(GarbiError, match=match) as raised:
        run.laser(bench / log, tmp_path / "target.yaml", bench / "true_camera.yaml", output)
    assert "\n" not in str(raised.value)
    assert not output.exists()


def test_a_missing_encoder_is_refused(bench: Path, tmp_path: Path):
    """Without saying that there is no motor."""
    refused(bench, tmp_path, "no_encoder.mcap", match="no encoder")


def test_the_configuration_has_a_section_for_it(bench: Path, tmp_path: Path):
    """A stricter one refuses what the defaults accept, and writes nothing."""
    (tmp_path / "config.yaml").write_text("calibrate: {max_corner_noise: 0.001}")
    output = tmp_path / "rig.yaml"
    with pytest.raises(GarbiError, match="does not explain the corners"):
        run.camera([bench / "images"], bench / "target.yaml", output, config_file=tmp_path / "config.yaml")
    assert not output.exists()


def test_another_target_is_refused(bench: Path, tmp_path: Path):
    """No sweep shows it."""
    refused(bench, tmp_path, "sweeps.mcap", "kind: charuco\nsquares: [10, 7]\nsquare: 0.04\nmarker: 0.03", "not found")


def test_images_without_a_target_are_refused(bench: Path, tmp_path: Path):
    """And blurred ones, and no images at all: one line each, and no file."""
    rng, output = np.random.default_rng(0), tmp_path / "rig.yaml"
    for kind in ("noise", "blurred"):
        (tmp_path / kind).mkdir()
    for i, file in enumerate(sorted((bench / "images").iterdir())[:3]):
        cv2.imwrite(str(tmp_path / "noise" / file.name), rng.integers(0, 255, (288, 384), dtype=np.uint8))
        soft = cv2.GaussianBlur(cv2.imread(str(file)), (0, 0), 5.0)
        cv2.imwrite(str(tmp_path / "blurred" / f"{i}.png"), soft)
    (tmp_path / "text.png").write_text("not an image")
    for source, match in (("noise", "none of 3 images"), ("blurred", "blurred|none of"), ("text.png", "no image")):
        with pytest.raises(GarbiError, match=match):
            run.camera([tmp_path / source], bench / "target.yaml", output)
    assert not output.exists()


def test_one_view_is_refused(bench: Path, tmp_path: Path):
    """A flat target in one image."""
    with pytest.raises(GarbiError, match="1 view of a flat target"):
        run.camera([bench / "images" / "4.png"], bench / "target.yaml", tmp_path / "rig.yaml")


def test_a_camera_info_file_goes_in_and_out(tmp_path: Path):
    """Written as ROS's camera_calibration does, and read again; a fisheye's is refused."""
    camera = small_rig().camera
    write_camera_info(tmp_path / "info.yaml", camera)
    found = read_camera_info(tmp_path / "info.yaml")
    assert (found.alpha_u, found.v0, found.distortion) == (camera.alpha_u, camera.v0, camera.distortion)
    text = (tmp_path / "info.yaml").read_text().replace("plumb_bob", "equidistant")
    (tmp_path / "fisheye.yaml").write_text(text)
    with pytest.raises(GarbiError, match="equidistant"):
        read_camera_info(tmp_path / "fisheye.yaml")
