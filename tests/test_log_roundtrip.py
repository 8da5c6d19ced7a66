"""What LogWriter writes, the reader gives back, and so does everybody else's reader."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from sample_log import RIG, START, contents, write_sample
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogSettings, LogWriter, Mount, Topics, open_log

numbers = st.floats(-1e6, 1e6)
triples = st.tuples(numbers, numbers, numbers)
stamps = st.integers(0, (1 << 31) * 10**9 - 1)
delays = st.integers(0, 10**9)
turns = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.3)
covariances = st.lists(st.floats(0, 1e3), min_size=9, max_size=9).map(lambda c: np.array(c).reshape(3, 3))
fast = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@fast
@given(stamps, delays, numbers)
def test_encoder(tmp_path: Path, stamp: int, delay: int, angle: float) -> None:
    """Stamp, arrival and angle come back to the last bit."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_encoder(stamp, angle, stamp + delay)
    encoder = open_log([tmp_path / "log.mcap"]).navigation().encoder
    assert encoder is not None
    assert (encoder.stamp_ns[0], encoder.arrival_ns[0], encoder.angle[0]) == (stamp, stamp + delay, angle)


@fast
@given(stamps, triples, triples, st.none() | turns, covariances)
def test_imu(
    tmp_path: Path, stamp: int, rate: tuple, force: tuple, attitude: tuple | None, covariance: np.ndarray
) -> None:
    """Rates and specific force come back; the attitude normalised, or as NaN where there is none."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_imu(stamp, rate, force, attitude, covariance)
    imu = open_log([tmp_path / "log.mcap"]).navigation().imu
    assert imu is not None
    np.testing.assert_array_equal(imu.rate[0], rate)
    np.testing.assert_array_equal(imu.specific_force[0], force)
    if attitude is None:
        assert np.isnan(imu.attitude).all()
    else:
        np.testing.assert_allclose(imu.attitude[0], attitude / np.linalg.norm(attitude), rtol=1e-14)
        np.testing.assert_array_equal(imu.attitude_covariance[0], covariance)


@fast
@given(stamps, numbers, triples, covariances, triples, triples, turns)
def test_pressure_dvl_usbl_odometry(
    tmp_path: Path,
    stamp: int,
    pressure: float,
    velocity: tuple,
    covariance: np.ndarray,
    position: tuple,
    place: tuple,
    turn: tuple,
) -> None:
    """Each of the slow sensors comes back."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_pressure(stamp, pressure)
        log.write_dvl(stamp, velocity, covariance)
        log.write_usbl(stamp, position, covariance)
        log.write_odometry(stamp, place, turn)
    found = open_log([tmp_path / "log.mcap"]).navigation()
    assert found.pressure and found.dvl and found.fixes and found.odometry
    assert found.pressure.pressure[0] == pressure
    np.testing.assert_array_equal(found.dvl.velocity[0], velocity)
    np.testing.assert_array_equal(found.dvl.covariance[0], covariance)
    np.testing.assert_array_equal(found.fixes.position[0], position)
    np.testing.assert_array_equal(found.fixes.covariance[0], covariance)
    assert found.fixes.origin is None
    np.testing.assert_array_equal(found.odometry.position[0], place)
    np.testing.assert_allclose(found.odometry.quaternion[0], turn / np.linalg.norm(turn), rtol=1e-14)


@fast
@given(stamps, delays, st.binary(min_size=1, max_size=200), st.sampled_from(["jpeg", "png"]))
def test_compressed_image(tmp_path: Path, stamp: int, delay: int, data: bytes, encoding: str) -> None:
    """A compressed image comes back as the file that it was."""
    image = Image(stamp, stamp + delay, encoding, data)
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_image(image)
    assert list(open_log([tmp_path / "log.mcap"]).images()) == [image]


@fast
@given(stamps, st.integers(1, 9), st.integers(1, 9), st.integers(0, 5), st.data())
def test_raw_image(tmp_path: Path, stamp: int, height: int, width: int, padding: int, draw: st.DataObject) -> None:
    """A raw image keeps its encoding, size and row step."""
    step = 3 * width + padding
    data = draw.draw(st.binary(min_size=height * step, max_size=height * step))
    image = Image(stamp, stamp, "bgr8", data, height, width, step)
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_image(image)
    assert list(open_log([tmp_path / "log.mcap"]).images()) == [image]


@fast
@given(st.lists(st.tuples(triples, turns), min_size=1, max_size=5))
def test_mounts(tmp_path: Path, poses: list) -> None:
    """Static transforms come back as mounts."""
    mounts = {
        f"frame_{number}": Mount(np.array(at), np.array(turn) / np.linalg.norm(turn))
        for number, (at, turn) in enumerate(poses)
    }
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_mounts(5, mounts)
        log.write_encoder(5, 0.0)
    found = open_log([tmp_path / "log.mcap"]).navigation().mounts
    assert found.keys() == mounts.keys()
    for frame, mount in mounts.items():
        np.testing.assert_array_equal(found[frame].translation, mount.translation)
        np.testing.assert_allclose(
            Rotation.from_quat(found[frame].quaternion).as_matrix(),
            Rotation.from_quat(mount.quaternion).as_matrix(),
            atol=1e-12,
        )


