"""What the reader expects to find in a log."""

import math

from pydantic import Field, field_validator

from garbi_map.settings import Settings


class Topics(Settings):
    """Topic names of a log; an empty name says that the topic is to be ignored."""

    image: str = "/camera/image/compressed"
    camera_info: str = "/camera/camera_info"
    encoder: str = "/laser/joint_states"
    imu: str = "/imu/data"
    pressure: str = "/depth/pressure"
    depth: str = Field(default="", description="a depth, m, where there is no pressure")
    attitude: str = Field(default="", description="an attitude that is not in the messages of the IMU")
    dvl: str = "/dvl/twist"
    navsat: str = "/navsat/fix"
    usbl: str = "/usbl/pose"
    odometry: str = "/odometry/filtered"
    tf_static: str = "/tf_static"


class Frames(Settings):
    """What the log's static transforms call the frames that the map needs."""

    rig: str = "rig"
    imu_link: str = "imu_link"
    dvl_link: str = "dvl_link"
    pressure_link: str = "pressure_link"


class Scale(Settings):
    """What a topic's number is multiplied by to be SI; negative turns its direction round."""

    encoder: float = Field(default=1.0, description="rad per unit of the encoder; 0.017453292519943295 for degrees")
    pressure: float = Field(default=1.0, description="Pa per unit of the pressure; 100 for hPa and mbar")
    depth: float = Field(default=1.0, description="m down per unit of the depth; -1 where it counts upwards")

    @field_validator("encoder", "pressure", "depth")
    @classmethod
    def _is_a_scale(cls, value: float) -> float:
        if not math.isfinite(value) or value == 0:
            raise ValueError("must be a number other than zero")
        return value


class LogSettings(Settings):
    """How a log is read."""

    topics: Topics = Topics()
    frames: Frames = Frames()
    scale: Scale = Scale()
    base_frame: str = Field(default="base_link", description="the frame that mounts and odometry are of")
    clock_tolerance: float = Field(
        default=10.0, gt=0, description="s; a stamp farther from its arrival, usual clock offset removed, is wild"
    )
    reorder: float = Field(
        default=0.5, ge=0, description="s; messages whose stamps go back by less are sorted, by more left out"
    )
