"""Bad input ends in one clear line, or is left out and named."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import get_types_from_msg
from sample_log import START, write_sample

from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogSettings, LogWriter, Topics, open_log

STEP = 20_000_000


def one_line(error: pytest.ExceptionInfo[GarbiError], *words: str) -> None:
    """The message is one line and holds the words."""
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text


def test_missing_file(tmp_path: Path) -> None:
    """A path that does not exist is named."""
    with pytest.raises(GarbiError) as error:
        open_log([tmp_path / "none.mcap"])
    one_line(error, "none.mcap", "no such file")


def test_empty_file(tmp_path: Path) -> None:
    """A file without a byte."""
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(GarbiError) as error:
        open_log([tmp_path / "empty.mcap"])
    one_line(error, "empty.mcap", "empty")


def test_no_mcap(tmp_path: Path) -> None:
    """A text file, longer and shorter than a footer."""
    for text in ("hello", "hello " * 1000):
        (tmp_path / "notes.mcap").write_text(text)
        with pytest.raises(GarbiError) as error:
            open_log([tmp_path / "notes.mcap"])
        one_line(error, "notes.mcap", "not an MCAP file")


def test_log_without_messages(tmp_path: Path) -> None:
    """A recorder that was started and stopped."""
    with LogWriter(tmp_path / "idle.mcap") as log:
        log.attach("rig.yaml", "application/yaml", b"camera: {}")
    with pytest.raises(GarbiError) as error:
        open_log([tmp_path / "idle.mcap"])
    one_line(error, "idle.mcap", "no message")


def test_directory_without_metadata(tmp_path: Path) -> None:
    """A folder is a log only with its metadata.yaml."""
    with pytest.raises(GarbiError) as error:
        open_log([tmp_path])
    one_line(error, "metadata.yaml")


@pytest.mark.parametrize("text", ["", "{", "a: 1", "rosbag2_bagfile_information: 3", "\x00"])
def test_directory_with_nonsense(tmp_path: Path, text: str) -> None:
    """metadata.yaml that says something else."""
    (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(GarbiError) as error:
        open_log([tmp_path])
    one_line(error, "metadata.yaml")


def test_no_images_is_for_the_caller_to_judge(tmp_path: Path) -> None:
    """Without images there are none, and no error."""
    log = open_log([write_sample(tmp_path / "log.mcap", skip=("image",))])
    assert log.image_count == 0
    assert list(log.images()) == []
    assert log.navigation().imu is not None


def test_sensors_that_are_not_there(tmp_path: Path) -> None:
    """Every sensor that is missing is None."""
    navigation = open_log([write_sample(tmp_path / "log.mcap", skip=("encoder", "imu", "navigation"))]).navigation()
    for sensor in ("encoder", "imu", "pressure", "dvl", "fixes", "odometry"):
        assert getattr(navigation, sensor) is None


def test_topic_of_another_type(tmp_path: Path) -> None:
    """A topic that the configuration points to and that cannot play the part: topic and type are named."""
    path = write_sample(tmp_path / "log.mcap")
    log = open_log([path], LogSettings(topics=Topics(image="/imu/data", dvl="/depth/pressure")))
    with pytest.raises(GarbiError) as error:
        next(log.images())
    one_line(error, "/imu/data", "sensor_msgs/msg/Imu", "image")
    with pytest.raises(GarbiError) as error:
        log.navigation()
    one_line(error, "/depth/pressure", "sensor_msgs/msg/FluidPressure", "dvl")


def test_an_empty_topic_name_ignores_the_topic(tmp_path: Path) -> None:
    """What the configuration leaves out is not read."""
    path = write_sample(tmp_path / "log.mcap")
    navigation = open_log([path], LogSettings(topics=Topics(dvl="", usbl=""))).navigation()
    assert navigation.dvl is None
    assert navigation.fixes is None
    assert navigation.pressure is not None


def test_messages_that_are_no_messages(tmp_path: Path) -> None:
    """Noise under the name of a type is counted and left out; its neighbours stay."""
    path = tmp_path / "log.mcap"
    types = LogWriter(tmp_path / "unused.mcap").types
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        random = np.random.default_rng(0)
        for number, (topic, name) in enumerate(
            [
                ("/camera/image/compressed", "sensor_msgs/msg/CompressedImage"),
                ("/laser/joint_states", "sensor_msgs/msg/JointState"),
                ("/imu/data", "sensor_msgs/msg/Imu"),
                ("/depth/pressure", "sensor_msgs/msg/FluidPressure"),
                ("/odometry/filtered", "nav_msgs/msg/Odometry"),
                ("/navsat/fix", "sensor_msgs/msg/NavSatFix"),
                ("/tf_static", "tf2_msgs/msg/TFMessage"),
            ]
        ):
            definition, _ = types.generate_msgdef(name, ros_version=2)
            schema = writer.register_schema(name, "ros2msg", definition.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for length in (0, 3, 4, 20, 300):
                data = b"\0\1\0\0"[:length] + random.bytes(max(length - 4, 0))
                writer.add_message(channel, START + number, data, START + number)
        writer.finish()
    log = open_log([path])
    assert list(log.images()) == []
    navigation = log.navigation()
    assert (navigation.encoder, navigation.imu, navigation.pressure, navigation.mounts) == (None, None, None, {})
    for topic in log.topics:
        assert any(topic in line for line in log.losses)


def test_not_a_number(tmp_path: Path) -> None:
    """NaN is left out and counted; in the DVL it says that there is no lock, in the attitude that there is none."""
    with LogWriter(tmp_path / "log.mcap") as log:
        for step in range(10):
            bad = step == 4
            log.write_pressure(START + step * STEP, math.nan if bad else 1e5)
            log.write_encoder(START + step * STEP, math.inf if bad else 0.1)
            log.write_dvl(START + step * STEP, [math.nan if bad else 0.1, 0, 0])
            log.write_imu(START + step * STEP, [0, 0, 0], [0, 0, 9.8], [math.nan] * 4 if bad else [0, 0, 0, 2])
    found = open_log([tmp_path / "log.mcap"])
    navigation = found.navigation()
    assert navigation.pressure and navigation.encoder and navigation.dvl and navigation.imu
    assert len(navigation.pressure.stamp_ns) == len(navigation.encoder.stamp_ns) == 9
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(navigation.dvl.velocity).all(axis=1)), [4])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(navigation.imu.attitude).all(axis=1)), [4])
    np.testing.assert_array_equal(navigation.imu.attitude[0], [0, 0, 0, 1])
    assert len(found.losses) == 2


def test_stamps_that_jump(tmp_path: Path) -> None:
    """A wild stamp, one that goes back, one that comes twice: left out, named, for numbers and for images."""
    offsets = [0, 1, 2, 3, 4, 3, 5, 6, 100_000, 7, 8, 9, 2, 10, 11, 12]
    with LogWriter(tmp_path / "log.mcap") as log:
        for place, offset in enumerate(offsets):
            stamp, arrival = START + offset * 10**9, START + place * 10**9
            log.write_pressure(stamp, 1e5 + place, arrival)
            log.write_image(Image(stamp, arrival, "jpeg", bytes([place])))
    found = open_log([tmp_path / "log.mcap"])
    pressure = found.navigation().pressure
    assert pressure is not None
    assert ((pressure.stamp_ns - START) // 10**9).tolist() == list(range(13))
    images = list(found.images())
    assert [(image.stamp_ns - START) // 10**9 for image in images] == list(range(13))
    assert any(line.startswith("/depth/pressure: 3 messages left out") for line in found.losses)
    assert any(line.startswith("/camera/image/compressed: 3 images left out") for line in found.losses)


def test_joint_is_found_by_name(tmp_path: Path) -> None:
    """The only joint is the encoder whatever its name; among several the name decides, or the names are told."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.write_encoder(START, 0.5, joint="whatever")
    encoder = open_log([path]).navigation(joint="slit").encoder
    assert encoder is not None
    assert encoder.angle.tolist() == [0.5]
    with LogWriter(path) as log:
        for step in range(3):
            message = log.types.types["sensor_msgs/msg/JointState"](
                header=log.header(START + step, ""),
                name=["tail", "slit"],
                position=np.array([9.0, step]),
                velocity=np.empty(0),
                effort=np.empty(0),
            )
            log.write("/laser/joint_states", "sensor_msgs/msg/JointState", message, START + step)
    encoder = open_log([path]).navigation(joint="slit").encoder
    assert encoder is not None
    assert encoder.angle.tolist() == [0, 1, 2]
    with pytest.raises(GarbiError) as error:
        open_log([path]).navigation(joint="laser_joint")
    one_line(error, "laser_joint", "slit, tail")


