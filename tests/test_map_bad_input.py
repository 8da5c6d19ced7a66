"""What is wrong with a log ends `garbi map` in one clear line, or is left out and named in the report."""

from __future__ import annotations

import json
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from conftest import Ended, Garbi
from dive_logs import (
    DVL,
    ENCODER,
    IMAGE,
    IMU,
    ODOMETRY,
    PRESSURE,
    TRUTH,
    black,
    rewrite,
    stopped,
    without,
    zeroed,
)

from garbi_map.log import open_log
from garbi_map.outputs import OUTPUTS

HOUR = 3_600_000_000_000


def refused(ended: Ended, *words: str) -> None:
    """The input cannot be used: exit status 1, one line on stderr with these words, nothing else said."""
    assert ended.status == 1 and ended.out == ""
    assert ended.err.startswith("garbi: ") and ended.err.count("\n") == 1
    assert "fault of garbi's own" not in ended.err
    assert all(word in ended.err for word in words), ended.err


def report_of(out: Path) -> dict[str, Any]:
    """The report of a folder that holds every output and nothing else."""
    assert {path.name for path in out.iterdir()} == set(OUTPUTS)
    report: dict[str, Any] = json.loads((out / "report.json").read_text())
    return report


def mapped(ended: Ended, out: Path, *lost: str) -> dict[str, Any]:
    """The map is there; what was lost is named on stderr and in the report, and makes the exit status 3."""
    report = report_of(out)
    said = ended.err.splitlines()
    assert all(line.startswith("left out: ") for line in said)
    assert ended.status == (3 if lost else 0)
    assert bool(said) == bool(lost)
    for words in lost:
        assert any(words in line for line in said), ended.err
        assert any(words in line for line in report["left_out"])
    return report


def ate_mm(garbi: Garbi, out: Path, dive: Path) -> float:
    """Absolute trajectory error against the truth that the sound log carries."""
    figures = out.with_suffix(".json")
    assert garbi("evaluate", out, "--truth", dive, "--json", figures).status == 0
    error: float = json.loads(figures.read_text())["trajectory"]["ate_rmse_mm"]
    return error


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Where the map would go."""
    return tmp_path / "map"


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    """Where the bad log goes."""
    return tmp_path / "bad.mcap"


def test_no_images(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """The line names the topic that was looked for."""
    refused(garbi("map", rewrite(dive, bad, change=without(IMAGE)), "-o", out), "no images", IMAGE, "bad.mcap")
    assert not out.exists()


def test_no_encoder(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Without an encoder and a fixed angle nothing can be triangulated."""
    refused(garbi("map", rewrite(dive, bad, change=without(ENCODER)), "-o", out), "no encoder", "laser.fixed_angle")


def test_no_rig(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Neither attached nor given."""
    refused(garbi("map", rewrite(dive, bad, rig=""), "-o", out), "rig.yaml", "--rig")


@pytest.mark.parametrize(
    ("right", "wrong", "key"),
    [
        ("alpha_u:", "alpha_x:", "camera.intrinsics.alpha_u is missing"),
        ("image_width: 768", "image_width: -768", "camera.image_width is -768"),
        ("image_width: 768", "image_width: wide", "camera.image_width"),
        ("laser:", "lazer:", "laser"),
        ("camera:", "camera: [", "YAML"),
    ],
)
def test_rig_with_a_missing_or_absurd_value(
    right: str, wrong: str, key: str, dive: Path, bad: Path, out: Path, garbi: Garbi
) -> None:
    """The line names the log, the attachment and the key."""
    text = open_log([dive]).rig_text or ""
    assert right in text
    log = rewrite(dive, bad, seconds=0.5, rig=text.replace(right, wrong))
    refused(garbi("map", log, "-o", out), "bad.mcap: attachment rig.yaml", key)


def test_rig_of_another_camera(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Images of another size than calibrated are not used, and the line says both sizes."""
    text = (open_log([dive]).rig_text or "").replace("image_width: 768", "image_width: 640")
    log = rewrite(dive, bad, seconds=1, rig=text)
    refused(garbi("map", log, "-o", out), "768 x 576", "640 x 576")


@pytest.mark.parametrize("role", ["image", "encoder", "imu", "dvl", "pressure"])
def test_topic_of_a_type_that_cannot_be_used(role: str, dive: Path, out: Path, tmp_path: Path, garbi: Garbi) -> None:
    """A topic map that points at the wrong topic: the line names topic, type and what is wanted."""
    config = tmp_path / "config.yaml"
    config.write_text(f"log: {{topics: {{{role}: /camera/camera_info}}}}\n")
    ended = garbi("map", dive, "-o", out, "--config", config)
    refused(ended, "/camera/camera_info", "sensor_msgs/msg/CameraInfo", f"cannot be used as {role}")


def test_unknown_configuration_key(dive: Path, out: Path, tmp_path: Path, garbi: Garbi) -> None:
    """A misspelt key is named with its file."""
    config = tmp_path / "config.yaml"
    config.write_text("sweep: {max_rnage: 3}\n")
    refused(garbi("map", dive, "-o", out, "--config", config), "config.yaml", "sweep.max_rnage")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "empty"), (b"not a log " * 500, "not an MCAP file"), (None, "no such file")],
)
def test_what_is_no_log(content: bytes | None, words: str, bad: Path, out: Path, garbi: Garbi) -> None:
    """An empty file, another file, none."""
    if content is not None:
        bad.write_bytes(content)
    refused(garbi("map", bad, "-o", out), "bad.mcap", words)
    assert not out.exists()


