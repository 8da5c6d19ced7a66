"""Several files and rosbag2 directories are one log; logs of other programs are read."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from sample_log import START, contents, jpeg_like, write_sample

from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter, open_log
from garbi_map.log.check import check_log
from garbi_map.log.types import standard_types

HALF = 10**9
PRESSURE = "sensor_msgs/msg/FluidPressure"


def write_bag(folder: Path, names: list[str], **extra: object) -> Path:
    """The metadata.yaml of a rosbag2 directory."""
    bag = {"version": 5, "storage_identifier": "mcap", "relative_file_paths": names, **extra}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": bag}))
    return folder


@pytest.fixture
def split(tmp_path: Path) -> tuple[Path, Path]:
    """A log in one file, and the same in a directory of three."""
    whole = write_sample(tmp_path / "whole.mcap")
    folder = tmp_path / "bag"
    folder.mkdir()
    with whole.open("rb") as file:
        messages = [(s, c, m) for s, c, m in make_reader(file).iter_messages(log_time_order=False)]
    for part in range(3):
        with (folder / f"bag_{part}.mcap").open("wb") as out:
            writer = Writer(out)
            writer.start("ros2")
            channels: dict[str, int] = {}
            for schema, channel, message in messages:
                assert schema
                if min((message.log_time - START) * 3 // (2 * HALF), 2) != part:
                    continue
                if channel.topic not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(
                    channels[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
                )
            writer.finish()
    return whole, folder


def test_directory_equals_single_file(split: tuple[Path, Path]) -> None:
    """A rosbag2 directory of three files holds what the one file held, wherever it was recorded."""
    whole, folder = split
    reference = contents(open_log([whole]))
    for prefix in ("", "/home/somebody/dives/bag/"):
        log = open_log([write_bag(folder, [f"{prefix}bag_{part}.mcap" for part in range(3)])])
        assert contents(log) == reference
        assert (log.image_count, log.topics["/imu/data"].count) == (20, 100)
        assert log.losses == []


def test_files_in_any_order(split: tuple[Path, Path]) -> None:
    """Files given one by one are read in the order of their begin."""
    whole, folder = split
    log = open_log([folder / "bag_2.mcap", folder / "bag_0.mcap", folder / "bag_1.mcap"])
    assert contents(log) == contents(open_log([whole]))
    assert (log.begin_ns, log.end_ns) == (START, START + 99 * 20_000_000)


def test_file_that_is_listed_but_missing(split: tuple[Path, Path]) -> None:
    """A directory that lost a file says which."""
    _, folder = split
    (folder / "bag_1.mcap").unlink()
    with pytest.raises(GarbiError, match=r"bag_1.mcap: listed in metadata.yaml but missing"):
        open_log([write_bag(folder, ["bag_0.mcap", "bag_1.mcap"])])


@pytest.mark.parametrize(
    ("extra", "told"), [({"storage_identifier": "other"}, "other"), ({"compression_mode": "FILE"}, "compressed")]
)
def test_bags_that_are_not_read(split: tuple[Path, Path], extra: dict, told: str) -> None:
    """Other storage, and files compressed as a whole, are refused with what to do."""
    with pytest.raises(GarbiError, match=f"{told}.*ros2 bag convert"):
        open_log([write_bag(split[1], ["bag_0.mcap"], **extra)])


def test_bag_of_another_program(tmp_path: Path) -> None:
    """A rosbag2 directory by the rosbags library: log_time is the time of reception, stamps are earlier."""
    types = standard_types()
    with (
        LogWriter(tmp_path / "unused.mcap") as headers,
        BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag,
    ):
        headers.write_encoder(START, 0.0)
        connection = bag.add_connection("/depth/pressure", PRESSURE, typestore=types)
        for step in range(50):
            stamp = START + step * 10**8
            message = types.types[PRESSURE](header=headers.header(stamp, "p"), fluid_pressure=1e5 + step, variance=0.0)
            bag.write(connection, stamp + 7_000_000, types.serialize_cdr(message, PRESSURE))
    log = open_log([tmp_path / "bag"])
    pressure = log.navigation().pressure
    assert pressure is not None
    np.testing.assert_array_equal(pressure.stamp_ns, START + np.arange(50) * 10**8)
    np.testing.assert_array_equal(pressure.arrival_ns - pressure.stamp_ns, 7_000_000)
    np.testing.assert_array_equal(pressure.pressure, 1e5 + np.arange(50))
    assert (log.begin_ns, log.end_ns) == (START, START + 49 * 10**8)


@pytest.mark.parametrize("offset", [-(10**18), 10**17])
def test_clocks_years_apart(tmp_path: Path, offset: int) -> None:
    """Stamps from a clock of their own are kept, and a window of time is in that clock."""
    path = tmp_path / "log.mcap"
    types = standard_types()
    with LogWriter(tmp_path / "unused.mcap") as headers, path.open("wb") as file:
        headers.write_encoder(START, 0.0)
        writer = Writer(file, chunk_size=2000)
        writer.start("ros2")
        schema = writer.register_schema(PRESSURE, "ros2msg", types.generate_msgdef(PRESSURE, ros_version=2)[0].encode())
        channel = writer.register_channel("/depth/pressure", "cdr", schema)
        for step in range(300):
            stamp = START + step * 10**9
            message = types.types[PRESSURE](header=headers.header(stamp, "p"), fluid_pressure=float(step), variance=0.0)
            received = stamp + offset + 5_000_000
            writer.add_message(channel, received, bytes(types.serialize_cdr(message, PRESSURE)), received)
        writer.finish()
    pressure = open_log([path]).navigation(START + 100 * 10**9, START + 110 * 10**9).pressure
    assert pressure is not None
    np.testing.assert_array_equal(pressure.pressure, np.arange(100, 110))


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"index_types": 0}, {"repeat_channels": False}])
def test_logs_without_this_or_that(tmp_path: Path, options: dict) -> None:
    """Without chunks, without an index or without topics in the summary: the same content."""
    whole = write_sample(tmp_path / "whole.mcap")
    if "index_types" in options:
        from mcap.writer import IndexType

        options = {"index_types": IndexType.NONE}
    with whole.open("rb") as file, (tmp_path / "bare.mcap").open("wb") as out:
        writer = Writer(out, **options)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(
                channels[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    log = open_log([tmp_path / "bare.mcap"])
    assert contents(log) == contents(open_log([whole]))
    assert log.losses == []
    assert check_log(log).checksums == options.get("use_chunking", True)


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Reading 40 MB of images and the navigation between them takes a few megabytes."""
    with LogWriter(tmp_path / "log.mcap") as writer:
        for step in range(400):
            writer.write_image(Image(START + step * 10**8, START + step * 10**8, "jpeg", jpeg_like(step, 100_000)))
            writer.write_encoder(START + step * 10**8, 0.1)
    tracemalloc.start()
    log = open_log([tmp_path / "log.mcap"])
    assert sum(len(image.data) for image in log.images()) == 40_000_000
    assert log.navigation().encoder is not None
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10_000_000


