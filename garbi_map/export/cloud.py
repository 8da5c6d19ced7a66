"""The point cloud as LAZ."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from garbi_map.aside import written_aside
from garbi_map.export.georeference import Georeference
from garbi_map.seabed.types import Points

_INTENSITY_STEPS = 256  # 0..255 to the 16 bits of LAS


class CloudWriter:
    """A context manager that writes points sweep by sweep into one LAZ 1.4 file, complete or absent.

    Point format 6: gps_time (the stamp of the profile as in trajectory.tum and the log, s since 1970), intensity
    (256 times the stripe's), extra dimension `sigma` (float32, m, 1 sigma). Memory is that of one sweep.

    Raises GarbiError where the file cannot be written.
    """

    def __init__(self, path: Path, scale: float = 1e-5, reference: Georeference | None = None) -> None:
        self.count = 0
        self._path = path
        self._scale = scale
        self._reference = reference or Georeference()
        self._stack = ExitStack()
        self._writer: Any = None

    def __enter__(self) -> Self:
        self._aside = self._stack.enter_context(written_aside(self._path))
        self._writer = None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is None and self._writer is None:
            self._open(np.zeros(3))
        if self._writer is not None:
            self._writer.close()
        return self._stack.__exit__(kind, error, trace)

    def write(self, points: Points) -> None:
        """Append the points of a sweep."""
        import laspy

        if len(points.points) == 0:
            return
        own = self._reference
        shift = np.array([own.easting, own.northing, own.height])
        if self._writer is None:
            self._open(np.floor(points.points[0] + shift))
        record = laspy.ScaleAwarePointRecord.zeros(len(points.points), header=self._header)
        # steps counted in float64 near zero: the offset takes the large part
        steps = np.rint((points.points + (shift - self._header.offsets)) / self._scale).astype(np.int32)
        record["X"], record["Y"], record["Z"] = steps.T
        record["gps_time"] = points.stamp_ns * 1e-9
        record["intensity"] = np.clip(points.intensity * _INTENSITY_STEPS, 0, 65535).astype(np.uint16)
        record["sigma"] = points.sigma
        record["return_number"][:] = 1
        record["number_of_returns"][:] = 1
        self._writer.write_points(record)
        self.count += len(points.points)

    def _open(self, offset: np.ndarray) -> None:
        import laspy

        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, self._scale)
        header.offsets = offset
        header.generating_software = "garbi"
        header.global_encoding.wkt = True
        header.add_extra_dim(laspy.ExtraBytesParams("sigma", "float32", description="m, 1 sigma along the ray"))
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(self._reference.wkt))
        self._header = header
        self._writer = laspy.open(self._aside, mode="w", header=header)
