"""A sweep as a point cloud that any tool opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.sweep.types import Sweep


def write_sweep(path: Path, sweep: Sweep) -> None:
    """LAZ in the rig frame, metres, scale 1e-5: intensity (256 times the stripe's), gps_time (the profile's stamp, s),
    extra dimensions `sigma` (m, along the ray) and `row`. Written aside, then renamed."""
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("sigma", "f4", "1 sigma along the ray, m"),
            laspy.ExtraBytesParams("row", "i4", "image row"),
        ]
    )
    header.scales = np.full(3, 1e-5)
    header.offsets = np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.xyz = sweep.points
    cloud.intensity = np.clip(np.round(sweep.intensity * 256.0), 0, 65535).astype(np.uint16)
    cloud.gps_time = sweep.point_stamp_ns * 1e-9
    cloud.sigma = sweep.sigma
    cloud.row = sweep.row
    aside = path.with_name(f".{path.name}")
    cloud.write(str(aside), do_compress=True)
    aside.replace(path)