DVL_DEFINITION = """uint8 DVL_MODE_BOTTOM=1
std_msgs/Header header
uint8 velocity_mode
uint8 dvl_type
geometry_msgs/Vector3 velocity
float64[9] velocity_covar
float64 altitude
float64 course_gnd
float64 speed_gnd
float64 sound_speed
bool beam_ranges_valid
bool beam_velocities_valid
uint8 num_good_beams
geometry_msgs/Vector3[4] beam_unit_vec
float32[4] range
float32[4] range_covar
float32[4] beam_quality
float32[4] beam_velocity
float32[4] beam_velocity_covar
"""


def test_dvl_message_that_the_log_defines(tmp_path: Path) -> None:
    """marine_acoustic_msgs/msg/Dvl is read by the log's own definition; without bottom lock the row is NaN."""
    name = "marine_acoustic_msgs/msg/Dvl"
    with LogWriter(tmp_path / "log.mcap") as log:
        log.types.register(get_types_from_msg(DVL_DEFINITION, name))
        vector = log.types.types["geometry_msgs/msg/Vector3"]
        for step, (mode, valid) in enumerate([(1, True), (2, True), (1, False), (1, True)]):
            four = np.zeros(4, np.float32)
            message = log.types.types[name](
                header=log.header(START + step * STEP, "dvl_link"),
                velocity_mode=mode,
                dvl_type=0,
                velocity=vector(x=0.5, y=-0.25, z=float(step)),
                velocity_covar=np.arange(9.0),
                altitude=1.0,
                course_gnd=0.0,
                speed_gnd=0.0,
                sound_speed=1500.0,
                beam_ranges_valid=True,
                beam_velocities_valid=valid,
                num_good_beams=4,
                beam_unit_vec=[vector(x=0.0, y=0.0, z=1.0)] * 4,
                range=four,
                range_covar=four,
                beam_quality=four,
                beam_velocity=four,
                beam_velocity_covar=four,
            )
            log.write("/dvl/twist", name, message, START + step * STEP)
    dvl = open_log([tmp_path / "log.mcap"]).navigation().dvl
    assert dvl is not None
    np.testing.assert_array_equal(dvl.velocity[[0, 3]], [[0.5, -0.25, 0], [0.5, -0.25, 3]])
    assert np.isnan(dvl.velocity[1:3]).all()
    np.testing.assert_array_equal(dvl.covariance[0], np.arange(9.0).reshape(3, 3))


@pytest.mark.parametrize("definition", ["", "no such thing", "float64[999999999] velocity", "std_msgs/Header[9999] h"])
def test_hostile_definition(tmp_path: Path, definition: str) -> None:
    """A definition that is nonsense or would take all memory is refused in one line."""
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        schema = writer.register_schema("marine_acoustic_msgs/msg/Dvl", "ros2msg", definition.encode())
        writer.add_message(writer.register_channel("/dvl/twist", "cdr", schema), START, b"\0\1\0\0", START)
        writer.finish()
    log = open_log([tmp_path / "log.mcap"])
    if definition:
        with pytest.raises(GarbiError) as error:
            log.navigation()
        one_line(error, "marine_acoustic_msgs/msg/Dvl")
    else:
        assert log.navigation().dvl is None
        assert any("/dvl/twist: 1 message" in line for line in log.losses)
