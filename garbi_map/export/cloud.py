"""The point cloud as LAZ."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np

from garbi_map.aside import written_aside
from garbi_map.errors import GarbiError
from garbi_map.export.georeference import Georeference
from garbi_map.export.spool import Spool
from garbi_map.seabed.types import Points

if TYPE_CHECKING:
    import laspy

_INTENSITY_STEPS = 256  # 0..255 to the 16 bits of LAS
OWN_RECORD = ("garbi", 1)
"""User and number of the record (JSON) that tells how to come from the file's coordinates back to `map`."""


class CloudWriter:
    """A context manager that writes points sweep by sweep into one LAZ 1.4 file, complete or absent.

    The file is a COPC as well: viewers that know COPC read what they show, all others read it as any LAZ. Point format 6:
    gps_time (the stamp of the profile as in trajectory.tum and the log, s since 1970), intensity (256 times the stripe's),
    extra dimension `sigma` (float32, m, 1 sigma). Points wait on disk, beside the file, until the last has come.

    Raises GarbiError where the file cannot be written.
    """

    def __init__(
        self, path: Path, scale: float = 1e-5, reference: Georeference | None = None, at_once: int = 4_000_000
    ) -> None:
        """at_once: points of which no more are sorted in memory, POINT_BYTES of copc.py each."""
        self.count = 0
        self._at_once = at_once
        self._path = path
        self._scale = scale
        self._reference = reference or Georeference()

    def __enter__(self) -> Self:
        self._header = self._made_header()
        with ExitStack() as stack:
            self._aside = stack.enter_context(written_aside(self._path))
            self._spool = stack.enter_context(Spool(self._path.parent, self._header.point_format.dtype()))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        from garbi_map.export.copc import write_copc

        if error is not None:
            return self._stack.__exit__(kind, error, trace)
        with self._stack:
            write_copc(self._aside, self._spool, self._header, self._at_once)
        return None

    def write(self, points: Points) -> None:
        """Append the points of a sweep."""
        if len(points.points) == 0:
            return
        own = self._reference
        if self.count == 0:
            self._header.offsets = np.floor(own.placed(points.points[:1])[0])
            self._header.creation_date = datetime.fromtimestamp(int(points.stamp_ns[0]) * 1e-9, UTC).date()
        record = np.zeros(len(points.points), self._header.point_format.dtype())
        # steps counted in float64 near zero: the offset takes the large part
        near = points.points * (own.scale, own.scale, 1.0) + (own.shift - self._header.offsets)
        record["X"], record["Y"], record["Z"] = np.rint(near / self._scale).astype(np.int32).T
        record["gps_time"] = points.stamp_ns * 1e-9
        record["intensity"] = np.clip(points.intensity * _INTENSITY_STEPS, 0, 65535).astype(np.uint16)
        record["sigma"] = points.sigma
        record["bit_fields"] = 1 | 1 << 4  # return 1 of 1
        self._spool.append(record)
        self.count += len(record)

    def _made_header(self) -> laspy.LasHeader:
        """All but the offset and the date, which are the first point's: the same points, the same bytes."""
        import laspy

        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, self._scale)
        header.offsets = np.zeros(3)
        header.generating_software = "garbi"
        header.creation_date = datetime.fromtimestamp(0, UTC).date()
        header.global_encoding.wkt = True
        header.add_extra_dim(laspy.ExtraBytesParams("sigma", "float32", description="m, 1 sigma along the ray"))
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(self._reference.wkt))
        own = json.dumps(self._reference.from_map()).encode()
        header.vlrs.append(laspy.VLR(*OWN_RECORD, "file to map frame, JSON", own))
        return header


def also_copc(path: Path) -> None:
    """Give cloud.laz the second name cloud.copc.laz, by which QGIS and PDAL know a COPC: a copy where links cannot be."""
    with written_aside(path.with_suffix(".copc.laz")) as aside:
        try:
            os.link(path, aside)
        except OSError:
            shutil.copyfile(path, aside)


def read_cloud(path: Path) -> np.ndarray:
    """The points (n, 3) of a LAS or LAZ file, m, in `map` where the file says how it lies in it. Raises GarbiError."""
    import laspy

    try:
        cloud = laspy.read(path)
        points = np.asarray(cloud.xyz, np.float64)
        user, number = OWN_RECORD
        for record in cloud.header.vlrs.get_by_id(user, (number,)):
            points = Georeference.from_dictionary(json.loads(record.record_data)).unplaced(points)
    except (OSError, laspy.LaspyException, ValueError, KeyError, TypeError) as error:
        raise GarbiError(f"{path}: cannot be read as LAZ: {' '.join(str(error).split())}") from error
    return points
