"""`garbi check` finds what is wrong with a log from samples, and stays quiet where nothing is."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import Garbi
from dive_logs import ENCODER, IMAGE, SAMPLE, black, rewrite, stopped

from garbi_map.config import Config
from garbi_map.health import Health, check_health
from garbi_map.health.findings import spans, told
from garbi_map.health.sample import stretches
from garbi_map.log import open_log
from garbi_map.rig import parse_rig

Change = Callable[[str, float, Any], Any]


def health(path: Path) -> Health:
    """Of a log by itself, from few samples."""
    return check_health(open_log([path]), Config(), count=16)


def kinds(found: Health) -> set[str]:
    """What was found, by name."""
    return {finding.kind for finding in found.findings}


def test_nothing_is_wrong_with_a_sound_dive(dive: Path) -> None:
    """No finding; figures that fit the simulated scanner: 20 Hz, 40 degrees, a metre away, tenths of a millimetre."""
    found = health(dive)
    assert found.findings == []
    assert found.motor is not None and found.pictures is not None and found.expected is not None
    assert (found.motor.first, found.motor.last) == pytest.approx((-0.026, 0.672), abs=0.02)
    assert found.motor.in_view == 1.0
    assert found.pictures.size == (768, 576)
    assert found.pictures.stripe_seen == 1.0
    assert found.pictures.expected is not None and found.pictures.expected > 0.95
    assert 0.5 < found.expected.range_m < 2
    assert 5e-5 < found.expected.point_sigma_m[0] < 1e-3
    assert {clock.role: round(clock.rate) for clock in found.clocks}["imu"] == 100


@pytest.mark.parametrize("name", ["calm", "drift", "cheap"])
def test_nothing_is_wrong_with_independent_dives(shared: Path, name: str) -> None:
    """Dives of another simulator are sound too."""
    assert health(shared / "data" / "dives" / name / "dive.mcap").findings == []


def stands_still(topic: str, at: float, message: Any) -> Any:
    """The encoder stops turning."""
    if topic == ENCODER and at > 4:
        message.position = np.full(1, 0.3)
    return message


def frozen() -> Change:
    """The camera sends one image again and again."""
    kept: list[Any] = []

    def change(topic: str, at: float, message: Any) -> Any:
        if topic == IMAGE and at > 3:
            kept.append(message.data)
            message.data = kept[0]
        return message

    return change


def white(topic: str, at: float, message: Any) -> Any:
    """Lights right into the camera."""
    if topic == IMAGE:
        import simplejpeg

        picture = np.full((576, 768, 3), 255, np.uint8)
        message.data = np.frombuffer(simplejpeg.encode_jpeg(picture, colorspace="BGR"), np.uint8)
    return message


def garbage(topic: str, at: float, message: Any) -> Any:
    """Images that are none."""
    if topic == IMAGE and at > 5:
        message.data = np.zeros(500, np.uint8)
    return message


def degrees(topic: str, at: float, message: Any) -> Any:
    """An encoder in degrees."""
    if topic == ENCODER:
        message.position = np.degrees(message.position)
    return message


def zero_elsewhere(topic: str, at: float, message: Any) -> Any:
    """An encoder that was put together anew."""
    if topic == ENCODER:
        message.position = message.position + 1.5
    return message


@pytest.mark.parametrize(
    ("change", "kind", "begin"),
    [
        (stands_still, "encoder_stuck", 4),
        (frozen(), "image_frozen", 3),
        (black(2, 6), "image_dark", 2),
        (white, "image_saturated", 0),
        (garbage, "image_unreadable", 5),
        (degrees, "encoder_range", 0),
        (zero_elsewhere, "encoder_out_of_view", 0),
    ],
)
def test_what_can_be_wrong(tmp_path: Path, dive: Path, change: Change, kind: str, begin: float) -> None:
    """Each fault has its name, begins where it begins, and says so in one line."""
    found = health(rewrite(dive, tmp_path / "log.mcap", change=change))
    (finding,) = [one for one in found.findings if one.kind == kind]
    assert finding.begin == pytest.approx(begin, abs=1.1)
    assert "\n" not in finding.text


def test_a_rig_that_is_not_this_one(tmp_path: Path, dive: Path) -> None:
    """A laser that is mounted elsewhere, and a camera of another size, are told; so is a rig file that is none."""
    text = open_log([dive]).rig_text or ""
    moved = yaml.safe_load(text)
    moved["laser"]["delta"] += 0.3
    moved["laser"]["y"] = -moved["laser"]["y"]
    assert "calibration_implausible" in kinds(health(rewrite(dive, tmp_path / "a.mcap", rig=yaml.safe_dump(moved))))
    small = yaml.safe_load(text)
    small["camera"] |= {"image_width": 640, "image_height": 480}
    assert "image_size" in kinds(health(rewrite(dive, tmp_path / "b.mcap", rig=yaml.safe_dump(small))))
    assert "rig_unusable" in kinds(health(rewrite(dive, tmp_path / "c.mcap", rig="camera: {}")))


def test_a_rig_given_wins(dive: Path) -> None:
    """The file on the command line is the one that is checked."""
    content = yaml.safe_load(open_log([dive]).rig_text or "")
    content["laser"]["y"] = -content["laser"]["y"]
    found = check_health(open_log([dive]), Config(), parse_rig(yaml.safe_dump(content), "rig.yaml"), count=8)
    assert "calibration_implausible" in kinds(found)


def test_clocks(tmp_path: Path, dive: Path) -> None:
    """A clock that is set back, one that runs elsewhere, and stamps that repeat."""

    def restamp(topic: str, at: float, stamp: int) -> int:
        if topic == "/depth/pressure":
            return stamp + 3_000_000_000
        if topic == "/dvl/twist" and at > 4:
            return stamp - 1_500_000_000
        return stamp - stamp % 50_000_000 if topic == "/imu/data" else stamp

    found = health(rewrite(dive, tmp_path / "log.mcap", restamp=restamp))
    texts = {one.kind: one.text for one in found.findings}
    assert re.match(r"dvl: its clock jumps by -1\.[45]", texts["clock_jump"])
    (ahead,) = [one.text for one in found.findings if one.text.startswith("pressure: its stamps are")]
    assert re.search(r"\+(3|2\.9)[\d.]* s from those of the images", ahead)
    assert any(one.text.startswith("imu: stamps repeat") for one in found.findings)


def test_silences_are_still_told(tmp_path: Path, dive: Path) -> None:
    """A topic that stops is a gap to the log's end."""
    found = health(rewrite(dive, tmp_path / "log.mcap", change=stopped(5, "/dvl/twist")))
    (topic,) = [one for one in found.log.topics if one.role == "dvl"]
    assert topic.gaps[-1].begin == pytest.approx(5, abs=0.2)


