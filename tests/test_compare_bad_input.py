"""`garbi compare` on what it cannot use: one line that says why, exit status 1, nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import rasterio

from tests.conftest import Garbi
from tests.test_map_bad_input import largest_file
from tests.two_maps import floor, write_folder


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("maps") / "good", floor, points=20_000)


def copied(good: Path, folder: Path) -> Path:
    folder.mkdir()
    for file in good.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


def refused(garbi: Garbi, good: Path, bad: Path, *said: str) -> None:
    out = bad.parent / "change"
    for order in ((good, bad), (bad, good)):
        ended = garbi("compare", *order, "-o", out)
        assert ended.status == 1
        line = ended.err.strip()
        assert "\n" not in line and str(bad) in line, line
        for words in said:
            assert words in line, line
    assert not (out / "report.json").exists()


def test_what_is_no_folder(garbi: Garbi, good: Path, tmp_path: Path) -> None:
    """Not there."""
    refused(garbi, good, tmp_path / "nowhere", "no such folder")


def test_what_is_no_map(garbi: Garbi, good: Path, tmp_path: Path) -> None:
    """An empty folder, and one that lost a file."""
    (tmp_path / "empty").mkdir()
    refused(garbi, good, tmp_path / "empty", "not a map")
    half = copied(good, tmp_path / "half")
    (half / "report.json").unlink()
    refused(garbi, good, half, "unfinished", "report.json")


def test_a_newer_version(garbi: Garbi, good: Path, tmp_path: Path) -> None:
    """Its files may mean something else."""
    new = copied(good, tmp_path / "new")
    (new / "report.json").write_text(json.dumps({"versions": {"garbi": "99.1"}}))
    refused(garbi, good, new, "99.1", "update garbi")


def test_a_raster_without_its_bands(garbi: Garbi, good: Path, tmp_path: Path) -> None:
    """Elevation alone does not tell how sure it is."""
    bare = copied(good, tmp_path / "bare")
    with rasterio.open(good / "seabed.tif") as file:
        profile = {**file.profile, "count": 1, "driver": "GTiff"}
        elevation = file.read(1)
    with rasterio.open(bare / "seabed.tif", "w", **profile) as file:
        file.write(elevation, 1)
        file.set_band_description(1, "elevation")
    refused(garbi, good, bare, "uncertainty")


@pytest.mark.parametrize("name", ["seabed.tif", "cloud.laz", "report.json"])
def test_damaged_files(garbi: Garbi, good: Path, tmp_path: Path, name: str) -> None:
    """Cut short."""
    cut = copied(good, tmp_path / "cut")
    whole = (cut / name).read_bytes()
    (cut / name).write_bytes(whole[: len(whole) // 2])
    refused(garbi, good, cut, name)


def test_a_folder_that_holds_a_map(garbi: Garbi, good: Path) -> None:
    """A comparison does not overwrite a map."""
    ended = garbi("compare", good, good, "-o", good)
    assert ended.status == 1
    assert "folder of its own" in ended.err


def test_a_full_disk(garbi: Garbi, good: Path, tmp_path: Path) -> None:
    """One line that names the file, and no half of one."""
    out = tmp_path / "change"
    with largest_file(20_000):
        ended = garbi("compare", good, good, "--as-is", "-o", out)
    assert ended.status == 1 and ended.err.count("\n") == 1
    assert str(out) in ended.err and "cannot be written" in ended.err
    assert not (out / "report.json").exists() and all(file.stat().st_size < 20_000 for file in out.iterdir())


def test_usage(garbi: Garbi, good: Path) -> None:
    """One map is not two."""
    assert garbi("compare", good).status == 2
