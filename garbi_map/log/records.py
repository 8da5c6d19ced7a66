"""What a log holds, as plain arrays. Stamps are the header's (the moment of measurement), int64 nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Image:
    """One recorded image as it was recorded, not decoded.

    stamp_ns    mid-exposure; arrival_ns: when the recorder had it
    encoding    "jpeg", "png" or a raw ROS encoding ("bgr8", "rgb8", "mono8", ...)
    data        the compressed file, or the raw rows
    height, width, step   of a raw image (pixels, pixels, bytes per row); 0 for a compressed one
    """

    stamp_ns: int
    arrival_ns: int
    encoding: str
    data: bytes | memoryview
    height: int = 0
    width: int = 0
    step: int = 0


@dataclass(frozen=True)
class Encoder:
    """Laser angle alpha: stamp_ns (n,), arrival_ns (n,), angle (n,) rad."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    angle: Floats


@dataclass(frozen=True)
class Imu:
    """Frame `imu_link`: rate (n, 3) rad/s, specific_force (n, 3) m/s^2, attitude (n, 4) xyzw ENU <- imu_link, NaN where
    the message has none; attitude_covariance (n, 3, 3) rad^2 as the message states it, which may be a lie."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    rate: Floats
    specific_force: Floats
    attitude: Floats
    attitude_covariance: Floats


@dataclass(frozen=True)
class Attitude:
    """Attitude (n, 4) xyzw ENU <- imu_link from a topic of its own."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    quaternion: Floats


@dataclass(frozen=True)
class Pressure:
    """Absolute pressure (n,) Pa at `pressure_link`."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    pressure: Floats


@dataclass(frozen=True)
class Dvl:
    """Bottom-track velocity (n, 3) m/s of and in `dvl_link`; NaN rows where the instrument says invalid.
    covariance (n, 3, 3) as the message states it."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    velocity: Floats
    covariance: Floats


@dataclass(frozen=True)
class Fixes:
    """Absolute positions (n, 3) m, local east-north-up about `origin` (lat deg, lon deg, height m; None when the source
    is already metric), with covariance (n, 3, 3)."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    position: Floats
    covariance: Floats
    origin: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Odometry:
    """Somebody else's trajectory: position (n, 3) m, quaternion (n, 4) xyzw of base_link in its own fixed frame."""

    stamp_ns: Stamps
    arrival_ns: Stamps
    position: Floats
    quaternion: Floats


@dataclass(frozen=True)
class Mount:
    """base_link <- sensor: translation (3,) m, quaternion (4,) xyzw."""

    translation: Floats = field(default_factory=lambda: np.zeros(3))
    quaternion: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


@dataclass(frozen=True)
class Navigation:
    """Everything in the log but the images; a sensor that the log does not have is None.

    mounts maps a frame ("rig", "imu_link", "dvl_link", "pressure_link") to its pose in base_link.
    """

    encoder: Encoder | None = None
    imu: Imu | None = None
    pressure: Pressure | None = None
    dvl: Dvl | None = None
    fixes: Fixes | None = None
    odometry: Odometry | None = None
    mounts: dict[str, Mount] = field(default_factory=dict)

    def mount(self, frame: str) -> Mount:
        """Pose of a frame in base_link; identity where /tf_static does not say."""
        return self.mounts.get(frame, Mount())

    def between(self, begin_ns: int, end_ns: int) -> Navigation:
        """What was measured from begin_ns to end_ns, both included."""
        cut: dict[str, Any] = {}
        for one in fields(self):
            record = getattr(self, one.name)
            if record is not None and one.name != "mounts":
                inside = (record.stamp_ns >= begin_ns) & (record.stamp_ns <= end_ns)
                columns = {name: value[inside] for name, value in vars(record).items() if isinstance(value, np.ndarray)}
                cut[one.name] = replace(record, **columns) if inside.any() else None
        return replace(self, **cut)