def test_json(dive: Path, garbi: Garbi) -> None:
    """--json holds what docs/check.md says it does, and nothing that JSON cannot."""
    ended = garbi("check", dive, "--json")
    assert ended.status == 0
    found = json.loads(ended.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    told = (Path(__file__).parents[1] / "docs" / "check.md").read_text()
    for name, value in found.items():
        assert f"`{name}`" in told
        for inner in value if isinstance(value, dict) else value[0] if value and isinstance(value, list) else ():
            if isinstance(value, dict) or isinstance(value[0], dict):
                assert f"`{inner}`" in told, f"{name}.{inner}"


def test_tables(dive: Path, garbi: Garbi) -> None:
    """What a reader sees: how much was sampled, the stripe, the laser, the promise."""
    ended = garbi("check", dive)
    assert ended.status == 0
    for word in ("Sampled:", "Stripe: seen in 100 %", "Laser:", "To expect, roughly: ground", "Every checksum holds"):
        assert word in " ".join(ended.out.split())


def test_samples_are_spread_and_bounded() -> None:
    """No more stretches than asked for, none longer than the log; the first at its begin, the last at its end."""
    log = open_log([SAMPLE])
    found, length = stretches(log, "laser_joint", 5)
    assert [one.time for one in found] == pytest.approx(np.linspace(length / 2, 25 - length / 2, 5), abs=0.1)
    assert all(len(one.images) == 2 for one in found)
    assert length <= 1


def test_a_large_log_without_an_index_is_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, garbi: Garbi) -> None:
    """Cut short, it is looked at in stretches; that is said, and what is seen of it is right."""
    import garbi_map.log.open as opening

    monkeypatch.setattr(opening, "WALKED", 1 << 20)
    monkeypatch.setattr("garbi_map.log.walk.STRETCH", 1 << 18)
    (tmp_path / "cut.mcap").write_bytes(SAMPLE.read_bytes()[:-50_000])
    whole, part = open_log([tmp_path / "cut.mcap"]), open_log([tmp_path / "cut.mcap"], quick=True)
    assert 0 < part.image_count <= whole.image_count
    assert part.begin_ns == whole.begin_ns
    ended = garbi("check", tmp_path / "cut.mcap")
    assert ended.status == 3
    assert "only stretches of it were looked at" in " ".join(ended.out.split())


def test_runs() -> None:
    """Neighbouring samples are one run, told in words."""
    runs = spans([1.0, 2.0, 3.0, 4.0, 5.0], [True, True, False, True, False])
    assert runs == [(1.0, 2.0), (4.0, 4.0)]
    assert told(runs, 1) == "1.0 to 2.0 s and 1 more"
    assert spans([], []) == []