def test_nothing_in_the_asked_seconds(dive: Path, out: Path, garbi: Garbi) -> None:
    """The line says how long the log is."""
    refused(garbi("map", dive, "-o", out, "--from", 100), "7.6 s")
    refused(garbi("map", dive, "-o", out, "--from", 5, "--to", 2), "7.6 s")


def test_wrong_usage(dive: Path, out: Path, garbi: Garbi) -> None:
    """Exit status 2: no output folder, no log, an option that does not exist, nonsense for a number."""
    for arguments in ((dive,), ("-o", out), (dive, "-o", out, "--fast"), (dive, "-o", out, "--workers", "0")):
        ended = garbi("map", *arguments)
        assert ended.status == 2 and "Usage" in ended.err and "Traceback" not in ended.err
    assert not out.exists()


def test_output_path_is_a_file(dive: Path, tmp_path: Path, garbi: Garbi) -> None:
    """Neither the file itself nor a folder under it can be the map's; the file stays as it is."""
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    for out in (file, file / "map"):
        refused(garbi("map", dive, "-o", out), str(out))
    assert file.read_text() == "mine"


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond so many bytes: a write fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [50_000, 400_000, 2_500_000])
def test_disk_that_takes_no_more(
    size: int, dive: Path, out: Path, garbi: Garbi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever file is the first that does not fit, sweeps, cloud or recording: one line, and no half a file."""
    monkeypatch.setattr("garbi_map.view.stream.STALLED", 0.3)
    with largest_file(size):
        ended = garbi("map", dive, "-o", out, "--to", 4)
    own = [line for line in ended.err.splitlines(keepends=True) if "re_log_encoding" not in line]  # Rerun says it, too
    refused(ended._replace(err="".join(own)), str(out), "cannot be written")
    left = {path.name: path.stat().st_size for path in out.iterdir() if path.name != ".work"}
    assert set(left) < set(OUTPUTS) and "report.json" not in left
    assert all(length < size for length in left.values())
    assert garbi("map", dive, "-o", out, "--to", 4).status == 0
    report_of(out)


def test_truncated_log(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """What was recorded before the end is mapped."""
    data = dive.read_bytes()
    bad.write_bytes(data[: int(0.7 * len(data))])
    report = mapped(garbi("map", bad, "-o", out), out, "no index at its end", "chunk lost")
    assert report["counts"]["profiles"] > 90


def test_damaged_log(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Zeros over a stretch of the file: what lies around it is mapped, although every sensor is silent meanwhile."""
    zeroed(dive, bad, 0.5, 0.55)
    report = mapped(garbi("map", bad, "-o", out), out, "bad.mcap: 2.5")
    assert 90 < report["counts"]["profiles"] < 110
    assert ate_mm(garbi, out, dive) < 50


def test_damage_is_still_named_when_a_run_goes_on(
    dive: Path, bad: Path, out: Path, garbi: Garbi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bad image that the interrupted run came across is in the report of the run that did not read it again."""

    def spoil(topic: str, at: float, message: Any) -> Any:
        if topic == IMAGE and 1 < at < 1.2:
            message.data = message.data[:500]
        return message

    rewrite(dive, bad, seconds=3.5, change=spoil)
    with monkeypatch.context() as patch:
        patch.setattr("garbi_map.estimate.navigate", None)
        assert garbi("map", bad, "-o", out).status == 1
    mapped(garbi("map", bad, "-o", out), out, "images: a damaged JPEG")


def test_sweep_in_which_nothing_is_visible(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """The laser is off from one turn to the next: that sweep is left out, the others are mapped."""
    rewrite(dive, bad, change=black(2.7, 6.9))
    report = mapped(garbi("map", bad, "-o", out), out, "1 sweep with too few points")
    assert report["counts"]["sweeps"] == 2


def test_laser_off_for_seconds(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Within a sweep: nothing is lost that was there, but the report counts the dark images."""
    rewrite(dive, bad, change=black(3.5, 5.5))
    report = mapped(garbi("map", bad, "-o", out), out)
    assert "40 images without the laser: it was off, hidden or out of range" in report["left_out"]


def test_black_images_only(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Nothing to map; the folder is left empty."""
    refused(garbi("map", rewrite(dive, bad, seconds=3, change=black(0, 9)), "-o", out), "the laser is not seen")
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("shift", [HOUR, -HOUR, -1_000_000_000])
def test_image_stamps_that_jump(shift: int, dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """A few images with stamps of another time are left out, counted and named."""
    rewrite(dive, bad, restamp=lambda topic, at, stamp: stamp + shift * (topic == IMAGE and 1.0 < at < 1.28))
    report = mapped(garbi("map", bad, "-o", out), out, f"{IMAGE}: 6 images left out")
    assert report["counts"]["profiles"] == 146


def test_seconds_count_from_the_first_stamp_that_is_believed(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """An image an hour early does not move the log's begin: --to means what it says."""
    rewrite(dive, bad, restamp=lambda topic, at, stamp: stamp - HOUR * (topic == IMAGE and 1.0 < at < 1.28))
    report = mapped(garbi("map", bad, "-o", out, "--to", 4), out, f"{IMAGE}: 6 images left out")
    assert report["counts"]["profiles"] == 74


def test_clock_that_is_set_in_the_middle(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Every stamp after 5 s is an hour late: the part before is mapped, the topics of the rest are named."""
    rewrite(dive, bad, restamp=lambda topic, at, stamp: stamp + HOUR * (at > 5))
    report = mapped(
        garbi("map", bad, "-o", out), out, *(f"{topic}: " for topic in (IMAGE, ENCODER, IMU, DVL, PRESSURE))
    )
    assert report["counts"]["profiles"] == 100


def test_encoder_that_stops_half_way(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Profiles without an angle are left out and counted."""
    rewrite(dive, bad, change=stopped(4, ENCODER))
    report = mapped(garbi("map", bad, "-o", out), out, "72 profiles without a laser angle")
    assert report["counts"]["profiles"] == 80


@pytest.mark.parametrize(
    ("topics", "names", "limit"),
    [
        ((IMU,), ("IMU",), 100),
        ((DVL,), ("DVL",), 10),
        ((IMU, DVL, PRESSURE), ("IMU", "DVL", "pressure"), 300),
    ],
    ids=["imu", "dvl", "all"],
)
def test_sensors_that_stop_half_way(
    topics: tuple[str, ...], names: tuple[str, ...], limit: float, dive: Path, bad: Path, out: Path, garbi: Garbi
) -> None:
    """The whole dive is mapped, worse where nothing else tells the motion (mm); the report says since when."""
    report = mapped(garbi("map", rewrite(dive, bad, change=stopped(4, *topics)), "-o", out), out)
    for name in names:
        assert any(line.startswith(f"{name}: nothing after ") for line in report["left_out"])
    assert report["counts"]["profiles"] == 152
    assert ate_mm(garbi, out, dive) < limit


def test_images_and_encoder_alone(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """No IMU, no DVL, no pressure: the turning points of the laser still give a map; the report says what is assumed."""
    rewrite(dive, bad, change=without(IMU, DVL, PRESSURE))
    report = mapped(garbi("map", bad, "-o", out), out)
    assert {"no IMU", "nothing measures velocity", "no pressure"} <= {
        line.partition(":")[0] for line in report["left_out"]
    }
    agreement = {quantity["name"]: quantity["value"] for quantity in report["residuals"]}["sweep to sweep, this map"]
    assert agreement < 1.0


def test_no_imu(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """A DVL and the pressure are enough for a map."""
    mapped(garbi("map", rewrite(dive, bad, change=without(IMU)), "-o", out), out)
    assert ate_mm(garbi, out, dive) < 60


def test_somebody_elses_odometry_alone(dive: Path, bad: Path, out: Path, garbi: Garbi) -> None:
    """Besides images and encoder only /odometry/filtered: it is the trajectory, and the sweeps mend it."""
    rewrite(dive, bad, change=without(IMU, DVL, PRESSURE), rename={TRUTH: ODOMETRY})
    report = mapped(garbi("map", bad, "-o", out), out)
    assert any("odometry topic" in line for line in report["left_out"])
    assert ate_mm(garbi, out, dive) < 3


def test_dive_of_a_third_of_a_second(dive: Path, out: Path, garbi: Garbi) -> None:
    """Six images, no turning point: a small map, as true as the sensors."""
    report = mapped(garbi("map", dive, "-o", out, "--to", 0.3), out)
    assert report["counts"]["profiles"] == 6
    assert ate_mm(garbi, out, dive) < 20
