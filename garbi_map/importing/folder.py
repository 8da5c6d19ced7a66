"""A folder of images and tables of what sensors said become a log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.importing import tables
from garbi_map.importing.images import Picture, Way, named_in, read_pictures, stamped
from garbi_map.importing.write import image_entries, navigation_entries, write_log
from garbi_map.log import Encoder, Navigation
from garbi_map.rig import Rig
from garbi_map.words import many


@dataclass(frozen=True)
class Tables:
    """Files with what sensors said; mounts: YAML."""

    angles: Path
    imu: Path | None = None
    attitude: Path | None = None
    pressure: Path | None = None
    dvl: Path | None = None
    odometry: Path | None = None
    mounts: Path | None = None


def import_folder(
    folder: Path,
    given: Tables,
    out: Path,
    rig: Rig | None = None,
    way: Way = "csv",
    rate: float | None = None,
    offset: float = 0.0,
) -> tuple[list[str], list[str]]:
    """Write a log; returns (remarks, what was left out), one line each.

    rate: Hz of the images where their stamps are counted; offset: s added to the stamps of images.
    Raises GarbiError on tables and images that cannot be used, and where their times have nothing in common.
    """
    angles = tables.read_angles(given.angles)
    encoder = tables.encoder_of(angles)
    begin, shift = int(angles.time[0]), round(offset * 1e9)
    if way != "csv":
        pictures, told = stamped(folder, way, begin, rate, shift)
        remarks = [told]
    elif "image" in angles.texts:
        pictures, remarks = named_in(folder, angles)
        pictures = [Picture(one.stamp_ns + shift, one.path) for one in pictures]
        remarks.insert(0, f"stamps of images: {given.angles.name}" + (f", {offset:+g} s" if offset else ""))
    else:
        raise GarbiError(f"{given.angles}: names no images; say with --stamps or --rate when each was taken")
    navigation = Navigation(
        encoder=encoder,
        imu=tables.read_imu(given.imu, given.attitude),
        pressure=tables.read_pressure(given.pressure) if given.pressure else None,
        dvl=tables.read_dvl(given.dvl) if given.dvl else None,
        odometry=tables.read_odometry(given.odometry) if given.odometry else None,
        mounts=tables.read_mount_file(given.mounts) if given.mounts else {},
    )
    _check_overlap(pictures, navigation.encoder, given.angles)
    losses: list[str] = []
    joint = rig.laser.joint if rig else "laser_joint"
    streams = [image_entries(read_pictures(pictures, losses)), *navigation_entries(navigation, joint)]
    about = {"source": folder.name, "stamps": remarks[0]}
    write_log(out, streams, navigation.mounts, rig.to_yaml() if rig else None, about)
    if rig is None:
        remarks.append("no rig file is attached: give one with --rig here, or to garbi map")
    return remarks, losses


def _check_overlap(pictures: list[Picture], encoder: Encoder | None, path: Path) -> None:
    if encoder is None:
        return
    stamps = np.array([picture.stamp_ns for picture in pictures])
    inside = np.count_nonzero((stamps >= encoder.stamp_ns[0]) & (stamps <= encoder.stamp_ns[-1]))
    if not inside:
        first, last = stamps.min() * 1e-9, stamps.max() * 1e-9
        begin, end = encoder.stamp_ns[0] * 1e-9, encoder.stamp_ns[-1] * 1e-9
        raise GarbiError(
            f"{path}: angles from {begin:.3f} to {end:.3f} s, but the {many(len(stamps), 'image')} from {first:.3f} to "
            f"{last:.3f} s; give --offset S or other --stamps"
        )
