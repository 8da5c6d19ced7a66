"""A small log with every topic, for the tests of the log room."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.log import Image, Log, LogWriter, Mount, Topics

START = 1_790_000_000_000_000_000
RIG = "camera: {}\nlaser: {}\n"


def jpeg_like(number: int, size: int = 3000) -> bytes:
    """Bytes that do not compress, as an image's do not."""
    return np.random.default_rng(number).bytes(size)


def write_sample(
    path: Path,
    seconds: float = 2.0,
    compression: Any = "zstd",
    chunk_size: int = 16_000,
    start: int = START,
    topics: Topics | None = None,
    raw: bool = False,
    skip: tuple[str, ...] = (),
) -> Path:
    """Images at 10 Hz, encoder and IMU at 50, pressure, DVL, USBL and odometry at 5; arrivals are 3 ms late."""
    late = 3_000_000
    with LogWriter(path, topics, compression=compression, chunk_size=chunk_size) as log:
        log.attach("rig.yaml", "application/yaml", RIG.encode())
        log.write_metadata("dive", {"place": "tank"})
        log.write_mounts(start, {"rig": Mount(np.array([0.2, 0.0, -0.1])), "imu_link": Mount(), "dvl_link": Mount()})
        for step in range(round(seconds * 50)):
            stamp = start + step * 20_000_000
            if "encoder" not in skip:
                log.write_encoder(stamp, 0.3 * np.sin(step * 0.1), stamp + late)
            if "imu" not in skip:
                log.write_imu(stamp, [0.1, 0, step], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3) * 1e-4, stamp + late)
            if step % 10 == 0 and "navigation" not in skip:
                log.write_pressure(stamp, 1e5 + step, stamp + late)
                log.write_dvl(stamp, [0.1, 0.2, step], np.eye(3) * 1e-5, stamp + late)
                log.write_usbl(stamp, [step, 1, 2], np.eye(3), stamp + late)
                log.write_odometry(stamp, [step, 0, 0], [0, 0, 0, 1], stamp + late)
            if step % 5 == 0 and "image" not in skip:
                if raw:
                    log.write_image(Image(stamp, stamp + late, "mono8", bytes(range(60)), 6, 10, 10))
                else:
                    log.write_image(Image(stamp, stamp + late, "jpeg", jpeg_like(step)))
    return path


def contents(log: Log) -> dict[str, dict[Any, bytes]]:
    """topic role -> stamp -> everything else of the record as bytes."""
    navigation = log.navigation()
    found: dict[str, dict[Any, bytes]] = {}
    for sensor in ("encoder", "imu", "pressure", "dvl", "fixes", "odometry"):
        record = getattr(navigation, sensor)
        if record is not None:
            arrays = [getattr(record, item.name) for item in fields(record)]
            columns = [np.ascontiguousarray(a) for a in arrays if isinstance(a, np.ndarray)]
            found[sensor] = {
                int(stamp): b"".join(column[row].tobytes() for column in columns)
                for row, stamp in enumerate(record.stamp_ns)
            }
    found["image"] = {
        image.stamp_ns: f"{image.arrival_ns} {image.encoding} ".encode() + bytes(image.data) for image in log.images()
    }
    found["mounts"] = {
        name: mount.translation.tobytes() + mount.quaternion.tobytes() for name, mount in navigation.mounts.items()
    }
    return found
