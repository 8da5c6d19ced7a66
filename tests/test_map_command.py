"""`garbi map` as a whole: what it leaves behind, that it can be stopped and repeated, and how good the map is."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import Garbi
from dive_logs import TRUTH, rewrite, without

from garbi_map.aside import alone_in
from garbi_map.outputs import OUTPUTS

SAME = ("trajectory.tum", "cloud.laz", "seabed.tif")


@pytest.fixture(scope="module")
def finished(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a map that a process of its own has made, and nothing disturbed."""
    out = tmp_path_factory.mktemp("finished") / "map"
    command = [sys.executable, "-m", "garbi_map", "map", str(dive), "-o", str(out)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    return out


def same_map(one: Path, other: Path) -> bool:
    """The files that carry the result agree to the byte."""
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in SAME)


def test_every_output_is_there_and_nothing_else(finished: Path) -> None:
    """A finished folder holds the files of the design, and no trace of work."""
    assert {path.name for path in finished.iterdir()} == set(OUTPUTS)


def test_trajectory_has_ten_poses_a_second_and_every_profile(finished: Path) -> None:
    """Eight numbers a line, stamps ascending, quaternions of unit length."""
    import numpy as np

    rows = np.loadtxt(finished / "trajectory.tum")
    assert rows.shape[1] == 8
    assert np.diff(rows[:, 0]).min() > 0 and np.diff(rows[:, 0]).max() < 0.1
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1, atol=1e-6)
    report = json.loads((finished / "report.json").read_text())
    assert len(rows) > report["counts"]["profiles"]


def test_cloud_opens_with_sigma_and_time(finished: Path) -> None:
    """laspy reads it; the report counts the same points."""
    import laspy

    cloud = laspy.read(finished / "cloud.laz")
    report = json.loads((finished / "report.json").read_text())
    assert len(cloud.points) == report["counts"]["accepted"] > 50_000
    assert cloud.header.scales.tolist() == [1e-5] * 3
    assert cloud.sigma.min() > 0 and cloud.sigma.max() < 0.05
    assert cloud.gps_time.min() < cloud.gps_time.max()


def test_seabed_is_a_georaster_of_five_bands(finished: Path) -> None:
    """rasterio reads elevation, uncertainty, density, standard deviation, and an absolute uncertainty that is larger."""
    import numpy as np
    import rasterio

    with rasterio.open(finished / "seabed.tif") as raster:
        elevation, uncertainty, density, _, absolute = raster.read(masked=True)
        assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
    known = ~np.ma.getmaskarray(elevation)
    assert known.any() and (uncertainty[known] > 0).all() and (absolute > uncertainty)[known].all()
    assert density[known].sum() > 50_000


def test_mesh_and_pictures_open(finished: Path) -> None:
    """trimesh reads the surface, OpenCV the hillshade, rerun's magic is at the start of the recording."""
    import cv2
    import trimesh

    mesh = trimesh.load(finished / "seabed.glb", force="mesh")
    assert isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) > 1000
    assert cv2.imread(str(finished / "hillshade.png")).shape[2] == 3
    assert (finished / "map.rrd").read_bytes()[:3] == b"RRF"


def test_report_says_what_was_read_and_lost_nothing(finished: Path) -> None:
    """A sound log: nothing left out, every image a profile, the configuration complete, the page knows its folder."""
    from garbi_map.config import Config, load_config

    report = json.loads((finished / "report.json").read_text())
    assert report["left_out"] == []
    assert report["counts"]["images"] == report["counts"]["profiles"] == 152
    assert report["counts"]["sweeps"] == 3
    assert set(report["outputs"]) == set(OUTPUTS)
    assert f"garbi view {finished}</" in (finished / "report.html").read_text()
    assert load_config(finished / "config.yaml") == Config.model_validate(report["configuration"]) == Config()


def test_map_is_true_to_millimetres(finished: Path, dive: Path, garbi: Garbi, tmp_path: Path) -> None:
    """`garbi evaluate` against the true motion that the log carries."""
    ended = garbi("evaluate", finished, "--truth", dive, "--json", tmp_path / "figures.json")
    assert ended.status == 0 and "absolute trajectory error" in ended.out
    path = json.loads((tmp_path / "figures.json").read_text())["trajectory"]
    assert path["ate_rmse_mm"] < 5 and path["ate_attitude_deg"] < 0.3


def test_map_reads_no_truth(dive: Path, finished: Path, garbi: Garbi, tmp_path: Path) -> None:
    """Without the true motion in the log the map is the same to the byte."""
    blind = rewrite(dive, tmp_path / "dive.mcap", change=without(TRUTH))
    assert garbi("map", blind, "-o", tmp_path / "map").status == 0
    assert same_map(tmp_path / "map", finished)


