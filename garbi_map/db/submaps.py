"""A submap: the accepted points of a few sweeps, immutable, in a frame of its own whose pose may still move."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.aside import make_folder, written_aside
from garbi_map.errors import GarbiError
from garbi_map.seabed import JudgedPoints, Points, SweptPoints

Floats = NDArray[np.float64]

STEP = 1e-5
"""m, of the quantised coordinates: int32 then reaches 21 km."""
INTENSITY_STEPS = 256
"""0..255 to the 16 bits that LAZ has, too."""


@dataclass(frozen=True)
class Pose:
    """Frame `map` <- frame of a submap: translation (3,) m, quaternion (4,) xyzw."""

    translation: Floats
    quaternion: Floats

    @property
    def rotation(self) -> Rotation:
        """The turn."""
        return Rotation.from_quat(self.quaternion)

    def apply(self, points: Floats) -> Floats:
        """Points (n, 3) of the submap, in `map`."""
        return points @ self.rotation.as_matrix().T + self.translation

    @classmethod
    def of(cls, transform: Floats, frame: Floats) -> Pose:
        """Of a submap whose frame's origin is `frame` (3,) in its dive, where a transform (4, 4) lays that dive."""
        turn = transform[:3, :3]
        return cls(turn @ frame + transform[:3, 3], Rotation.from_matrix(turn).as_quat(canonical=True))

    def after(self, transform: Floats) -> Pose:
        """This pose followed by a motion (4, 4) in `map`."""
        turn = Rotation.from_matrix(transform[:3, :3])
        return Pose(turn.apply(self.translation) + transform[:3, 3], (turn * self.rotation).as_quat(canonical=True))

    def transform(self, frame: Floats) -> Floats:
        """map <- dive (4, 4), for a submap whose frame's origin is `frame` (3,) in its dive."""
        out = np.eye(4)
        out[:3, :3] = self.rotation.as_matrix()
        out[:3, 3] = self.translation - out[:3, :3] @ frame
        return out


@dataclass(frozen=True)
class SubmapFile:
    """A submap as it was written: its name, its frame's origin (3,) m in the dive's frame, number of points, first and last
    stamp, ns. The axes of both frames are the same."""

    name: str
    frame: Floats
    points: int
    begin_ns: int
    end_ns: int

    @property
    def file(self) -> str:
        """Relative to the database."""
        return f"submaps/{self.name}.parquet"

    @property
    def moving(self) -> str:
        """The points that were seen through, likewise."""
        return f"moving/{self.name}.parquet"

    @property
    def files(self) -> tuple[str, str]:
        """All of it."""
        return self.file, self.moving


@dataclass(frozen=True)
class Submap:
    """n points of a few sweeps in the submap's frame, ordered by sweep, then by profile.

    points      (n, 3) float64 m, multiples of STEP
    origin      (n, 3) float64 m, where the camera was, likewise
    stamp_ns    (n,) int64 of each point's profile
    sweep       (n,) int32, number of the sweep in its dive
    sigma       (n,) float32, 1 sigma along the ray, m
    noise, pose (n,) float32, deviations of the elevation by the point's own error and by the pose's, m
    gradient    (n, 2) float32, slope of the surface along x and y
    intensity   (n,) float32, 0..255
    """

    points: Floats
    origin: Floats
    stamp_ns: NDArray[np.int64]
    sweep: NDArray[np.int32]
    sigma: NDArray[np.float32]
    noise: NDArray[np.float32]
    pose: NDArray[np.float32]
    gradient: NDArray[np.float32]
    intensity: NDArray[np.float32]

    def sweeps(self, pose: Pose) -> Iterator[JudgedPoints]:
        """The points of each sweep, in `map`."""
        placed, slope = _laid(tuple(self.points.T), tuple(self.gradient.T), 1.0, pose)
        cuts = np.flatnonzero(np.diff(self.sweep)) + 1
        for begin, end in zip(np.r_[0, cuts], np.r_[cuts, len(self.sweep)], strict=True):
            rows = slice(begin, end)
            yield JudgedPoints(
                self.stamp_ns[rows],
                placed[rows],
                self.sigma[rows],
                self.intensity[rows],
                np.zeros(end - begin, np.uint8),
                gradient=slope[rows].astype(np.float64),
                noise=self.noise[rows].astype(np.float64) ** 2,
                pose=self.pose[rows].astype(np.float64),
            )


def quantised(points: Floats, frame: Floats) -> NDArray[np.int32]:
    """Points (n, 3) m as steps from the frame's origin (3,)."""
    return np.rint((points - frame) / STEP).astype(np.int32)


def write_submap(database: Path, name: str, parts: list[tuple[int, JudgedPoints, Floats]]) -> SubmapFile:
    """Write sweeps (number, points in the dive's frame, camera's place (k, 3) at each point).

    The same sweeps give the same bytes. Raises GarbiError where they cannot be written.
    """

    def all_of(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(points, name) for _, points, _ in parts])

    points = all_of("points")
    frame = np.round(points.mean(axis=0)) if len(points) else np.zeros(3)
    place = quantised(points, frame)
    camera = quantised(np.concatenate([origin for _, _, origin in parts]), frame)
    gradient = all_of("gradient").astype(np.float32)
    columns: dict[str, NDArray[Any]] = {
        "x": place[:, 0], "y": place[:, 1], "z": place[:, 2],
        "camera_x": camera[:, 0], "camera_y": camera[:, 1], "camera_z": camera[:, 2],
        "stamp_ns": all_of("stamp_ns"),
        "sweep": np.repeat([index for index, _, _ in parts], [len(p.points) for _, p, _ in parts]).astype(np.int32),
        "sigma": all_of("sigma"),
        "noise": np.sqrt(all_of("noise")).astype(np.float32),
        "pose": all_of("pose").astype(np.float32),
        "slope_x": gradient[:, 0], "slope_y": gradient[:, 1],
        "intensity": _coarse_intensity(all_of("intensity")),
    }  # fmt: skip
    stamps = columns["stamp_ns"]
    written = SubmapFile(name, frame, len(place), int(stamps.min()), int(stamps.max()))
    _write_columns(database / written.file, columns)
    moving = [points.moving for _, points, _ in parts if points.moving is not None]
    _write_columns(database / written.moving, _moving_columns(moving, frame))
    return written


