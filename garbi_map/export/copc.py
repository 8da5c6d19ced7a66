"""A LAZ 1.4 file whose chunks are the nodes of an octree: COPC 1.0, which a viewer opens without reading all of it.

Layout: https://copc.io, version 1.0.
"""

from __future__ import annotations

import os
import struct
import tempfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.octree import SAMPLES, Cube, Key, nodes

if TYPE_CHECKING:
    import laspy

Records = NDArray[np.void]

AT_ONCE = 4_000_000
"""Points that are in memory at a time, 34 bytes each and as much again while they are sorted."""
_DEEPEST = 6
"""Halvings of the cube into parts, of which each is to have no more than AT_ONCE points."""
_BATCH = 64
"""Nodes that are compressed at a time."""
_BLOCK = 1_000_000
"""Records that are read at a time."""

_INFO, _HIERARCHY = 1, 1000
_ENTRY = struct.Struct("<iiiiQii")


def write_copc(path: Path, spool: IO[bytes], header: laspy.LasHeader) -> None:
    """Write the packed records of a file in whatever order as COPC; memory does not grow with their number.

    header: LAS 1.4 with format, scales, offsets and every VLR but those of COPC and LASzip.
    """
    import laspy
    import lazrs

    records = _mapped(spool, header.point_format.dtype())
    cube, times = _bounds(records, header)
    info = laspy.VLR("copc", _INFO, "COPC info", bytes(160))
    laz = lazrs.LazVlr.new_for_compression(header.point_format.id, header.point_format.num_extra_bytes, True)
    header.vlrs = [info, *header.vlrs, laspy.VLR("laszip encoded", 22204, "", bytes(laz.record_data()))]
    header.are_points_compressed = True
    keys, counts = [], []
    with path.open("wb+") as file:
        header.write_to(file)
        compressor = lazrs.ParLasZipCompressor(file, laz)
        compressor.reserve_offset_to_chunk_table()
        chunks = _chunks(records, cube, path.parent)
        while batch := list(islice(chunks, _BATCH)):
            keys += [key for key, _ in batch]
            counts += [len(chunk) for _, chunk in batch]
            compressor.compress_chunks([chunk.view(np.uint8) for _, chunk in batch])
        compressor.done()
        file.seek(header.offset_to_point_data)
        sizes = [size for _, size in lazrs.read_chunk_table(file, laz)] if keys else []
        begins = np.cumsum([header.offset_to_point_data + 8, *sizes]).tolist()
        page = b"".join(_ENTRY.pack(*key, *entry) for key, *entry in zip(keys, begins, sizes, counts, strict=False))
        header.start_of_first_evlr, header.number_of_evlrs = file.seek(0, os.SEEK_END), 1
        file.write(struct.pack("<H16sHQ32s", 0, b"copc", _HIERARCHY, len(page), b"COPC hierarchy"))
        info.record_data = _info(cube, header, file.tell(), len(page), times)
        file.write(page)
        file.seek(0)
        header.write_to(file, ensure_same_size=True)


def _info(cube: Cube, header: laspy.LasHeader, page: int, size: int, times: tuple[float, float]) -> bytes:
    """The info record: where the octree is, how dense, and where its hierarchy begins."""
    half = header.scales[0] * 2.0 ** (cube.bits - 1)
    centre = header.offsets + header.scales * cube.corner + half
    return struct.pack("<5d2Q2d88x", *centre, half, 2 * half / 2**SAMPLES, page, size, *times)


def _bounds(records: Records, header: laspy.LasHeader) -> tuple[Cube, tuple[float, float]]:
    """The octree's cube, and the first and last time; the header gets its counts and bounds."""
    low, high = np.zeros((2, 3), np.int64)
    times = np.zeros(2)
    for number, block in enumerate(_blocks(records)):
        steps, time = _steps(block), block["gps_time"]
        ends = steps.min(axis=0), steps.max(axis=0), np.array([time.min(), time.max()])
        if number == 0:
            low, high, times = ends
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
        times = np.array([min(times[0], ends[2][0]), max(times[1], ends[2][1])])
    header.point_count = len(records)
    header.number_of_points_by_return = np.array([len(records), *14 * [0]], np.uint64)
    header.mins, header.maxs = (steps * header.scales + header.offsets for steps in (low, high))
    return Cube.about(low, high), (float(times[0]), float(times[1]))


def _chunks(records: Records, cube: Cube, folder: Path) -> Iterator[tuple[Key, Records]]:
    """Each node with its records in the order of time; what does not fit into memory is sorted in a file in `folder`."""
    level, parts = 0, [slice(0, len(records))] if len(records) else []
    if len(records) > AT_ONCE:
        records, level, parts = _divided(records, cube, folder)
    above: dict[Key, list[Records]] = {}
    for part in parts:
        mine = np.array(records[part])
        for key, rows in nodes(cube.codes(_steps(mine)), level):
            if key[0] < level:  # other parts lie in it, too
                above.setdefault(key, []).append(mine[rows])
            else:
                yield key, _in_time(mine[rows])
    for key, chunks in above.items():
        yield key, _in_time(np.concatenate(chunks))


def _divided(records: Records, cube: Cube, folder: Path) -> tuple[Records, int, list[slice]]:
    """The records sorted on disk by the nodes of a level, that level, and where the records of each such node are."""
    count = np.zeros(8**_DEEPEST, np.int64)
    for block in _blocks(records):
        count += np.bincount(cube.nodes_of(_steps(block), _DEEPEST), minlength=len(count))
    level = _DEEPEST
    while level > 1 and count.reshape(8 ** (level - 1), -1).sum(axis=1).max() <= AT_ONCE:
        level -= 1
    count = count.reshape(8**level, -1).sum(axis=1)
    begin = np.cumsum(count) - count
    at = begin.copy()
    with tempfile.TemporaryFile(dir=folder) as file:
        out = _mapped(file, records.dtype, len(records))
    for block in _blocks(records):
        place = cube.nodes_of(_steps(block), level)
        order = np.argsort(place, kind="stable")
        mine = np.bincount(place, minlength=len(count))
        end = np.cumsum(mine)
        for one in np.flatnonzero(mine).tolist():
            out[at[one] : at[one] + mine[one]] = block[order[end[one] - mine[one] : end[one]]]
        at += mine
    return out, level, [slice(begin[one], begin[one] + count[one]) for one in np.flatnonzero(count)]


def _mapped(file: IO[bytes], dtype: np.dtype, count: int | None = None) -> Records:
    """The records of a file; with a count, of one that is made so long. Raises OSError where the disk is full."""
    if count is not None:  # a map onto a disk that turns out to be full would end the process
        os.posix_fallocate(file.fileno(), 0, count * dtype.itemsize)
    file.seek(0, os.SEEK_END)
    return np.memmap(file, dtype, "r+") if file.tell() else np.zeros(0, dtype)


def _blocks(records: Records) -> Iterator[Records]:
    for first in range(0, len(records), _BLOCK):
        yield records[first : first + _BLOCK]


def _steps(records: Records) -> NDArray[np.int64]:
    """X, Y and Z (n, 3) as integers."""
    return np.stack([records[axis] for axis in "XYZ"], axis=1).astype(np.int64)


def _in_time(records: Records) -> Records:
    return records[np.argsort(records["gps_time"], kind="stable")]
