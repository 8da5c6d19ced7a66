"""`garbi map` into a folder that holds a map: the dive joins it, whatever happens on the way, and nothing is lost."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import Garbi
from dive_logs import SAMPLE, later_part, rewrite
from test_map_bad_input import largest_file

from garbi_map.config import Config
from garbi_map.evaluate import read_tum
from garbi_map.pipeline import build_map

SAME = ("trajectory.tum", "cloud.laz", "seabed.tif")
LATER = 1_000_000_000_000  # ns between the two dives


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two dives over the same ground: two passes of the sample log, the second as if it was flown a quarter hour later."""
    folder = tmp_path_factory.mktemp("pair")
    first = rewrite(SAMPLE, folder / "first.mcap", seconds=5)
    return first, rewrite(
        SAMPLE,
        folder / "second.mcap",
        seconds=15,
        change=later_part(10),
        restamp=lambda topic, at, stamp: stamp + LATER,
    )


@pytest.fixture(scope="module")
def one(pair: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the first dive."""
    out = tmp_path_factory.mktemp("one") / "map"
    build_map([pair[0]], out, Config())
    return out


@pytest.fixture(scope="module")
def both(pair: tuple[Path, Path], one: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same after the second dive has joined it."""
    out = tmp_path_factory.mktemp("both") / "map"
    shutil.copytree(one, out)
    build_map([pair[1]], out, Config())
    return out


def contents(out: Path) -> dict[str, bytes]:
    """Every file that must be the same however the map was made."""
    return {
        str(file.relative_to(out)): file.read_bytes()
        for file in [*(out / name for name in SAME), *sorted(out.glob("db/*/*.parquet"))]
    }


def stamps_of(out: Path) -> np.ndarray:
    """The stamps of a trajectory."""
    return read_tum(out / "trajectory.tum").stamp_ns


def test_products_cover_both_dives(one: Path, both: Path) -> None:
    """The trajectory in the order of time, the cloud with more points, and the first dive's points where they were."""
    import laspy

    stamps = stamps_of(both)
    assert (np.diff(stamps) > 0).all() and np.ptp(stamps) > LATER
    before, after = laspy.read(one / "cloud.laz"), laspy.read(both / "cloud.laz")
    first = after.xyz[np.asarray(after.gps_time) < stamps[0] * 1e-9 + 100]
    assert len(after.points) > 1.5 * len(first)
    np.testing.assert_array_equal(*(np.unique(np.round(1e5 * points), axis=0) for points in (first, before.xyz)))


def test_second_dive_lies_on_the_first_to_a_millimetre(pair: tuple[Path, Path], both: Path) -> None:
    """Against the true motion that the logs carry: what lays the first on its truth lays the second there, too."""
    from scipy.spatial.transform import Rotation

    from garbi_map.evaluate import read_truth

    path = read_tum(both / "trajectory.tum")
    poses = []
    for log in pair:
        truth = read_truth([log]).trajectory
        assert truth is not None
        inside = (path.stamp_ns >= truth.stamp_ns[0]) & (path.stamp_ns <= truth.stamp_ns[-1])
        stamps = path.stamp_ns[inside]
        made, true = path.at(stamps), truth.at(stamps)
        turn = (made.rotation * true.rotation.inv()).mean()
        poses.append((turn, (made.position - turn.apply(true.position)).mean(axis=0), true.position))
    (turn, shift, where), (other_turn, other_shift, _) = poses
    ground = where - [0.0, 0.0, 1.2]
    apart = np.linalg.norm(turn.apply(ground) + shift - other_turn.apply(ground) - other_shift, axis=1)
    assert np.median(apart) < 3e-3  # the two paths themselves are true to a millimetre or two over seconds
    assert (turn * other_turn.inv()).magnitude() < np.deg2rad(0.3)
    assert isinstance(turn, Rotation)


def test_only_the_new_submaps_are_fused(one: Path, both: Path) -> None:
    """What the first dive's cells remember is the very same file; its submap was not written again."""
    kept = contents(one)
    grown = contents(both)
    assert {name: grown[name] for name in kept if name.startswith("db/")} == {
        name: data for name, data in kept.items() if name.startswith("db/")
    }


def test_dives_together_or_one_after_the_other_give_the_same_map(
    pair: tuple[Path, Path], both: Path, tmp_path: Path
) -> None:
    """Two logs in one command, each estimated by a process of its own: the same bytes."""
    out = tmp_path / "map"
    assert build_map(list(pair), out, Config(), workers=2) == []
    assert contents(out) == contents(both)


def test_same_dive_again_changes_nothing(
    pair: tuple[Path, Path], both: Path, garbi: Garbi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No stage runs, no file is written."""
    monkeypatch.setattr("garbi_map.pipeline.estimate", None)
    before = {path: path.stat().st_mtime_ns for path in both.rglob("*") if path.is_file()}
    assert garbi("map", pair[1], "-o", both).status == 0
    assert garbi("map", *pair, "-o", both).status == 0
    assert before == {path: path.stat().st_mtime_ns for path in both.rglob("*") if path.is_file()}


def test_missing_product_is_made_again_from_the_database(pair: tuple[Path, Path], both: Path, tmp_path: Path) -> None:
    """A file that was deleted comes back as it was, and so does a memory of cells."""
    out = tmp_path / "map"
    shutil.copytree(both, out)
    (out / "cloud.laz").unlink()
    next((out / "db/memories").iterdir()).unlink()
    build_map([pair[1]], out, Config())
    assert contents(out) == contents(both)


MOMENTS = {
    "inside the commit": "from garbi_map.db.catalogue import Catalogue as C; C._remember = die",
    "joined, not fused": "from garbi_map.db.database import Database as C; C.fuse = die",
    "fused, not published": "import garbi_map.pipeline as p; p.write_outputs = die",
    "half of the files moved": "from pathlib import PosixPath as P; r = P.replace; P.replace = lambda s, t: "
    "die() if s.parent.name == 'files' and t.name == 'map.rrd' else r(s, t)",
}

KILLED = f"""
import os
import garbi_map.pipeline
from garbi_map.cli import main

def die(*_, **__):
    os.kill(os.getpid(), 9)

for patch in {list(MOMENTS.values())!r}:  # each in a copy of this process, whose imports are done
    if not (child := os.fork()):
        exec(patch)
        main()
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) * -1, flush=True)
"""


def test_killed_at_the_worst_moments_it_ends_in_the_same_map(
    pair: tuple[Path, Path], one: Path, both: Path, garbi: Garbi, tmp_path: Path
) -> None:
    """kill -9, again and again in the same folder; each time what is there is a whole map, and in the end the same one."""
    out = tmp_path / "map"
    shutil.copytree(one, out)
    program = tmp_path / "program.py"
    program.write_text(KILLED)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, str(program), "map", str(pair[1]), "-o", str(out)]
    ended = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    assert ended.stdout.splitlines() == [str(signal.SIGKILL.value)] * len(MOMENTS)
    assert garbi("map", pair[1], "-o", out).status == 0
    assert contents(out) == contents(both)
    assert not (out / ".work").exists()


def refused(ended: object, *words: str) -> None:
    """One line, exit status 1."""
    status, said, err = ended  # type: ignore[misc]
    assert (status, said) == (1, "") and err.count("\n") == 1, err
    assert "fault of garbi's own" not in err
    assert all(word in err for word in words), err


@pytest.fixture
def copied(one: Path, tmp_path: Path) -> Path:
    """A map of one dive that a test may spoil."""
    return Path(shutil.copytree(one, tmp_path / "map"))


@pytest.mark.parametrize(("version", "said"), [(99, "a newer garbi (format 99"), (1, "an older garbi (format 1,")])
def test_database_of_another_version_is_left_alone(
    version: int, said: str, pair: tuple[Path, Path], copied: Path, garbi: Garbi
) -> None:
    """The line says so; nothing changes."""
    with sqlite3.connect(copied / "db/catalogue.sqlite") as catalogue:
        catalogue.execute(f"pragma user_version = {version}")
    before = contents(copied)
    refused(garbi("map", pair[1], "-o", copied), said, "another folder")
    assert contents(copied) == before


@pytest.mark.parametrize("gone", ["db/catalogue.sqlite", "db/submaps/*.parquet", "db/trajectories/*.parquet"])
def test_half_deleted_database_is_named(gone: str, pair: tuple[Path, Path], copied: Path, garbi: Garbi) -> None:
    """Which file is missing, and that the map can be built anew elsewhere."""
    file = next(copied.glob(gone))
    file.unlink()
    refused(garbi("map", pair[1], "-o", copied), str(file), "missing", "another folder")


def test_map_whose_database_is_gone_is_not_replaced(pair: tuple[Path, Path], copied: Path, garbi: Garbi) -> None:
    """A new map in its place would take its name; its files stay as they are."""
    shutil.rmtree(copied / "db")
    before = contents(copied)
    refused(garbi("map", pair[1], "-o", copied), "cloud.laz", "without its database", "another folder")
    assert contents(copied) == before


@pytest.mark.parametrize("spoilt", ["db/catalogue.sqlite", "db/submaps/*.parquet"])
def test_damaged_database_is_named(spoilt: str, pair: tuple[Path, Path], copied: Path, garbi: Garbi) -> None:
    """Zeros in the middle of a file do not become a map."""
    file = next(copied.glob(spoilt))
    data = bytearray(file.read_bytes())
    data[100 if file.suffix == ".sqlite" else len(data) // 3 : len(data) // 2] = bytes(
        len(data) // 2 - (100 if file.suffix == ".sqlite" else len(data) // 3)
    )
    file.write_bytes(data)
    refused(garbi("map", pair[1], "-o", copied), str(file))


def test_dive_with_another_rig_is_refused_unless_that_is_allowed(
    pair: tuple[Path, Path], copied: Path, garbi: Garbi, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A season with a new calibration is possible, by mistake it is not; what a dive saw bears the doubt of its own rig."""
    from garbi_map.calibrate.map_uncertainty import MapSamples, View
    from garbi_map.log import open_log
    from garbi_map.seabed import JudgedPoints

    text = open_log([pair[1]]).rig_text or ""
    assert "beta: 0.017" in text
    other = rewrite(pair[1], tmp_path / "other.mcap", rig=text.replace("beta: 0.017", "beta: 0.01701 # 0.017"))
    before = contents(copied)
    refused(garbi("map", other, "-o", copied), "other.mcap", "another rig.yaml", "several_rigs")
    assert contents(copied) == before
    config = tmp_path / "config.yaml"
    config.write_text("database: {several_rigs: true}")
    seen: dict[float, int] = {}
    add = MapSamples.add

    def noted(samples: MapSamples, points: JudgedPoints, view: View) -> None:
        add(samples, points, view)
        assert view.mount.translation.any()
        if len(points.stamp_ns):
            seen.setdefault(view.rig.laser.beta, int(points.stamp_ns[0]))

    monkeypatch.setattr(MapSamples, "add", noted)
    assert garbi("map", other, "-o", copied, "--config", config).status == 0
    first, second = seen
    assert second == 0.01701 != first and seen[second] - seen[first] > LATER


