"""Inputs for the fuzzing of the parsers: valid ones, and what becomes of them."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.config import Config
from garbi_map.log import Image, LogWriter, Mount, chunks, open_log
from garbi_map.log.decode import IMAGE_TYPES
from garbi_map.log.types import standard_types
from garbi_map.record.lines import nmea

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
START = 1_790_000_000_000_000_000
WORDS = (
    0,
    1,
    2,
    7,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    1 << 40,
    (1 << 63) - 1,
    (1 << 64) - 1,
)
SCALARS = ("-1", "0", "1e308", ".nan", ".inf", "-.inf", "[]", "{}", "''", "null", "true", "0x7fffffffffffffff", "a b",
           "2001-01-01", "1:30", "!!binary aGk=", "&a [1]", "*a", "99999999999999999999", "[1, 2, 3]", "{a: 1}", "~", "é",
           "\"\\0\"")  # fmt: skip

NUMBERS = (
    "",
    "nan",
    "inf",
    "-1e999",
    "1e308",
    "0x10",
    "1_0",
    " 1",
    "--1",
    "9" * 400,
    "+",
    "1e",
    "\0",
    "{",
    "*",
    "$",
    "-0",
)
Random = np.random.Generator


def noise(random: Random) -> bytes:
    """Any bytes."""
    return random.bytes(int(random.integers(0, 400)))


def changed(data: bytes, random: Random) -> bytes:
    """Valid input with a few bytes, words or blocks changed, taken out or repeated."""
    found = bytearray(data)
    for _ in range(int(random.integers(1, 6))):
        if not found:
            break
        place, length = (int(n) for n in random.integers(0, len(found), 2))
        length = min(length, 64)
        kind = random.integers(6)
        if kind == 0:
            found[place] = int(random.integers(256))
        elif kind == 1:
            found[place] ^= 1 << int(random.integers(8))
        elif kind == 2:
            width = int(random.choice([2, 4, 8]))
            place -= place % 4
            word = WORDS[int(random.integers(len(WORDS)))] & ((1 << 8 * width) - 1)
            found[place : place + width] = word.to_bytes(width, "little")
        elif kind == 3:
            del found[place : place + length]
        elif kind == 4:
            found[place:place] = found[place : place + length]
        else:
            del found[place:]
    return bytes(found)


def edited(data: bytes, random: Random) -> bytes:
    """Valid text with values, lines and indentation changed."""
    lines = data.decode().splitlines()
    for _ in range(int(random.integers(1, 4))):
        if not lines:
            break
        place, other = (int(n) for n in random.integers(0, len(lines), 2))
        kind = random.integers(5)
        if kind == 0 and ":" in lines[place]:
            lines[place] = f"{lines[place].partition(':')[0]}: {SCALARS[int(random.integers(len(SCALARS)))]}"
        elif kind == 1:
            del lines[place]
        elif kind == 2:
            lines.insert(place, lines[other])
        elif kind == 3:
            lines[place] = " " * int(random.integers(4)) + lines[place].strip()
        else:
            return changed("\n".join(lines).encode(), random)
    return "\n".join(lines).encode()


def believed(random: Random, valid: list[bytes]) -> bytes:
    """A log whose checksums are right and whose records are nonsense."""
    records = b""
    for _ in range(int(random.integers(1, 12))):
        opcode = int(random.choice([1, 3, 4, 5, 5, 5, 6, 9, 12, 0x80, int(random.integers(256))]))
        content = valid[int(random.integers(len(valid)))][:200] if random.integers(2) else noise(random)
        if opcode == 5:
            content = struct.pack("<HIQQ", int(random.integers(12)), 0, START, START) + content
        stated = WORDS[int(random.integers(len(WORDS)))] if random.integers(10) == 0 else len(content)
        records += struct.pack("<BQ", opcode, stated) + content
    size = WORDS[int(random.integers(len(WORDS)))] if random.integers(10) == 0 else len(records)
    head = struct.pack("<QQQII", START, START, size, zlib.crc32(records), 0) + struct.pack("<Q", len(records))
    return (
        chunks.MAGIC
        + struct.pack("<BQ", 6, len(head) + len(records))
        + head
        + records
        + b"\x0f"
        + struct.pack("<QI", 4, 0)
    )


def small_log(folder: Path, compression: str) -> bytes:
    """A log of every topic in a few kilobytes."""
    path = folder / "small.mcap"
    with LogWriter(path, compression=compression, chunk_size=2_000) as log:  # type: ignore[arg-type]
        log.attach("rig.yaml", "application/yaml", b"camera: {}")
        log.write_metadata("dive", {"place": "tank"})
        log.write_mounts(START, {"rig": Mount(), "imu_link": Mount()})
        for step in range(12):
            stamp = START + step * 20_000_000
            log.write_image(Image(stamp, stamp, "jpeg", bytes(range(200))))
            log.write_encoder(stamp, 0.1 * step)
            log.write_imu(stamp, [0, 0, 0], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3))
            log.write_pressure(stamp, 1e5)
            log.write_dvl(stamp, [0, 0, 0])
            log.write_navsat(stamp, 41.0, 2.0, 0.0, np.eye(3))
            log.write_usbl(stamp, [0, 0, 0], np.eye(3))
            log.write_odometry(stamp, [0, 0, 0], [0, 0, 0, 1])
    return path.read_bytes()


def messages_of_every_type(folder: Path) -> dict[str, list[bytes]]:
    """type -> messages of it."""
    (folder / "m.mcap").write_bytes(small_log(folder, ""))
    log = open_log([folder / "m.mcap"])
    found: dict[str, list[bytes]] = {}
    for topic, raw in log.messages(set(log.topics)):
        found.setdefault(log.topics[topic].type, []).append(bytes(raw.data))
    return {name: messages[:3] for name, messages in found.items()}


def pictures() -> list[bytes]:
    """JPEG and PNG, colour and grey."""
    import cv2

    picture = (np.add.outer(np.arange(48), np.arange(64)) % 256).astype(np.uint8)
    coloured = np.dstack([picture, picture.T.copy().reshape(48, 64), picture])
    return [cv2.imencode(kind, one)[1].tobytes() for kind in (".jpg", ".png") for one in (picture, coloured)]


def raw_image() -> bytes:
    """A sensor_msgs/msg/Image."""
    types: Any = standard_types()
    time = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    header = types.types["std_msgs/msg/Header"](stamp=time, frame_id="c")
    data = np.arange(60, dtype=np.uint8)
    fields = {"height": 6, "width": 10, "encoding": "mono8", "is_bigendian": 0, "step": 10, "data": data}
    message = types.types[IMAGE_TYPES[1]](header=header, **fields)
    return bytes(types.serialize_cdr(message, IMAGE_TYPES[1]))


def plan() -> bytes:
    """Behaviours and what is expected of them, as the logs that come with the project carry them."""
    for log in sorted(SAMPLE.parent.glob("behaviour_*.mcap")):
        for record in open_log([log]).metadata.values():
            for text in record.values():
                if "expectations" in text:
                    return text.encode()
    return b"expectations:\n- stops: {within: 0.6}\n"


def targets() -> list[bytes]:
    """A target.yaml of each kind."""
    return [
        b"kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.03\n",
        b"kind: charuco\nsquares: [10, 7]\nsquare: 0.03\nmarker: 0.022\ndictionary: DICT_4X4_250\n",
        b"kind: apriltag\ntags: [5, 4]\ntag: 0.05\ngap: 0.015\nfamily: tag36h11\n",
        b"kind: two_planes\nsquares: [5, 4]\nsquare: 0.04\npitch: 0.07\nplanes:\n- origin: [-0.36, -0.16, 0]\n  u: [1, 0, 0]"
        b"\n  v: [0, 1, 0]\n- origin: [0, -0.16, -0.04]\n  u: [0, 0, -1]\n  v: [0, 1, 0]\n",
    ]


def configurations() -> list[bytes]:
    """A section each, as the whole takes long to parse."""
    import yaml

    whole = Config().model_dump(mode="json")
    return [
        yaml.safe_dump({name: section}, sort_keys=False).encode()
        for name, section in whole.items()
        if len(str(section)) < 1500
    ]


def camera_info() -> bytes:
    """A ROS camera_info file."""
    return (
        b"image_width: 768\nimage_height: 576\ncamera_name: c\ncamera_matrix:\n  data: [800, 0, 384, 0, 800, 288, 0, 0, 1]\n"
        b"distortion_model: plumb_bob\ndistortion_coefficients:\n  data: [0.1, 0, 0, 0, 0]\n"
    )


def tables() -> list[bytes]:
    """Comma-separated tables of every sensor that an import reads."""
    headings = (
        "time_s,angle_deg,image",
        "time_ns;angle_rad",
        "time_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,qx,qy,qz,qw",
        "time_s,depth_m",
        "time_s,velocity_x_m_s,velocity_y_m_s,velocity_z_m_s",
        "time_s\tx_m\ty_m\tz_m\troll_deg\tpitch_deg\tyaw_deg",
    )
    found = []
    for heading in headings:
        mark = next(mark for mark in ",;\t" if mark in heading)
        rows = [heading]
        for row in range(1, 6):
            cells = [str(row), *(["0", "0", "1", "0", "0", "0", "1", "0", "0", "1"][: heading.count(mark)])]
            if "qw" in heading:
                cells[-4:] = ["0", "0", "0", "1"]
            if "image" in heading:
                cells[-1] = f"{row}.png"
            rows.append(mark.join(cells))
        found.append("\n".join(rows).encode())
    return found


def mounts() -> bytes:
    """Where an import's sensors sit."""
    return b"rig: {xyz: [0.3, 0, -0.1]}\nimu_link:\n  xyz: [0.1, 0, 0]\n  quaternion_xyzw: [0, 0, 0, 1]\n"


