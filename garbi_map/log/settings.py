"""What the reader expects to find in a log."""

from pydantic import Field

from garbi_map.settings import Settings


class Topics(Settings):
    """Topic names of a log; an empty name says that the topic is to be ignored."""

    image: str = "/camera/image/compressed"
    camera_info: str = "/camera/camera_info"
    encoder: str = "/laser/joint_states"
    imu: str = "/imu/data"
    pressure: str = "/depth/pressure"
    dvl: str = "/dvl/twist"
    navsat: str = "/navsat/fix"
    usbl: str = "/usbl/pose"
    odometry: str = "/odometry/filtered"
    tf_static: str = "/tf_static"


class LogSettings(Settings):
    """How a log is read."""

    topics: Topics = Topics()
    base_frame: str = Field(default="base_link", description="the frame that mounts and odometry are of")
    clock_tolerance: float = Field(
        default=10.0, gt=0, description="s; a stamp farther from its arrival, usual clock offset removed, is wild"
    )
    reorder: float = Field(
        default=0.5, ge=0, description="s; messages whose stamps go back by less are sorted, by more left out"
    )