def test_dive_of_another_site_is_refused_and_nothing_is_lost(
    pair: tuple[Path, Path], one: Path, copied: Path, garbi: Garbi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The map stays as it was, and a dive that fits it can still join."""
    monkeypatch.setattr("garbi_map.db.join.place", lambda *_: "they have no ground in common that can be recognised")
    refused(garbi("map", pair[1], "-o", copied), "second", "no ground in common", "another folder")
    assert {name: data for name, data in contents(copied).items() if name in contents(one)} == contents(one)


def test_folder_that_cannot_be_written(pair: tuple[Path, Path], copied: Path, garbi: Garbi) -> None:
    """A read-only catalogue: one line, and the map is as it was."""
    import garbi_map.db.catalogue as catalogue

    before = contents(copied)
    connect = sqlite3.connect
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            catalogue.sqlite3,
            "connect",
            lambda path, **options: connect(f"file:{path}?mode=ro", uri=True, **options),
        )
        refused(garbi("map", pair[1], "-o", copied), "catalogue.sqlite", "readonly", "nothing was changed")
    assert {name: data for name, data in contents(copied).items() if name in before} == before


def test_disk_that_is_full_when_a_dive_joins(
    pair: tuple[Path, Path], one: Path, both: Path, copied: Path, garbi: Garbi
) -> None:
    """One line that names the file; the map is the one before; with room again the same command ends in the grown one."""
    size = (both / "cloud.laz").stat().st_size - 1000
    with largest_file(size):
        refused(garbi("map", pair[1], "-o", copied), str(copied), "cannot be written")
    kept = contents(one)
    assert {name: data for name, data in contents(copied).items() if name in kept} == kept
    assert garbi("map", pair[1], "-o", copied).status == 0
    assert contents(copied) == contents(both)