def test_whole_checksum_of_a_log_without_chunks(tmp_path: Path) -> None:
    """Messages outside of chunks are only protected as a whole: a flipped bit is told."""
    with (tmp_path / "log.mcap").open("wb") as out:
        writer = Writer(out, use_chunking=False, enable_data_crcs=True)
        writer.start("ros2")
        channel = writer.register_channel("/depth/pressure", "cdr", writer.register_schema(PRESSURE, "ros2msg", b""))
        for step in range(100):
            writer.add_message(channel, START + step, bytes(52), START + step)
        writer.finish()
    assert open_log([tmp_path / "log.mcap"]).losses == []
    data = bytearray((tmp_path / "log.mcap").read_bytes())
    data[data.index(bytes(52)) + 30] ^= 4
    (tmp_path / "log.mcap").write_bytes(data)
    (loss,) = open_log([tmp_path / "log.mcap"]).losses
    assert "checksum of the whole" in loss


@pytest.mark.parametrize(("dive", "seconds"), [("calm", 30), ("drift", 45), ("cheap", 30)])
def test_independent_dives(shared: Path, dive: str, seconds: int) -> None:
    """Logs of an independent simulator: counts, rates, lever arms, rig file."""
    folder = shared / "data" / "dives" / dive
    log = open_log([folder / "dive.mcap"])
    navigation = log.navigation()
    assert log.rig_text == (folder / "rig.yaml").read_text()
    assert log.image_count == 25 * seconds
    stamps = np.array([image.stamp_ns for image in log.images()])
    np.testing.assert_array_equal(np.diff(stamps), 40_000_000)
    assert navigation.encoder and navigation.imu and navigation.pressure and navigation.dvl
    for record, rate in (
        (navigation.encoder, 100),
        (navigation.imu, 100),
        (navigation.pressure, 10),
        (navigation.dvl, 8),
    ):
        assert len(record.stamp_ns) == rate * seconds
        np.testing.assert_allclose(np.diff(record.stamp_ns), 1e9 / rate, atol=1)
    np.testing.assert_allclose(np.linalg.norm(navigation.imu.attitude, axis=1), 1)
    np.testing.assert_allclose(navigation.imu.specific_force.mean(axis=0), [0, 0, 9.8], atol=0.5)
    np.testing.assert_allclose(navigation.mount("imu_link").translation, [-0.1, 0.02, 0.05])
    np.testing.assert_allclose(navigation.mount("dvl_link").translation, [-0.2, 0, -0.1])
    np.testing.assert_allclose(navigation.mount("pressure_link").translation, [0, 0, 0.1])
    np.testing.assert_allclose(navigation.mount("rig").translation, [0.25, 0, -0.1])
    assert log.losses == []
