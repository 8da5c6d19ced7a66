"""Recorded logs: MCAP files and rosbag2 directories in, plain arrays and images out, and back."""

from garbi_map.log.open import open_log
from garbi_map.log.reader import Log, Topic
from garbi_map.log.records import Dvl, Encoder, Fixes, Image, Imu, Mount, Navigation, Odometry, Pressure
from garbi_map.log.settings import Frames, LogSettings, Scale, Topics
from garbi_map.log.writer import LogWriter

__all__ = [
    "Dvl",
    "Encoder",
    "Fixes",
    "Frames",
    "Image",
    "Imu",
    "Log",
    "LogSettings",
    "LogWriter",
    "Mount",
    "Navigation",
    "Odometry",
    "Pressure",
    "Scale",
    "Topic",
    "Topics",
    "open_log",
]
