"""Logs of other programs: their topics are guessed, their types are read, and the map is the same."""

from __future__ import annotations

import re
from pathlib import Path

import laspy
import numpy as np
import pytest
import yaml
from conftest import Garbi
from dive_logs import SAMPLE
from foreign_logs import RENAMED, as_it_is, other_types, told_again, write_database, write_ros1, write_split
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from sample_log import START

from garbi_map.config import Config, load_config
from garbi_map.errors import GarbiError
from garbi_map.importing import import_log, suggest_topics
from garbi_map.importing.plausible import judge
from garbi_map.importing.suggest import Candidate, Suggestion
from garbi_map.log import LogSettings, LogWriter, Mount, Navigation, Scale, Topics, open_log
from garbi_map.log.decode import BAD_MESSAGE, WIDTHS, decoders
from garbi_map.log.foreign import HEADERLESS
from garbi_map.log.types import log_types, standard_types

PRESSURE = "sensor_msgs/msg/FluidPressure"
SECONDS = 2.0
SENSORS = {"encoder": "angle", "imu": "rate", "pressure": "pressure", "dvl": "velocity"}


@pytest.fixture(scope="module")
def reference() -> Navigation:
    """What the sample log's sensors say in its first seconds."""
    log = open_log([SAMPLE])
    return log.navigation(end_ns=log.begin_ns + round(SECONDS * 1e9))


@pytest.mark.parametrize("recorder", [write_split, write_database, write_ros1])
def test_guessed_topics_read_the_same(tmp_path: Path, reference: Navigation, recorder) -> None:
    """Renamed topics, raw images, a bare number of degrees for the encoder, a pose for the pressure: every value and
    stamp is that of the original; what has no stamp has that of its arrival, which is remarked."""
    path = recorder(tmp_path / "foreign", told_again(SAMPLE, SECONDS, other_types))
    suggestion = suggest_topics(open_log([path]))
    assert {role: one.topic for role, one in suggestion.chosen.items()} == {
        "image": "/front_camera/image_raw",
        "encoder": "/slit_motor/state",
        "imu": "/mti/imu",
        "depth": "/ctd/pressure",
        "dvl": "/nav/dvl_velocity",
    }
    log = open_log([path], suggestion.settings())
    found = log.navigation()
    for sensor, value in SENSORS.items():
        ours, theirs = getattr(reference, sensor), getattr(found, sensor)
        np.testing.assert_array_equal(ours.arrival_ns if sensor == "encoder" else ours.stamp_ns, theirs.stamp_ns)
        np.testing.assert_allclose(getattr(theirs, value), getattr(ours, value), rtol=1e-12, atol=1e-12)
    assert found.mounts.keys() == reference.mounts.keys()
    stamps = [image.stamp_ns for image in log.images()]
    original = open_log([SAMPLE])
    assert stamps == [image.stamp_ns for image in original.images(None, original.begin_ns + round(SECONDS * 1e9))]
    assert log.losses == []
    assert log.remarks == ["/slit_motor/state: its messages have no stamp; the time of recording is taken for it"]


def test_import_writes_what_it_reads(tmp_path: Path, reference: Navigation, garbi: Garbi) -> None:
    """A ROS 1 bag becomes a log in our own topics and types, which needs no topic map."""
    bag = write_ros1(tmp_path / "dive.bag", told_again(SAMPLE, SECONDS, other_types))
    ended = garbi("import", bag, "-o", tmp_path / "log.mcap")
    assert ended.status == 0, ended.err
    assert "no stamp" in ended.out
    found = open_log([tmp_path / "log.mcap"])
    navigation = found.navigation()
    for sensor, value in SENSORS.items():
        ours, theirs = getattr(reference, sensor), getattr(navigation, sensor)
        np.testing.assert_array_equal(ours.arrival_ns if sensor == "encoder" else ours.stamp_ns, theirs.stamp_ns)
        np.testing.assert_allclose(getattr(theirs, value), getattr(ours, value), rtol=1e-12, atol=1e-12)
    assert {found.topics[name].type for name in ("/laser/joint_states", "/depth/pressure", "/dvl/twist")} == {
        "sensor_msgs/msg/JointState",
        PRESSURE,
        "geometry_msgs/msg/TwistWithCovarianceStamped",
    }
    assert found.image_count == len(list(open_log([SAMPLE]).images(None, found.begin_ns + round(SECONDS * 1e9))))


