"""`garbi calibrate field` as a user runs it, on eight seconds of the sample dive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import Ended
from dive_logs import ENCODER, IMAGE, IMU, SAMPLE, rewrite, swaying_bottom, to_and_fro, without

from garbi_map.calibrate.field import placed
from garbi_map.calibrate.field_check import rig_notes
from garbi_map.calibrate.field_rig import unknowns
from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.navigate import navigate
from garbi_map.pipeline import open_dive, sweeps_of
from garbi_map.progress import Silent
from garbi_map.register import Scanner, register
from garbi_map.rig import Port, Rig, load_rig, parse_rig


def true_rig() -> Rig:
    return parse_rig(open_log([SAMPLE]).rig_text or "", "sample")


def wrong_rig(path: Path, **offsets: float) -> Path:
    changed = {f"laser.{name}": value for name, value in offsets.items()}
    path.write_text(unknowns(true_rig(), motor=True).changed(changed).to_yaml())
    return path


def test_a_right_rig_is_left_alone_and_the_dive_is_told_of(garbi, dive, tmp_path):
    """Every parameter has a line with what the dive knows of it; the file that is written holds the same values."""
    ended = garbi("calibrate", "field", dive, "-o", tmp_path / "rig.yaml")
    assert ended.status == 0, ended.err
    lines = ended.out.splitlines()
    assert lines[0].split() == ["parameter", "given", "found", "1", "sigma", "before", "information", "verdict"]
    assert sum(line.startswith("laser.") for line in lines) == 8
    assert not any(line.endswith("corrected") for line in lines)
    assert any(line.startswith("this dive fixes delta to") for line in lines)
    assert any("metric scale: the baseline of 419.8 mm" in line for line in lines)
    assert load_rig(tmp_path / "rig.yaml") == true_rig()
    known = yaml.safe_load((tmp_path / "rig.yaml").read_text())["laser"]["field_check"]
    assert known["corrected"] == {} and len(known["covariance"]) == len(known["free"]) == 8


def test_a_motor_that_slipped_is_found(garbi, dive, tmp_path):
    """Delta a degree off and gamma half of it: both come back to what the dive can tell, and the covariance is kept."""
    given = wrong_rig(tmp_path / "wrong.yaml", delta=np.deg2rad(1.0), gamma=np.deg2rad(0.5))
    ended = garbi("calibrate", "field", dive, "--rig", given, "-o", tmp_path / "rig.yaml")
    assert ended.status == 0, ended.err
    true, found = true_rig().laser, load_rig(tmp_path / "rig.yaml")
    sigma = yaml.safe_load((tmp_path / "rig.yaml").read_text())["laser"]["calibration"]["sigma"]
    assert abs(found.laser.delta - true.delta) < 4 * sigma["laser.delta"] < np.deg2rad(0.4)
    assert abs(found.laser.gamma - true.gamma) < 4 * sigma["laser.gamma"] < np.deg2rad(0.4)
    assert "corrected" in ended.out and "places held out" in ended.out
    assert not list(tmp_path.glob(".garbi-field-*"))


def apart(topic: str, at: float, message: Any) -> Any:
    """One sweep over one half of the ground, the next over the other."""
    return message if topic != IMAGE or 0.8 <= at < 1.6 or 3.2 <= at < 4.6 else None


@pytest.mark.parametrize(
    ("seconds", "change", "says"),
    [
        pytest.param(1.2, None, "1 sweep", id="one sweep"),
        pytest.param(7.6, without(IMU), "no IMU", id="no IMU"),
        pytest.param(7.6, without(ENCODER), "encoder", id="no encoder"),
        pytest.param(7.6, apart, "they do not overlap", id="no overlap"),
        pytest.param(7.6, to_and_fro(2.76), "the vehicle hardly moves", id="no motion"),
        pytest.param(7.6, swaying_bottom, "the scene moves", id="moving scene"),
    ],
)
def test_a_dive_that_cannot_tell_is_refused(garbi, tmp_path, seconds, change, says):
    """In one line, and nothing is written."""
    log = rewrite(SAMPLE, tmp_path / "dive.mcap", seconds, change or without())
    refused(garbi("calibrate", "field", log, "-o", tmp_path / "rig.yaml"), says, tmp_path)


def refused(ended: Ended, says: str, folder: Path) -> None:
    assert ended.status == 1
    assert len(ended.err.strip().splitlines()) == 1 and says in ended.err
    assert not (folder / "rig.yaml").exists() and not list(folder.glob(".garbi-field-*"))


def test_a_rig_of_another_kind_is_refused(garbi, dive, tmp_path):
    """The laser on the other side of the camera, x for y, another lens: one line, nothing written."""
    true = true_rig()
    laser, camera = true.laser, true.camera
    short = {f"alpha_{axis}": 0.75 * getattr(camera, f"alpha_{axis}") for axis in "uv"}
    others = {
        "the laser is not seen": replace(true, laser=replace(laser, y=-laser.y)),
        "the laser is not seen in": replace(true, laser=replace(laser, x=laser.y, y=laser.x)),
        "the rig is another": replace(true, camera=replace(camera, **short)),
    }
    for says, other in others.items():
        given = tmp_path / "given.yaml"
        given.write_text(other.to_yaml())
        refused(garbi("calibrate", "field", dive, "--rig", given, "-o", tmp_path / "rig.yaml"), says, tmp_path)


def test_what_is_asked_for_must_be_there(garbi, dive, tmp_path):
    """An index that nothing refracts by, and a patch that no sweep sees: one line, nothing written."""
    file = tmp_path / "known.yaml"
    file.write_text("- {from: 50, to: 52, rows: [200, 300]}\n")
    asked = {("--index",): "camera.port", ("--known", file): "known patch 0: begins 50 s after the log's begin"}
    for arguments, says in asked.items():
        refused(garbi("calibrate", "field", dive, "-o", tmp_path / "rig.yaml", *arguments), says, tmp_path)


def test_focal_length_index_and_a_known_height_are_asked_for(garbi, dive, tmp_path):
    """Behind a port that refracts nothing: each has its line, the baseline is held no longer, the true rig stays."""
    true = true_rig()
    given, file = tmp_path / "given.yaml", tmp_path / "known.yaml"
    port = Port((0.0, 0.0, 1.0), 0.03, 0.005, 1.0, 1.0)
    given.write_text(replace(true, camera=replace(true.camera, port=port)).to_yaml())
    # ground that is not flat, and not much is claimed of it
    patch = "- {from: 0.5, to: 2.5, rows: [200, 300], flatness: 0.1}\n"
    file.write_text(patch + "- {from: 3.0, to: 5.0, rows: [200, 300], flatness: 0.1, of: 0, height: 0.001}\n")
    options = ("--rig", given, "--focal", "--index", "--known", file)
    ended = garbi("calibrate", "field", dive, *options, "-o", tmp_path / "rig.yaml")
    assert ended.status == 0, ended.err
    assert "camera.focal [%]" in ended.out and "water.index" in ended.out
    assert "metric scale: the height of a known patch" in ended.out
    assert not any(line.endswith("corrected") for line in ended.out.splitlines())
    assert load_rig(tmp_path / "rig.yaml") == load_rig(given)


@pytest.mark.parametrize("slipped", [0.0, 1.0])
def test_a_map_notices_a_rig_that_is_wrong(dive, tmp_path, slipped):
    """One line that names the parameter where a motor has slipped by a degree; none with the right rig."""
    given = wrong_rig(tmp_path / "rig.yaml", delta=np.deg2rad(slipped))
    opened = open_dive([dive], Config(), given)
    store = sweeps_of(opened, tmp_path / "sweeps", 2, Silent())
    navigated = navigate(opened.navigation, opened.config.navigate, store.stamps())
    scanner = Scanner(opened.rig, opened.angle, opened.navigation.mount("rig"))
    settings = opened.config
    found = register(store, opened.navigation, navigated, settings.registration, settings.navigate, scanner=scanner)
    notes = rig_notes(placed(opened, store, navigated, found))
    assert len(notes) == (slipped > 0)
    assert all("laser.delta by about -" in note and "garbi calibrate field" in note for note in notes)
