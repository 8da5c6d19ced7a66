"""A sweep as a point cloud that any tool opens."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garbi_map.aside import remove_leftovers, write_text, written_aside
from garbi_map.errors import GarbiError
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
    cloud.x, cloud.y, cloud.z = sweep.points.T
    cloud.intensity = np.clip(np.round(sweep.intensity * 256.0), 0, 65535).astype(np.uint16)
    cloud.gps_time = sweep.point_stamp_ns * 1e-9
    cloud.sigma = sweep.sigma
    cloud.row = sweep.row
    with written_aside(path) as aside:
        cloud.write(str(aside), do_compress=True)


def write_sweeps(folder: Path, sweeps: Iterable[Sweep]) -> int:
    """Write a cloud per sweep, `sweep_0000.laz` and so on, and at the end `sweeps.json`, which lists them; how many.

    Clouds of an earlier run that this one does not write again are removed.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GarbiError(f"{folder}: cannot be made a folder: {error.strerror}") from error
    remove_leftovers(folder)
    index = folder / "sweeps.json"
    index.unlink(missing_ok=True)
    entries: list[dict[str, str | int | float]] = []
    for sweep in sweeps:
        name = f"sweep_{sweep.index:04d}.laz"
        write_sweep(folder / name, sweep)
        entries.append(
            {
                "file": name,
                "begin_ns": int(sweep.stamp_ns[0]),
                "end_ns": int(sweep.stamp_ns[-1]),
                "profiles": len(sweep.stamp_ns),
                "points": len(sweep.points),
                "alpha_begin_rad": float(sweep.alpha[0]),
                "alpha_end_rad": float(sweep.alpha[-1]),
            }
        )
    written = {entry["file"] for entry in entries}
    for old in folder.glob("sweep_[0-9][0-9][0-9][0-9].laz"):
        if old.name not in written:
            old.unlink()
    if not entries:
        return 0
    write_text(index, json.dumps({"frame": "rig", "unit": "m", "sweeps": entries}, indent=1) + "\n")
    return len(entries)