def test_same_map_as_the_original(tmp_path: Path, dive: Path, garbi: Garbi) -> None:
    """Renamed topics, decoded images, three files in a directory: trajectory and cloud are equal to the last bit."""
    theirs = write_split(tmp_path / "bag", told_again(dive, 5.0, as_it_is))
    config, rig = tmp_path / "topics.yaml", tmp_path / "rig.yaml"
    suggested = garbi("check", theirs, "--suggest-topics")
    assert suggested.status == 0
    config.write_text(suggested.out)
    rig.write_text(open_log([dive]).rig_text or "")
    assert garbi("map", dive, "-o", tmp_path / "ours", "--to", 4.99, "--workers", 1).status in (0, 3)
    ended = garbi(
        "map", theirs, "-o", tmp_path / "theirs", "--to", 4.99, "--workers", 1, "--config", config, "--rig", rig
    )
    assert ended.status in (0, 3), ended.err
    ours, found = ((tmp_path / name / "trajectory.tum").read_bytes() for name in ("ours", "theirs"))
    assert ours == found
    clouds = [laspy.read(tmp_path / name / "cloud.laz") for name in ("ours", "theirs")]
    assert len(clouds[0].points) > 1000
    assert clouds[0].points.array.tobytes() == clouds[1].points.array.tobytes()


def test_fixes_and_camera_info_are_taken_over_as_they_are(tmp_path: Path) -> None:
    """A satellite fix keeps its latitude and longitude, across the windows in which a long log is written anew."""
    theirs = Topics(navsat="/gps/fix", camera_info="/cam/info", encoder="/cam/angle")
    with LogWriter(tmp_path / "theirs.mcap", theirs) as log:
        log.write_camera_info(START, 8, 6, np.eye(3), [0.1] * 5)
        for step in range(800):
            log.write_navsat(START + step * 10**9, 41.9 + 1e-6 * step, 3.1, 5.0, np.eye(3))
            log.write_encoder(START + step * 10**9, 0.01 * step)
    found = open_log([tmp_path / "theirs.mcap"], LogSettings(topics=theirs))
    assert import_log(found, tmp_path / "ours.mcap") == []
    ours = open_log([tmp_path / "ours.mcap"])
    navigation = ours.navigation()
    assert navigation.fixes is not None and navigation.encoder is not None
    assert navigation.fixes.origin == (41.9, 3.1, 5.0)
    assert len(navigation.fixes.position) == len(navigation.encoder.angle) == 800
    assert ours.topics["/camera/camera_info"].count == 1


