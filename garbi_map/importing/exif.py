"""The moment at which a photograph was taken, from the EXIF block of a JPEG or PNG file (CIPA DC-008)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone

EXIF_POINTER, ORIGINAL, SUBSECONDS, OFFSET = 0x8769, 0x9003, 0x9291, 0x9011
_MOST_ENTRIES = 1000


def taken_at(data: bytes) -> int | None:
    """DateTimeOriginal with its fraction and its time zone (UTC where it names none), ns since 1970; None: unknown."""
    try:
        block = _block(data)
        if block is None:
            return None
        order = {b"II*\0": "<", b"MM\0*": ">"}[block[:4]]
        tags = dict(_entries(block, order, struct.unpack_from(f"{order}I", block, 4)[0]))
        tags |= dict(_entries(block, order, int(tags[EXIF_POINTER]))) if EXIF_POINTER in tags else {}
        return _nanoseconds(str(tags[ORIGINAL]), str(tags.get(SUBSECONDS, "")), str(tags.get(OFFSET, "")))
    except (LookupError, ValueError, struct.error, OverflowError):
        return None


def _block(data: bytes) -> bytes | None:
    """The TIFF structure inside a file."""
    if data[:2] == b"\xff\xd8":
        place = 2
        while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != 0xDA:
            length = struct.unpack_from(">H", data, place + 2)[0]
            if data[place + 1] == 0xE1 and data[place + 4 : place + 10] == b"Exif\0\0":
                return data[place + 10 : place + 2 + length]
            place += 2 + length
    elif data[:8] == b"\x89PNG\r\n\x1a\n":
        place = 8
        while place + 8 <= len(data):
            length = struct.unpack_from(">I", data, place)[0]
            if data[place + 4 : place + 8] == b"eXIf":
                return data[place + 8 : place + 8 + length]
            place += 12 + length
    return None


def _entries(block: bytes, order: str, place: int) -> Iterator[tuple[int, str | int]]:
    """(tag, value) of the texts and whole numbers of a directory."""
    count = min(struct.unpack_from(f"{order}H", block, place)[0], _MOST_ENTRIES)
    for number in range(count):
        tag, kind, length = struct.unpack_from(f"{order}HHI", block, place + 2 + 12 * number)
        value = place + 10 + 12 * number
        if kind == 2:
            start = value if length <= 4 else struct.unpack_from(f"{order}I", block, value)[0]
            yield tag, block[start : start + length].rstrip(b"\0 ").decode("ascii", "replace")
        elif kind == 4 and length == 1:
            yield tag, struct.unpack_from(f"{order}I", block, value)[0]


def _nanoseconds(text: str, fraction: str, zone: str) -> int:
    moment = datetime.strptime(text, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    if zone:
        hours, minutes = int(zone[1:3]), int(zone[4:6])
        shift = timedelta(hours=hours, minutes=minutes) * (-1 if zone[0] == "-" else 1)
        moment = moment.replace(tzinfo=timezone(shift))
    digits = fraction.strip()[:9]
    return int(moment.timestamp()) * 10**9 + (int(digits.ljust(9, "0")) if digits else 0)
