"""The images of a folder, and when each was taken."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.importing.exif import taken_at
from garbi_map.importing.table import LAST_NS, Table
from garbi_map.log import Image

COMPRESSED = {".jpg", ".jpeg", ".png"}
SUFFIXES = COMPRESSED | {".bmp", ".tif", ".tiff", ".pgm", ".ppm"}
LARGEST = 1 << 28  # bytes of an image file
_EXIF_BYTES = 1 << 18  # of a file, in which its EXIF block lies

Way = Literal["csv", "rate", "exif", "mtime", "name-ns", "name-s"]
"""Where the stamps of images come from: the table that names them, the number in the file's name and a rate, EXIF data,
the file's time of change, or a time in the file's name."""


@dataclass(frozen=True)
class Picture:
    """An image file and its stamp, ns."""

    stamp_ns: int
    path: Path


def named_in(folder: Path, table: Table) -> tuple[list[Picture], list[str]]:
    """The images that a table names, with its times, and remarks. Raises GarbiError with the line of a bad name."""
    found = []
    for stamp, name, line in zip(table.time.tolist(), table.texts["image"], table.lines.tolist(), strict=True):
        where = f"{table.path}: line {line}"
        if Path(name).is_absolute() or ".." in Path(name).parts or "\0" in name:
            raise GarbiError(f"{where}: {name!r} leads out of the folder of images; give names inside {folder}")
        if not (folder / name).is_file():
            raise GarbiError(f"{where}: {folder / name} does not exist; correct the name or remove the line")
        found.append(Picture(stamp, folder / name))
    here = {picture.path.name for picture in found}
    others = sum(path.name not in here for path in _files(folder))
    return found, [f"{folder}: {others} images are not named in {table.path.name}, and left out"] if others else []


def stamped(folder: Path, way: Way, begin_ns: int, rate: float | None, offset_ns: int) -> tuple[list[Picture], str]:
    """The images of a folder in the order of their stamps, and where the stamps come from, in words.

    begin_ns: what the first image gets where there is only a rate. Raises GarbiError on an image without a stamp, on
    stamps that repeat, and on a folder without images.
    """
    files = _files(folder)
    if not files:
        raise GarbiError(f"{folder}: no images ({', '.join(sorted(SUFFIXES))})")
    if way == "rate":
        if rate is None:
            raise GarbiError("stamps from the numbers of files need --rate HZ")
        numbers = {path: _number(path) for path in files}
        first = min(numbers.values())
        stamps = {path: begin_ns + round((number - first) * 1e9 / rate) for path, number in numbers.items()}
        told = f"the number in each name at {rate:g} Hz, number {first} at {begin_ns * 1e-9:.3f} s"
    elif way == "exif":
        stamps, told = {path: _exif(path) for path in files}, "EXIF data"
    elif way == "mtime":
        stamps, told = {path: path.stat().st_mtime_ns for path in files}, "the time at which each file was changed"
    else:
        factor = 1 if way == "name-ns" else 10**9
        stamps, told = {path: _number(path) * factor for path in files}, f"the {way[5:]} in each name"
    pictures = sorted(
        (Picture(stamp + offset_ns, path) for path, stamp in stamps.items()), key=lambda one: one.stamp_ns
    )
    for before, after in pairwise(pictures):
        if before.stamp_ns == after.stamp_ns:
            raise GarbiError(
                f"{before.path.name} and {after.path.name} have the same stamp from {told}; choose --stamps"
            )
    for picture in (pictures[0], pictures[-1]):
        if not 0 <= picture.stamp_ns < LAST_NS:
            raise GarbiError(f"{picture.path}: a stamp of {picture.stamp_ns * 1e-9:g} s from {told} cannot be")
    return pictures, f"stamps of images: {told}" + (f", {offset_ns * 1e-9:+g} s" if offset_ns else "")


def read_pictures(pictures: list[Picture], losses: list[str]) -> Iterator[Image]:
    """The images: JPEG and PNG as they are, others raw, or as PNG where there are both, as a topic has one type. What
    is no image is named in `losses`."""
    raw = not any(picture.path.suffix.lower() in COMPRESSED for picture in pictures)
    for picture in pictures:
        if picture.path.stat().st_size > LARGEST:
            losses.append(f"{picture.path.name}: larger than {LARGEST >> 20} MB, left out")
            continue
        data = picture.path.read_bytes()
        image = _raw(picture.stamp_ns, data) if raw else _compressed(picture.stamp_ns, data)
        if image is None:
            losses.append(f"{picture.path.name}: not a readable image, left out")
        else:
            yield image


def _compressed(stamp: int, data: bytes) -> Image | None:
    if data[:2] == b"\xff\xd8":
        return Image(stamp, stamp, "jpeg", data)
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return Image(stamp, stamp, "png", data)
    import cv2

    pixels = _pixels(data)
    return None if pixels is None else Image(stamp, stamp, "png", cv2.imencode(".png", pixels)[1].tobytes())


def _raw(stamp: int, data: bytes) -> Image | None:
    pixels = _pixels(data)
    if pixels is None:
        return None
    height, width, *deep = pixels.shape
    encoding = {("uint8", 1): "mono8", ("uint16", 1): "mono16", ("uint8", 3): "bgr8"}.get(
        (str(pixels.dtype), deep[0] if deep else 1)
    )
    return (
        None if encoding is None else Image(stamp, stamp, encoding, pixels.tobytes(), height, width, pixels.strides[0])
    )


def _pixels(data: bytes) -> NDArray | None:
    import cv2

    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        return None


def _files(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    except OSError as error:
        raise GarbiError(f"{folder}: cannot be read: {error.strerror}") from error


def _number(path: Path) -> int:
    """The last number in a file's name."""
    numbers = re.findall(r"\d+", path.stem)
    if not numbers:
        raise GarbiError(f"{path}: no number in its name; choose another --stamps")
    return int(numbers[-1][:30])


def _exif(path: Path) -> int:
    with path.open("rb") as file:
        stamp = taken_at(file.read(_EXIF_BYTES))
    if stamp is None:
        raise GarbiError(f"{path}: no EXIF time in it; choose another --stamps")
    return stamp
