"""A LAZ 1.4 file whose chunks are the nodes of an octree: COPC 1.0, which a viewer opens without reading all of it.

Layout: https://copc.io, version 1.0.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.export.octree import SAMPLES, Cube, Key, nodes
from garbi_map.export.spool import Records, Spool

if TYPE_CHECKING:
    import laspy

POINT_BYTES = 200
"""Of memory for each point that is sorted at a time."""
_DEEPEST = 6
"""Halvings of the cube into parts, of which each is to have no more points than are sorted at a time."""
_BATCH = 64
"""Nodes that are compressed at a time."""
_BLOCK = 1_000_000
"""Records that are read at a time."""

_INFO, _HIERARCHY = 1, 1000
_ENTRY = struct.Struct("<iiiiQii")


def write_copc(path: Path, records: Spool, header: laspy.LasHeader, at_once: int) -> None:
    """Write records in whatever order as COPC; memory grows with their number up to so many `at_once` only.

    header: LAS 1.4 with format, scales, offsets and every VLR but those of COPC and LASzip.
    """
    import laspy
    import lazrs

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
        chunks = _chunks(records, cube, path.parent, at_once)
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


def _bounds(records: Spool, header: laspy.LasHeader) -> tuple[Cube, tuple[float, float]]:
    """The octree's cube, and the first and last time; the header gets its counts and bounds."""
    low, high = np.zeros((2, 3), np.int64)
    times = np.zeros(2)
    for number, block in enumerate(records.blocks(_BLOCK)):
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


def _chunks(records: Spool, cube: Cube, folder: Path, at_once: int) -> Iterator[tuple[Key, Records]]:
    """Each node with its records in the order of time; what does not fit into memory is sorted in a file in `folder`."""
    if len(records) <= at_once:
        yield from _nodes(records, cube, 0, [slice(0, len(records))])
        return
    level, parts = _parts(records, cube, at_once)
    with Spool(folder, records.dtype, len(records)) as divided:
        at = np.zeros(8**level, np.int64)
        at[list(parts)] = [part.start for part in parts.values()]
        for block in records.blocks(_BLOCK):
            place = cube.nodes_of(_steps(block), level)
            block = block[np.argsort(place, kind="stable")]
            count = np.bincount(place, minlength=len(at))
            end = np.cumsum(count)
            for one in np.flatnonzero(count).tolist():
                divided.put(at[one], block[end[one] - count[one] : end[one]])
            at += count
        yield from _nodes(divided, cube, level, list(parts.values()))


def _parts(records: Spool, cube: Cube, at_once: int) -> tuple[int, dict[int, slice]]:
    """The first level whose nodes have no more records than `at_once`; and where those of each are to be, by its number."""
    count = np.zeros(8**_DEEPEST, np.int64)
    for block in records.blocks(_BLOCK):
        count += np.bincount(cube.nodes_of(_steps(block), _DEEPEST), minlength=len(count))
    level = _DEEPEST
    while level > 1 and count.reshape(8 ** (level - 1), -1).sum(axis=1).max() <= at_once:
        level -= 1
    count = count.reshape(8**level, -1).sum(axis=1)
    end = np.cumsum(count)
    return level, {one: slice(int(end[one] - count[one]), int(end[one])) for one in np.flatnonzero(count).tolist()}


def _nodes(records: Spool, cube: Cube, level: int, parts: list[slice]) -> Iterator[tuple[Key, Records]]:
    """Of records that are sorted by the nodes of a level, each of which is a part."""
    above: dict[Key, list[Records]] = {}
    for part in parts:
        mine = records.read(part)
        for key, rows in nodes(cube.codes(_steps(mine)), level):
            if key[0] < level:  # other parts lie in it, too
                above.setdefault(key, []).append(mine[rows])
            else:
                yield key, _in_time(mine[rows])
    for key, chunks in above.items():
        yield key, _in_time(np.concatenate(chunks))


def _steps(records: Records) -> NDArray[np.int64]:
    """X, Y and Z (n, 3) as integers."""
    return np.stack([records[axis] for axis in "XYZ"], axis=1).astype(np.int64)


def _in_time(records: Records) -> Records:
    return records[np.argsort(records["gps_time"], kind="stable")]