def test_frames_and_attitude_of_their_own(tmp_path: Path) -> None:
    """Mounts under other names, and an attitude that comes apart from the IMU, are found and used."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_mounts(START, {"xsens": Mount(np.array([1.0, 2.0, 3.0])), "scanner": Mount()})
        make = log.types.types
        for step in range(50):
            stamp = START + step * 20_000_000
            log.write_imu(stamp, [0, 0, 1], [0, 0, 9.8], None, frame="xsens")
            turn = make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(step / 100), w=np.cos(step / 100))
            message = make["geometry_msgs/msg/QuaternionStamped"](log.header(stamp + 10_000_000, "xsens"), turn)
            log.write("/ahrs/attitude", "geometry_msgs/msg/QuaternionStamped", message, stamp + 10_000_000)
    found = suggest_topics(open_log([tmp_path / "log.mcap"]))
    assert found.frames == {"imu_link": "xsens"}
    assert any("log.frames.rig to one of scanner, xsens" in line for line in found.remarks)
    navigation = open_log([tmp_path / "log.mcap"], found.settings()).navigation()
    np.testing.assert_array_equal(navigation.mount("imu_link").translation, [1, 2, 3])
    assert navigation.imu is not None
    assert np.isnan(navigation.imu.attitude[0]).all()
    np.testing.assert_allclose(np.arctan2(*navigation.imu.attitude[1:, 2:].T), (np.arange(1, 50) - 0.5) / 100)


def test_no_stamp_on_another_clock(tmp_path: Path) -> None:
    """Where stamps and recording are years apart, a message without a stamp is put on the clock of the others."""
    types, years = standard_types(), 10**17
    with (tmp_path / "log.mcap").open("wb") as file, LogWriter(tmp_path / "unused.mcap") as headers:
        headers.write_encoder(START, 0.0)
        writer = Writer(file)
        writer.start("ros2")
        channels = {}
        for topic, name in (("/depth/pressure", PRESSURE), ("/motor", "std_msgs/msg/Float64")):
            text = types.generate_msgdef(name, ros_version=2)[0].encode()
            channels[name] = writer.register_channel(topic, "cdr", writer.register_schema(name, "ros2msg", text))
        for step in range(20):
            stamp = START + step * 10**8
            for name, message in (
                (
                    "sensor_msgs/msg/FluidPressure",
                    {"header": headers.header(stamp, ""), "fluid_pressure": 1e5, "variance": 0.0},
                ),
                ("std_msgs/msg/Float64", {"data": 0.1 * step}),
            ):
                data = bytes(types.serialize_cdr(types.types[name](**message), name))
                writer.add_message(channels[name], stamp + years, data, stamp + years)
        writer.finish()
    encoder = open_log([tmp_path / "log.mcap"], LogSettings(topics=Topics(encoder="/motor"))).navigation().encoder
    assert encoder is not None
    np.testing.assert_array_equal(encoder.stamp_ns, START + np.arange(20) * 10**8)


def test_a_depth_needs_no_water(tmp_path: Path) -> None:
    """Metres are metres in any water: a density of one's own beside a topic of depths is a mistake that is told."""
    path = tmp_path / "config.yaml"
    path.write_text("log: {topics: {depth: /depth}}\nnavigate: {water_density: 1000}\n")
    with pytest.raises(GarbiError, match=r"log\.topics\.depth is metres already"):
        load_config(path)


def test_one_topic_in_two_roles(tmp_path: Path) -> None:
    """A pose can be the depth and the attitude at once."""
    with LogWriter(tmp_path / "log.mcap") as log:
        for step in range(10):
            log.write_odometry(START + step * 10**8, [0, 0, -3 - step], [0, 0, 0, 1])
    topics = Topics(depth="/odometry/filtered", attitude="/odometry/filtered", odometry="")
    found = open_log([tmp_path / "log.mcap"], LogSettings(topics=topics)).navigation()
    assert found.pressure and found.imu
    np.testing.assert_allclose(found.pressure.pressure, 101325 + 1025 * 9.80665 * (3 + np.arange(10)))
    assert found.imu.attitude.shape == (10, 4)


@pytest.mark.parametrize(
    ("role", "values", "scale"),
    [
        ("encoder", np.sin(np.arange(300) / 30), 1.0),
        ("encoder", 30 * np.sin(np.arange(300) / 30), np.pi / 180),
        ("pressure", np.full(9, 2.1e5), 1.0),
        ("pressure", np.full(9, 2100.0), 100.0),
        ("pressure", np.full(9, 210.0), 1e3),
        ("pressure", np.full(9, 2.1), 1e5),
        ("depth", np.full(9, -12.0), -1.0),
    ],
)
def test_units_by_what_the_numbers_can_be(role: str, values: np.ndarray, scale: float) -> None:
    """Radians or degrees, Pa or bar, down or up."""
    verdict = judge(role, values[:, None])
    assert verdict.score > 0
    assert verdict.scale == pytest.approx(scale)


@pytest.mark.parametrize("values", [np.zeros(50), np.random.default_rng(1).uniform(-1, 1, 300)])
def test_no_encoder(values: np.ndarray) -> None:
    """What stands still or jumps about is not offered as the laser's angle."""
    assert judge("encoder", values[:, None]).score < 0


