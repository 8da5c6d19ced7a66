"""What the reader expects to find in a log."""

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
