"""What sensors said, from tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.importing.quantities import (
    DEPTH,
    ENCODER,
    EULER,
    FORCE,
    IMAGE,
    POSITION,
    PRESSURE,
    QUATERNION,
    RATE,
    VELOCITY,
)
from garbi_map.importing.table import Table, read_table
from garbi_map.log import Dvl, Encoder, Imu, Mount, Odometry, Pressure
from garbi_map.log.attitude import with_attitude
from garbi_map.log.navigation import pressure_at
from garbi_map.log.records import Attitude, Floats
from garbi_map.plain_yaml import read_yaml


def read_angles(path: Path) -> Table:
    """The table of angles: a time, an angle, and perhaps the image that it belongs to."""
    table = read_table(path, possible=[[ENCODER], [IMAGE]])
    if "angle" not in table.numbers and "image" not in table.texts:
        raise GarbiError(f"{path}: line 1: neither angles nor images; name a column angle_rad or angle_deg")
    return table


def encoder_of(table: Table) -> Encoder | None:
    """The laser's angle; None where the table has none."""
    angle = table.numbers.get("angle")
    return None if angle is None else Encoder(table.time, table.time, angle)


def read_imu(path: Path | None, attitude: Path | None) -> Imu | None:
    """Rates, forces and perhaps attitude, the latter from a table of its own where one is given."""
    imu = None
    if path is not None:
        table = read_table(path, [*RATE, *FORCE], [QUATERNION, EULER])
        turns = _turns(table)
        count = len(table.time)
        imu = Imu(
            table.time,
            table.time,
            np.stack([table.numbers[one.name] for one in RATE], axis=1),
            np.stack([table.numbers[one.name] for one in FORCE], axis=1),
            np.full((count, 4), np.nan) if turns is None else turns,
            np.zeros((count, 3, 3)),
        )
    if attitude is None:
        return imu
    table = read_table(attitude, possible=[QUATERNION, EULER])
    turns = _turns(table)
    if turns is None:
        raise GarbiError(
            f"{attitude}: line 1: no attitude; name columns qx, qy, qz, qw or roll_deg, pitch_deg, yaw_deg"
        )
    return with_attitude(imu, Attitude(table.time, table.time, turns))


def read_pressure(path: Path) -> Pressure:
    """A pressure or a depth."""
    table = read_table(path, possible=[[PRESSURE], [DEPTH]])
    if "pressure" in table.numbers:
        return Pressure(table.time, table.time, table.numbers["pressure"])
    if "depth" not in table.numbers:
        raise GarbiError(f"{path}: line 1: neither pressure nor depth; name a column pressure_pa or depth_m")
    return Pressure(table.time, table.time, pressure_at(table.numbers["depth"]))


def read_dvl(path: Path) -> Dvl:
    """Velocities in the frame of the DVL."""
    table = read_table(path, VELOCITY)
    velocity = np.stack([table.numbers[one.name] for one in VELOCITY], axis=1)
    return Dvl(table.time, table.time, velocity, np.zeros((len(velocity), 3, 3)))


def read_odometry(path: Path) -> Odometry:
    """Somebody else's trajectory of base_link."""
    table = read_table(path, POSITION, [QUATERNION, EULER])
    turns = _turns(table)
    if turns is None:
        raise GarbiError(f"{path}: line 1: no attitude; name columns qx, qy, qz, qw or roll_deg, pitch_deg, yaw_deg")
    return Odometry(table.time, table.time, np.stack([table.numbers[one.name] for one in POSITION], axis=1), turns)


def _turns(table: Table) -> Floats | None:
    """Attitudes (n, 4) xyzw; roll, pitch, yaw turn about x, then y, then z of the fixed frame."""
    quaternion, euler = table.stacked(QUATERNION), table.stacked(EULER)
    if quaternion is not None:
        length = np.linalg.norm(np.clip(quaternion, -2, 2), axis=1, keepdims=True)
        wrong = np.flatnonzero(~(np.abs(length[:, 0] - 1) < 0.1))
        if len(wrong):
            line = table.lines[wrong[0]]
            raise GarbiError(f"{table.path}: line {line}: qx, qy, qz, qw are no rotation, their length is not 1")
        return np.asarray(quaternion / length)
    if euler is None:
        return None
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", euler).as_quat()


def read_mount_file(path: Path) -> dict[str, Mount]:
    """Poses in base_link from YAML: `imu_link: {xyz: [0.1, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}`."""
    content = read_yaml(path)
    mounts = {}
    for frame, pose in content.items() if isinstance(content, dict) else ():
        try:
            translation = np.array(pose["xyz"], float)
            quaternion = np.array(pose.get("quaternion_xyzw", [0, 0, 0, 1]), float)
            length = np.linalg.norm(quaternion)
            if translation.shape != (3,) or quaternion.shape != (4,) or not abs(length - 1) < 0.1:
                raise ValueError
            if not np.isfinite(translation).all():
                raise ValueError
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            raise GarbiError(f"{path}: {frame}: give xyz: [x, y, z] in m and quaternion_xyzw: [x, y, z, w]") from error
        mounts[str(frame)] = Mount(translation, quaternion / length)
    if not mounts:
        raise GarbiError(f"{path}: no mounts; give frames such as imu_link: {{xyz: [0.1, 0, 0]}}")
    return mounts