def test_truth_is_not_offered() -> None:
    """The sample log carries a true trajectory: it is not suggested as odometry."""
    assert "odometry" not in suggest_topics(open_log([SAMPLE])).chosen


def test_damaged_bags(tmp_path: Path) -> None:
    """A bag cut anywhere is read as far as it goes, or refused in one line."""
    bag = write_ros1(tmp_path / "whole.bag", told_again(SAMPLE, 0.5))
    data = bag.read_bytes()
    for share in (0.0, 0.001, 0.1, 0.5, 0.999):
        (tmp_path / "cut.bag").write_bytes(data[: int(share * len(data))] or b"#ROSBAG V2.0\n")
        with pytest.raises(GarbiError, match=re.escape("cut.bag")) as error:
            open_log([tmp_path / "cut.bag"])
        assert "\n" not in str(error.value)
    middle = len(data) // 2
    (tmp_path / "cut.bag").write_bytes(data[:middle] + bytes(5000) + data[middle + 5000 :])
    try:
        found = open_log([tmp_path / "cut.bag"], LogSettings(topics=Topics(image="/front_camera/image_raw")))
    except GarbiError as error:
        assert "\n" not in str(error)
    else:
        assert len(list(found.images())) < found.image_count
        assert any("damaged after" in line for line in found.losses)


def test_bags_come_alone(tmp_path: Path) -> None:
    """Several bags are not one log: what to do is told."""
    bag = write_ros1(tmp_path / "a.bag", told_again(SAMPLE, 0.2))
    with pytest.raises(GarbiError, match="garbi import"):
        open_log([bag, bag])
    with pytest.raises(GarbiError, match="exists already"):
        import_log(open_log([bag], suggest_topics(open_log([bag])).settings()), bag)


DECODERS = decoders(log_types(()), "laser_joint", set())
names = st.text(min_size=1, max_size=30)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from([*RENAMED, *Topics.model_fields]), st.tuples(names, names, st.floats())), names)
def test_any_names_at_all(chosen: dict, frame: str) -> None:
    """Whatever topics are called and remarked, the printed map is a configuration that names just them."""
    candidates = {
        role: Candidate(role, topic, "", 3, remark, scale if np.isfinite(scale) and scale else 1.0)
        for role, (topic, remark, scale) in chosen.items()
        if role in Topics.model_fields
    }
    others = [Candidate("imu", frame, "", 3, frame)]
    suggestion = Suggestion(candidates, others, {}, {"imu_link": frame}, [frame])
    read = Config.model_validate(yaml.safe_load(suggestion.to_yaml())).log
    assert read == suggestion.settings()


KEYS = st.sampled_from(["log", "topics", "scale", "frames", "image", "encoder", "rig"])
LEAVES = st.none() | st.booleans() | st.floats() | st.text(max_size=9)
CONTENT = st.recursive(
    LEAVES, lambda deep: st.lists(deep, max_size=3) | st.dictionaries(KEYS, deep, max_size=4), max_leaves=9
)


@settings(max_examples=100, deadline=None)
@given(CONTENT)
def test_any_topic_map_at_all(tmp_path_factory: pytest.TempPathFactory, content: object) -> None:
    """A topic map is a configuration or one line of error."""
    path = tmp_path_factory.getbasetemp() / "map.yaml"
    path.write_text(yaml.safe_dump(content))
    try:
        assert isinstance(load_config(path).log.scale, Scale)
    except GarbiError as error:
        assert "\n" not in str(error)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=700), st.booleans())
def test_any_message_at_all(data: bytes, headed: bool) -> None:
    """Every decoder of every role makes a row of its width of any bytes, or calls them bad."""
    for role, usable in DECODERS.items():
        for name, decode in usable.items():
            try:
                row = decode(memoryview((b"\0\1\0\0" if headed else b"") + data))
            except BAD_MESSAGE:
                continue
            assert row is None or (len(row[1]) == WIDTHS[role] and (row[0] is None) == (name in HEADERLESS))
