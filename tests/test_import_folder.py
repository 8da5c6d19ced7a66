"""A folder of images and tables becomes the log that the recorder would have written."""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Garbi
from rigs import make_rig

from garbi_map.errors import GarbiError
from garbi_map.importing.exif import taken_at
from garbi_map.importing.images import stamped
from garbi_map.log import open_log
from garbi_map.stripe.decode import decode

START = 1_790_000_000_000_000_000


def jpeg(grey: int = 9, size: tuple[int, int] = (16, 24)) -> bytes:
    """A small JPEG file."""
    return cv2.imencode(".jpg", np.full((*size, 3), grey, np.uint8))[1].tobytes()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Ten images at 10 Hz, one a bitmap, and a table that names them."""
    images = tmp_path / "images"
    images.mkdir()
    rows = ["image,time_s,angle_deg"]
    for number in range(10):
        name = f"frame_{number:04d}.{'bmp' if number == 3 else 'jpg'}"
        if number == 3:
            cv2.imwrite(str(images / name), np.full((16, 24), 3, np.uint8))
        else:
            (images / name).write_bytes(jpeg(number))
        rows.append(f"{name},1790000000.{number}00000007,{number}")
    (tmp_path / "angles.csv").write_text("\n".join(rows) + "\n")
    return tmp_path


def test_images_named_by_the_table(folder: Path, garbi: Garbi) -> None:
    """Stamps to the nanosecond, JPEG untouched, a bitmap among them lossless, the rig attached, angles in radians."""
    (folder / "rig.yaml").write_text(make_rig().to_yaml())
    out = folder / "log.mcap"
    ended = garbi("import", folder / "images", folder / "angles.csv", "-o", out, "--rig", folder / "rig.yaml")
    assert (ended.status, ended.err) == (0, "")
    assert "stamps of images: angles.csv" in ended.out
    log = open_log([out])
    images = list(log.images())
    assert [image.stamp_ns for image in images] == [START + number * 10**8 + 7 for number in range(10)]
    assert [image.encoding for image in images] == ["jpeg"] * 3 + ["png"] + ["jpeg"] * 6
    assert bytes(images[4].data) == jpeg(4)
    np.testing.assert_array_equal(decode(images[3]), np.full((16, 24), 3))
    encoder = log.navigation().encoder
    assert encoder is not None
    np.testing.assert_allclose(encoder.angle, np.radians(np.arange(10)))
    assert log.rig_text is not None
    assert "stamps of images" in log.metadata["import"]["stamps"]


def test_bitmaps_alone_are_raw(folder: Path, garbi: Garbi) -> None:
    """Nothing is compressed where nothing was."""
    for path in (folder / "images").glob("*.jpg"):
        path.unlink()
    ended = garbi("import", folder / "images", folder / "angles.csv", "-o", folder / "log.mcap", "--rate", "10")
    assert ended.status == 0
    (image,) = open_log([folder / "log.mcap"]).images()
    assert (image.encoding, image.height, image.width, bytes(image.data)) == ("mono8", 16, 24, bytes([3]) * 16 * 24)


def test_every_table(folder: Path, garbi: Garbi) -> None:
    """IMU with a separate attitude, depth, velocities, odometry and mounts all arrive."""
    times = [1790000000 + 0.1 * number for number in range(10)]
    heads = {
        "imu": ("wx_rad_s,wy_rad_s,wz_rad_s,ax,ay,az", "0.1,0,0,0,0,9.8"),
        "attitude": ("qx,qy,qz,qw", "0,0,0,1"),
        "pressure": ("depth_m", "10"),
        "dvl": ("vx,vy,vz", "0.1,0.2,0.3"),
        "odometry": ("x,y,z,roll_deg,pitch_deg,yaw_deg", "1,2,3,0,0,90"),
    }
    options: list[object] = []
    for name, (head, row) in heads.items():
        path = folder / f"{name}.csv"
        path.write_text(f"time_s,{head}\n" + "".join(f"{time:.1f},{row}\n" for time in times))
        options += [f"--{name}", path]
    (folder / "mounts.yaml").write_text("dvl_link: {xyz: [0.1, 0, -0.2]}\n")
    ended = garbi("import", folder / "images", folder / "angles.csv", "-o", folder / "log.mcap", *options,
                  "--mounts", folder / "mounts.yaml")  # fmt: skip
    assert ended.status == 0, ended.err
    found = open_log([folder / "log.mcap"]).navigation()
    assert found.imu and found.pressure and found.dvl and found.odometry
    np.testing.assert_allclose(found.imu.attitude, [[0, 0, 0, 1]] * 10)
    np.testing.assert_allclose(found.pressure.pressure, 101325 + 1025 * 9.80665 * 10)
    np.testing.assert_allclose(found.dvl.velocity, [[0.1, 0.2, 0.3]] * 10)
    np.testing.assert_allclose(found.odometry.quaternion[0], [0, 0, 0.5**0.5, 0.5**0.5])
    np.testing.assert_allclose(found.mount("dvl_link").translation, [0.1, 0, -0.2])


def test_attitude_alone_is_kept(folder: Path, garbi: Garbi) -> None:
    """Without an IMU the attitude goes into the log, its rates not a number, and comes back out."""
    (folder / "a.csv").write_text("time_s,qx,qy,qz,qw\n1790000000,0,0,0,1\n1790000001,0,0,1,0\n")
    log = folder / "log.mcap"
    assert (
        garbi("import", folder / "images", folder / "angles.csv", "-o", log, "--attitude", folder / "a.csv").status == 0
    )
    found = open_log([log])
    imu = found.navigation().imu
    assert imu is not None
    np.testing.assert_array_equal(imu.attitude, [[0, 0, 0, 1], [0, 0, 1, 0]])
    assert np.isnan(imu.rate).all()
    assert found.losses == []


def test_stamps_from_files(folder: Path) -> None:
    """A counter and a rate keep the holes; times in names, times of change and EXIF are taken as they are."""
    images = folder / "images"
    (images / "frame_0005.jpg").unlink()
    found, told = stamped(images, "rate", START, 10.0, 0)
    assert [(one.stamp_ns - START) // 10**8 for one in found] == [0, 1, 2, 3, 4, 6, 7, 8, 9]
    assert "at 10 Hz, number 0" in told
    for number, path in enumerate(sorted(images.iterdir())):
        os.utime(path, ns=(START, START + number * 5))
    assert stamped(images, "mtime", 0, None, 3)[0][2].stamp_ns == START + 10 + 3
    with pytest.raises(GarbiError, match="no EXIF time"):
        stamped(images, "exif", 0, None, 0)
    for path in list(images.iterdir()):
        path.unlink()
    (images / f"{START + 7}.png").touch()
    (images / "cam0_12.jpg").touch()
    assert [one.stamp_ns for one in stamped(images, "name-ns", 0, None, 0)[0]] == [12, START + 7]
    (images / "b12.jpg").touch()
    with pytest.raises(GarbiError, match=r"b12\.jpg and cam0_12\.jpg have the same stamp"):
        stamped(images, "name-ns", 0, None, 0)


@pytest.mark.parametrize("order", ["<", ">"])
def test_exif(order: str) -> None:
    """Date, fraction and time zone, in either byte order."""
    texts = {0x9003: b"2026:09:21 14:13:20\0", 0x9291: b"25\0", 0x9011: b"+02:00\0"}
    directory = struct.pack(f"{order}H", len(texts))
    place = 26 + 2 + 12 * len(texts) + 4
    tail = b""
    for tag, text in texts.items():
        inline = len(text) <= 4
        value = text.ljust(4, b"\0") if inline else struct.pack(f"{order}I", place + len(tail))
        directory += struct.pack(f"{order}HHI", tag, 2, len(text)) + value
        tail += b"" if inline else text
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8)
    first = struct.pack(f"{order}H", 1) + struct.pack(f"{order}HHII", 0x8769, 4, 1, 26) + bytes(4)
    block = b"Exif\0\0" + head + first + directory + bytes(4) + tail
    file = b"\xff\xd8\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg()[2:]
    assert taken_at(file) == START - 7200 * 10**9 + 250_000_000  # 12:13:20.25 UTC
    for length in range(0, len(file) - 200, 7):
        taken_at(file[:length])  # cut anywhere: a moment or nothing


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("image,time_s,angle_deg\nnone.jpg,1,0\n", "line 2.*none.jpg does not exist; correct the name"),
        ("image,time_s,angle_deg\n../angles.csv,1,0\n", "line 2.*leads out of the folder"),
        ("time_s,angle_deg\n1,0\n", "names no images; say with --stamps or --rate"),
        ("time_s,depth_m\n1,0\n", "neither angles nor images"),
    ],
)
def test_tables_that_do_not_fit(folder: Path, garbi: Garbi, rows: str, told: str) -> None:
    """One line, and no log is left behind."""
    (folder / "angles.csv").write_text(rows)
    ended = garbi("import", folder / "images", folder / "angles.csv", "-o", folder / "log.mcap")
    assert ended.status == 1
    assert re.search(told, ended.err)
    assert ended.err.count("\n") == 1
    assert not (folder / "log.mcap").exists()


def test_times_that_have_nothing_in_common(folder: Path, garbi: Garbi) -> None:
    """Images of another day are told with both times."""
    ended = garbi("import", folder / "images", folder / "angles.csv", "-o", folder / "log.mcap", "--stamps", "mtime",
                  "--offset", "86400")  # fmt: skip
    assert ended.status == 1
    assert "--offset S" in ended.err


def test_what_is_no_image_is_named(folder: Path, garbi: Garbi) -> None:
    """A broken file costs itself; a log that exists is not written over."""
    (folder / "images" / "frame_0003.bmp").write_bytes(b"BM and nothing")
    arguments = ("import", folder / "images", folder / "angles.csv", "-o", folder / "log.mcap")
    ended = garbi(*arguments)
    assert ended.status == 3
    assert "frame_0003.bmp: not a readable image" in ended.err
    assert open_log([folder / "log.mcap"]).image_count == 9
    assert "exists already" in garbi(*arguments).err