def test_second_run_into_the_same_folder_gives_the_same_map(dive: Path, garbi: Garbi, tmp_path: Path) -> None:
    """Another dive's map is overwritten, and repetition changes no byte."""
    out = tmp_path / "map"
    assert garbi("map", dive, "-o", out, "--to", 5).status == 0
    part = json.loads((out / "report.json").read_text())
    assert part["counts"]["profiles"] == 100
    assert garbi("map", dive, "-o", out, "--from", 1, "--to", 5).status == 0
    again = json.loads((out / "report.json").read_text())
    assert again["counts"]["profiles"] == 80
    first = {name: (out / name).read_bytes() for name in SAME}
    assert garbi("map", dive, "-o", out, "--from", 1, "--to", 5).status == 0
    assert first == {name: (out / name).read_bytes() for name in SAME}
    assert {path.name for path in out.iterdir()} == set(OUTPUTS)


def test_second_run_at_the_same_time_refuses(dive: Path, garbi: Garbi, tmp_path: Path) -> None:
    """While another process holds the folder: one line, nothing written; when that process is killed the folder is free."""
    out = tmp_path / "map"
    out.mkdir()
    holding = "import sys; from pathlib import Path; from garbi_map.aside import alone_in\n"
    holding += f"with alone_in(Path({str(out)!r})): print('held', flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", holding]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        ended = garbi("map", dive, "-o", out)
        assert (ended.status, ended.out) == (1, "")
        assert ended.err.count("\n") == 1 and f"{out}: another garbi is writing there" in ended.err
        assert list(out.iterdir()) == []
        other.kill()
    with alone_in(out):
        assert list(out.iterdir()) == []


def interrupt(number: signal.Signals, after: int) -> Any:
    """A CloudWriter.write during which a signal comes, after so many parts: the middle of writing files."""
    from garbi_map.export import CloudWriter

    write, calls = CloudWriter.write, []
    if number == signal.SIGINT:  # which is ignored in what a shell has put into the background
        signal.signal(number, signal.default_int_handler)

    def interrupted(self: CloudWriter, points: Any) -> None:
        write(self, points)
        calls.append(points)
        if len(calls) == after:
            os.kill(os.getpid(), number)

    return interrupted


def test_interrupted_run_goes_on_and_gives_the_same_map(
    dive: Path, finished: Path, garbi: Garbi, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C in the middle of writing files: one line, no result; the next run takes the stored sweeps."""
    out = tmp_path / "map"
    with monkeypatch.context() as patch:
        patch.setattr("garbi_map.export.CloudWriter.write", interrupt(signal.SIGINT, 2))
        ended = garbi("map", dive, "-o", out)
    assert (ended.status, ended.err) == (130, "garbi: interrupted; run the same command again to go on\n")
    assert {path.name for path in out.iterdir()} == {".work", "db"}
    with monkeypatch.context() as patch:
        patch.setattr("garbi_map.estimate.scan", None)  # the images are not read again for sweeps
        assert garbi("map", dive, "-o", out) == (
            0,
            f"{out}: the map is finished; {out}/report.html says how good it is\n",
            "",
        )
    assert same_map(out, finished)
    assert {path.name for path in out.iterdir()} == set(OUTPUTS)


def test_killed_run_leaves_nothing_that_looks_like_a_result(
    dive: Path, finished: Path, garbi: Garbi, tmp_path: Path
) -> None:
    """kill -9 while the cloud is written: nothing is there to be taken for a map, and the next run goes on."""
    out = tmp_path / "map"
    program = (
        "import signal, garbi_map.export, test_map_command as here;"
        "garbi_map.export.CloudWriter.write = here.interrupt(signal.SIGKILL, 2);"
        "from garbi_map.cli import main; main()"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", program, "map", str(dive), "-o", str(out)]
    assert subprocess.run(command, env=environment, check=False).returncode == -signal.SIGKILL
    left = {path.name for path in out.iterdir()}
    assert left == {".work", "db"}
    assert not list((out / ".work/files").iterdir())
    assert garbi("map", dive, "-o", out).status == 0
    assert {path.name for path in out.iterdir()} == set(OUTPUTS)
    assert same_map(out, finished)


def test_given_rig_wins_over_the_attached_one(dive: Path, garbi: Garbi, tmp_path: Path) -> None:
    """A log without a rig maps with one from the command line, and a nonsense rig is refused though the log's is good."""
    from garbi_map.log import open_log

    rig = tmp_path / "rig.yaml"
    rig.write_text(open_log([dive]).rig_text or "")
    bare = rewrite(dive, tmp_path / "bare.mcap", seconds=4, rig="")
    assert garbi("map", bare, "-o", tmp_path / "map", "--rig", rig).status == 0
    rig.write_text(rig.read_text().replace("image_width: 768", "image_width: 0"))
    ended = garbi("map", dive, "-o", tmp_path / "other", "--rig", rig)
    assert ended.status == 1 and "rig.yaml: camera.image_width" in ended.err
    assert not (tmp_path / "other").exists()