BODIES = (
    "PGRB,ENC,12.3456,0.349066",
    "PGRB,IMU,12.3,0,0,0.01,0,0,9.81,0,0,0,1",
    "PGRB,PRS,,151325.0",
    "PGRB,DVL,1,0.2,0,-0.01,1e-4",
    "YXXDR,A,20.5,D,LASER",
    "YXXDR,P,1.5,B,DEPTH",
)


def sensor_lines() -> list[bytes]:
    """What encoders, IMUs, pressure sensors and DVLs send."""
    others = [
        b'{"sensor": "imu", "time": 12.35, "rate": [0, 0, 0.01], "force": [0, 0, 9.81], "attitude": [0, 0, 0, 1]}',
        b'{"sensor": "dvl", "time": 12.4, "velocity": [0.2, 0.0, -0.01], "variance": 1e-4}',
        b":BI,+100,-20,+3,+1,A",
    ]
    return [nmea(body).strip() for body in BODIES] + others


def summed(random: Random) -> bytes:
    """A sentence with fields of nonsense and the right checksum."""
    fields = BODIES[int(random.integers(len(BODIES)))].split(",")
    for _ in range(int(random.integers(1, 4))):
        fields[int(random.integers(len(fields)))] = NUMBERS[int(random.integers(len(NUMBERS)))]
    return nmea(",".join(fields)).strip()