def _moving_columns(parts: list[Points], frame: Floats) -> dict[str, NDArray[Any]]:
    place = quantised(np.concatenate([part.points for part in parts] or [np.empty((0, 3))]), frame)
    empty: NDArray[Any] = np.empty(0)
    return {
        "x": place[:, 0], "y": place[:, 1], "z": place[:, 2],
        "stamp_ns": np.concatenate([part.stamp_ns for part in parts] or [empty]).astype(np.int64),
        "sigma": np.concatenate([part.sigma for part in parts] or [empty]).astype(np.float32),
        "intensity": _coarse_intensity(np.concatenate([part.intensity for part in parts] or [empty])),
    }  # fmt: skip


def _coarse_intensity(intensity: NDArray[Any]) -> NDArray[np.uint16]:
    return np.clip(intensity * INTENSITY_STEPS, 0, 65535).astype(np.uint16)


def _intensity(coarse: NDArray[np.uint16]) -> NDArray[np.float32]:
    return coarse.astype(np.float32) / np.float32(INTENSITY_STEPS)


def _write_columns(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    import pyarrow as pa

    about = {"unit": f"x, y, z and camera: {STEP:g} m; sigma, noise, pose: m; intensity: 1/{INTENSITY_STEPS}"}
    table = pa.table({name: np.ascontiguousarray(column) for name, column in columns.items()})
    write_parquet(path, table.replace_schema_metadata({"garbi": json.dumps(about)}))


def read_moving(path: Path, pose: Pose) -> Points:
    """What was seen through, in `map`. Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path)
    place = np.stack([table["x"], table["y"], table["z"]], axis=1) * STEP
    return Points(table["stamp_ns"], pose.apply(place), table["sigma"], _intensity(table["intensity"]))


def read_submap(path: Path) -> Submap:
    """Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path)

    def stacked(*names: str) -> NDArray[Any]:
        return np.stack([table[name] for name in names], axis=1)

    return Submap(
        stacked("x", "y", "z") * STEP,
        stacked("camera_x", "camera_y", "camera_z") * STEP,
        table["stamp_ns"],
        table["sweep"],
        table["sigma"],
        table["noise"],
        table["pose"],
        stacked("slope_x", "slope_y"),
        _intensity(table["intensity"]),
    )


def read_swept(path: Path, pose: Pose) -> SweptPoints:
    """Of a submap at its pose what is fused. Raises GarbiError where the file is missing or damaged."""
    table = read_parquet(path, ["x", "y", "z", "slope_x", "slope_y", "stamp_ns", "sweep", "noise", "pose", "intensity"])
    placed, gradient = _laid((table["x"], table["y"], table["z"]), (table["slope_x"], table["slope_y"]), STEP, pose)
    begins = np.flatnonzero(np.diff(table["sweep"], prepend=-1))
    return SweptPoints(
        placed,
        np.repeat(np.arange(len(begins), dtype=np.int32), np.diff(begins, append=len(placed))),
        table["stamp_ns"][begins] * 1e-9,
        gradient,
        table["noise"] ** 2,
        table["pose"],
        _intensity(table["intensity"]),
    )


def _laid(
    place: tuple[NDArray[Any], ...], slope: tuple[NDArray[Any], ...], step: float, pose: Pose
) -> tuple[Floats, NDArray[np.float32]]:
    from garbi_map.db import kernels

    placed, turned = kernels.lay(place, slope, step, pose.rotation.as_matrix(), pose.translation)
    return placed, turned


_REPEATED = ["camera_x", "camera_y", "camera_z", "stamp_ns", "sweep", "tile_a", "tile_b"]
"""Columns with the same value in many rows; for the others a dictionary would take time and save nothing."""


def write_parquet(path: Path, table: Any) -> None:
    """Aside, synced, renamed; with checksums; nothing in it depends on when it was written."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    make_folder(path.parent)
    with written_aside(path) as aside:
        try:
            pq.write_table(
                table,
                aside,
                compression="lz4",
                use_dictionary=[name for name in _REPEATED if name in table.column_names],
                write_statistics=False,
                write_page_checksum=True,
            )
        except pa.ArrowException as error:
            raise GarbiError(f"{path}: cannot be written: {error}") from error


def read_parquet(path: Path, columns: list[str] | None = None) -> dict[str, NDArray[Any]]:
    """These columns of a file, or all, checksums verified. Raises GarbiError where it is missing or damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path, columns=columns, page_checksum_verification=True)
        return {name: table[name].to_numpy() for name in table.column_names}
    except (OSError, pa.ArrowException) as error:
        why = " ".join(str(error).split())
        raise GarbiError(f"{path}: the map's database is damaged here ({why}); build the map anew elsewhere") from error
