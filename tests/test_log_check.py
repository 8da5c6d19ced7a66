"""`garbi check` says what is there, what is missing and what it costs, and what is damaged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from dive_logs import SAMPLE
from sample_log import START, write_sample

from garbi_map.cli.check import check
from garbi_map.errors import GarbiError
from garbi_map.log import LogWriter, open_log
from garbi_map.log.check import check_log
from garbi_map.stripe.decode import decode


def test_a_complete_log(tmp_path: Path) -> None:
    """Counts, rates and duration; nothing missing but what was left out on purpose."""
    found = check_log(open_log([write_sample(tmp_path / "log.mcap")]))
    rates = {topic.role: (topic.count, round(topic.rate, 6)) for topic in found.topics}
    assert rates["imu"] == (100, 50)
    assert rates["encoder"] == (100, 50)
    assert rates["image"] == (20, 10)
    assert rates["dvl"] == (10, 5)
    assert found.duration == pytest.approx(1.98)
    assert all(not topic.gaps for topic in found.topics if topic.role != "pressure")
    assert [missing.what for missing in found.missing] == ["mount of pressure_link"]
    assert (found.damage, found.mappable, found.read_whole, found.checksums) == ((), True, True, True)


@pytest.mark.parametrize("chunks_alone", [False, True])
def test_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks_alone: bool) -> None:
    """A silence of a second in the middle and an early end are gaps; jitter and a late message are not. Chunks alone
    tell the same, as the log of hours that they are used for is made of many."""
    if chunks_alone:
        monkeypatch.setattr("garbi_map.log.gaps.READ_ALL", 0)
    with LogWriter(tmp_path / "log.mcap", chunk_size=8000) as log:
        for step in range(300):
            stamp = START + step * 10_000_000
            log.write_imu(stamp, [0, 0, 0], [0, 0, 9.8])
            if not 100 <= step < 200 and step % 7:
                log.write_encoder(stamp + (step % 3) * 1_000_000, 0.1)
            if step < 150 and step % 10 == 0:
                log.write_pressure(stamp, 1e5)
    checked = check_log(open_log([tmp_path / "log.mcap"]))
    assert (checked.shortest_gap > 0) == chunks_alone
    found = {topic.role: topic for topic in checked.topics}
    assert (found["imu"].rate, found["encoder"].rate) == pytest.approx((100, 100), rel=0.2)
    assert found["imu"].gaps == ()
    (gap,) = found["encoder"].gaps
    assert (gap.begin, gap.end) == pytest.approx((0.99, 2.0), abs=0.03)
    (gap,) = found["pressure"].gaps
    assert (gap.begin, gap.end) == pytest.approx((1.4, 2.99), abs=0.03)


@pytest.mark.parametrize(
    ("skip", "what", "cost"),
    [
        ("encoder", "encoder", "laser.fixed_angle"),
        ("image", "image", "nothing to map"),
    ],
)
def test_what_is_missing_and_its_cost(tmp_path: Path, skip: str, what: str, cost: str) -> None:
    """Each thing that a map needs is told with what its absence costs."""
    found = check_log(open_log([write_sample(tmp_path / "log.mcap", skip=(skip,))]))
    costs = {missing.what: missing.cost for missing in found.missing}
    assert cost in costs[what]
    assert found.mappable == (skip != "image")


def test_no_navigation_at_all(tmp_path: Path) -> None:
    """Images and encoder alone: every navigation sensor is told with its cost."""
    found = check_log(open_log([write_sample(tmp_path / "log.mcap", skip=("imu", "navigation"))]))
    assert {"imu", "pressure", "dvl", "fixes"} <= {missing.what for missing in found.missing}


def test_imu_without_attitude(tmp_path: Path) -> None:
    """Rates alone are told apart from rates with attitude."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_imu(START, [0, 0, 0], [0, 0, 9.8])
        log.write_dvl(START, [np.nan] * 3)
    found = {missing.what for missing in check_log(open_log([tmp_path / "log.mcap"])).missing}
    assert {"attitude", "dvl"} <= found


def test_from_the_index_alone(tmp_path: Path) -> None:
    """Without reading the messages the same rates come out, and it is said that they were not read."""
    log = open_log([write_sample(tmp_path / "log.mcap")])
    quick, whole = check_log(log, whole=False), check_log(log, whole=True)
    assert quick.topics == whole.topics
    assert (quick.read_whole, whole.read_whole) == (False, True)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 0 and a table for a sound log, 3 for a damaged one, one line for one without images; --json is JSON."""
    path = write_sample(tmp_path / "log.mcap")
    check([path])
    assert "/imu/data" in capsys.readouterr().out.replace("\n", "")
    check([path], as_json=True)
    assert json.loads(capsys.readouterr().out)["mappable"] is True
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(typer.Exit) as exit_:
        check([path], as_json=True)
    assert exit_.value.exit_code == 3
    assert "checksum" in json.loads(capsys.readouterr().out)["damage"][0]
    renamed = tmp_path / "config.yaml"
    renamed.write_text("log: {topics: {image: /cam}}")
    with pytest.raises(GarbiError, match=r"no images on /cam.*images are on /camera/image/compressed: garbi check"):
        check([path], config=renamed)
    renamed.write_text("log: {topics: {imu: /depth/pressure}}")
    with pytest.raises(GarbiError, match=r"/depth/pressure: type sensor_msgs/msg/FluidPressure"):
        check([path], config=renamed)
    with pytest.raises(GarbiError, match="no images on /camera/image/compressed"):
        check([write_sample(tmp_path / "blind.mcap", skip=("image",))])


def test_messages_of_another_encoding(tmp_path: Path) -> None:
    """A topic that is not CDR cannot be used, and says what it is instead."""
    from mcap.writer import Writer

    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros1")
        schema = writer.register_schema("sensor_msgs/CompressedImage", "ros1msg", b"")
        writer.add_message(writer.register_channel("/camera/image/compressed", "ros1", schema), START, b"1234", START)
        writer.finish()
    found = check_log(open_log([tmp_path / "log.mcap"]))
    assert "type sensor_msgs/CompressedImage as ros1 cannot be used as image" in found.unusable[0]


def test_a_log_of_hours(tmp_path: Path) -> None:
    """The bench's long log, small: as long and as large as asked, and its images decode."""
    from tools.bench.long_log import write_long

    write_long(SAMPLE, tmp_path / "long.mcap", hours=0.02, gigabytes=0.072)
    state = (tmp_path / "long.mcap").stat()
    assert state.st_size == pytest.approx(0.072e9, rel=0.15)
    log = open_log([tmp_path / "long.mcap"])
    assert (log.end_ns - log.begin_ns) * 1e-9 == pytest.approx(72, abs=0.1)
    images = list(log.images())
    assert len(images) == 72
    assert {decode(image).shape for image in images[:3]} == {(576, 768, 3)}
    assert all(len(topic.gaps) == 0 for topic in check_log(log).topics if topic.role)
