"""Settings of the recorder."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from garbi_map.log.records import Mount
from garbi_map.settings import Settings

Seconds = Annotated[float, Field(ge=0, le=60)]


class Latency(Settings):
    """From the middle of a measurement to its stamp where the device gives one, to its earliest arrival where not, s."""

    camera: Seconds = 0.0
    encoder: Seconds = 0.0
    imu: Seconds = 0.0
    pressure: Seconds = 0.0
    dvl: Seconds = 0.0


class MountSettings(Settings):
    """Pose of a sensor's frame in base_link."""

    xyz: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="m")
    quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @field_validator("quaternion_xyzw")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        if not 0.99 < math.hypot(*value) < 1.01:
            raise ValueError("not a unit quaternion")
        return value

    def mount(self) -> Mount:
        """As the log has it."""
        return Mount(np.array(self.xyz), np.array(self.quaternion_xyzw))


class RecordSettings(Settings):
    """How a log is recorded; topics are those of `log.topics`."""

    jpeg_quality: int = Field(default=90, ge=1, le=100, description="of images that do not come as JPEG")
    jpeg_chroma: Literal["420", "422", "444"] = Field(default="422", description="how their colour is sampled")
    latency: Latency = Latency()
    mounts: dict[str, MountSettings] = Field(
        default={}, description="frames rig, imu_link, dvl_link, pressure_link in base_link, for /tf_static"
    )
    compression: Literal["zstd", "lz4", ""] = "lz4"
    backlog: int = Field(default=128, ge=1, le=65536, description="MB that wait at most while the disk stalls")
    flush: float = Field(default=0.25, gt=0, le=1, description="s; what is older survives the end of the process")
    sync: float = Field(default=0.5, gt=0, le=1, description="s; what is older, and flushed, survives a loss of power")
    disk_reserve: int = Field(default=64, ge=0, description="MB that are left free: the recording ends before")
    silent: float = Field(default=1.0, gt=0, description="s without a reading or an image are a fault")
    opening: float = Field(default=5.0, gt=0, description="s in which the first of them has to come")
    retry: tuple[float, float] = Field(default=(0.5, 8.0), description="first and longest wait before opening again, s")
    most_lines: int = Field(default=4000, ge=10, description="lines per second of one port; more are left out")
    look: float = Field(default=0.5, gt=0, description="s between two images that are looked at for the screen")
