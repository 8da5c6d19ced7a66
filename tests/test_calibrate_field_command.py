"""`garbi calibrate field` as a user runs it, on eight seconds of the sample dive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from dive_logs import ENCODER, IMU, SAMPLE, rewrite, without

from garbi_map.calibrate.field import placed
from garbi_map.calibrate.field_check import rig_notes
from garbi_map.calibrate.field_rig import unknowns
from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.navigate import navigate
from garbi_map.pipeline import open_dive, sweeps_of
from garbi_map.progress import Silent
from garbi_map.register import Scanner, register
from garbi_map.rig import Rig, load_rig, parse_rig


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


@pytest.mark.parametrize(
    ("seconds", "change", "says"),
    [
        (1.2, lambda topic, at, message: message, "1 sweep"),
        (7.6, without(IMU), "no IMU"),
        (7.6, without(ENCODER), "encoder"),
    ],
)
def test_a_dive_that_cannot_tell_is_refused(garbi, tmp_path, seconds, change, says):
    """In one line, and nothing is written."""
    log = rewrite(SAMPLE, tmp_path / "dive.mcap", seconds, change)
    ended = garbi("calibrate", "field", log, "-o", tmp_path / "rig.yaml")
    assert ended.status == 1
    assert len(ended.err.strip().splitlines()) == 1 and says in ended.err
    assert not (tmp_path / "rig.yaml").exists()


def test_a_rig_of_another_kind_is_refused(garbi, dive, tmp_path):
    """The laser on the other side of the camera, and an index that nothing refracts by: one line, nothing written."""
    y = -2.0 * true_rig().laser.y
    swapped = wrong_rig(tmp_path / "swapped.yaml", y=y)
    for arguments, says in ((("--rig", swapped), "garbi"), (("--index",), "camera.port")):
        ended = garbi("calibrate", "field", dive, "-o", tmp_path / "rig.yaml", *arguments)
        assert ended.status == 1
        assert len(ended.err.strip().splitlines()) == 1 and says in ended.err
        assert not (tmp_path / "rig.yaml").exists()


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