def test_satellite_fixes_are_local_metres(tmp_path: Path) -> None:
    """Fixes count from the first one: 1e-5 degrees of latitude is 1.11 m north."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_navsat(10, 42.0, 3.0, 1.0, np.eye(3))
        log.write_navsat(20, 42.00001, 3.0, 1.0, np.eye(3))
        log.write_navsat(30, 42.0, 3.00001, math.nan, np.eye(3))
    fixes = open_log([tmp_path / "log.mcap"]).navigation().fixes
    assert fixes is not None
    assert fixes.origin == (42.0, 3.0, 1.0)
    np.testing.assert_allclose(fixes.position[:2], [[0, 0, 0], [0, 1.1107, 0]], atol=1e-3)
    np.testing.assert_allclose(fixes.position[2, :2], [0.8286, 0], atol=1e-3)
    assert fixes.covariance[2, 2, 2] > 1e4, "a fix without a height knows nothing of the height"


def test_everything_else_comes_back(tmp_path: Path) -> None:
    """Rig file, metadata, topics with counts, begin and end."""
    log = open_log([write_sample(tmp_path / "log.mcap")])
    assert log.rig_text == RIG
    assert log.metadata == {"dive": {"place": "tank"}}
    assert (log.begin_ns, log.end_ns) == (START, START + 99 * 20_000_000)
    assert log.topics["/imu/data"].type == "sensor_msgs/msg/Imu"
    assert log.topics["/imu/data"].count == 100
    assert log.image_count == 20
    assert log.losses == []


def test_a_window_of_time(tmp_path: Path) -> None:
    """begin is included, end is not."""
    log = open_log([write_sample(tmp_path / "log.mcap")])
    begin, end = START + 400_000_000, START + 800_000_000
    stamps = [image.stamp_ns for image in log.images(begin, end)]
    assert stamps == list(range(begin, end, 100_000_000))
    imu = log.navigation(begin, end).imu
    assert imu is not None
    assert (imu.stamp_ns[0], imu.stamp_ns[-1]) == (begin, end - 20_000_000)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_compressions_hold_the_same(tmp_path: Path, compression: str) -> None:
    """zstd, lz4 and none are read alike."""
    reference = contents(open_log([write_sample(tmp_path / "zstd.mcap")]))
    other = open_log([write_sample(tmp_path / "other.mcap", compression=compression)])
    assert contents(other) == reference


def test_other_topic_names_and_raw_images(tmp_path: Path) -> None:
    """A topic map renames; raw images pass for compressed ones."""
    topics = Topics(image="/cam", encoder="/joint", imu="/mems", pressure="/keller", dvl="/a50", usbl="/evologics")
    path = write_sample(tmp_path / "log.mcap", topics=topics, raw=True)
    assert open_log([path]).image_count == 0
    log = open_log([path], LogSettings(topics=topics))
    renamed = contents(log)
    plain = contents(open_log([write_sample(tmp_path / "plain.mcap")]))
    assert next(log.images()).encoding == "mono8"
    assert {role: rows for role, rows in renamed.items() if role != "image"} == {
        role: rows for role, rows in plain.items() if role != "image"
    }


def test_ros_reads_it(tmp_path: Path) -> None:
    """The mcap library (with its own checksum test) and rosbags read the file: profile, order of time, sequence."""
    path = write_sample(tmp_path / "log.mcap")
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        messages = [(channel.topic, m) for _, channel, m in reader.iter_messages()]
        assert [a.name for a in reader.iter_attachments()] == ["rig.yaml"]
    imu = [message for topic, message in messages if topic == "/imu/data"]
    assert [message.sequence for message in imu] == list(range(100))
    assert all(message.publish_time == message.log_time + 3_000_000 for message in imu)
    with AnyReader([path]) as other:
        connections = [c for c in other.connections if c.topic == "/laser/joint_states"]
        angles = [other.deserialize(raw, c.msgtype).position[0] for c, _, raw in other.messages(connections)]
    encoder = open_log([path]).navigation().encoder
    assert encoder is not None
    np.testing.assert_array_equal(encoder.angle, angles)


def test_rerun_reads_it(tmp_path: Path) -> None:
    """Rerun's importer finds the topics as entities."""
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.McapReader(str(write_sample(tmp_path / "log.mcap")))
    entities = {str(part.entity_path) for part in reader.stream()}
    assert {"/camera/image/compressed", "/imu/data", "/laser/joint_states", "/tf_static"} <= entities


def test_no_half_a_file(tmp_path: Path) -> None:
    """Where writing fails midway, neither the file nor anything beside it is left, and an old one stays."""
    path = tmp_path / "log.mcap"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError), LogWriter(path) as log:
        log.write_encoder(1, 0.5)
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["log.mcap"]


def test_unwritable(tmp_path: Path) -> None:
    """A folder that does not exist is told in one line."""
    with pytest.raises(GarbiError, match="cannot be written"):
        LogWriter(tmp_path / "nowhere" / "log.mcap")
