"""Where the vehicle was: filter, smoother, poses for every profile."""

from garbi_map.navigate.deskew import deskew, place
from garbi_map.navigate.gyro_attitude import GyroAttitude, gyro_attitude
from garbi_map.navigate.inertial import Inertial, prepare_inertial
from garbi_map.navigate.navigation import NavigationResult, navigate
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.trajectory import Trajectory

__all__ = [
    "GyroAttitude",
    "Inertial",
    "NavigateSettings",
    "NavigationResult",
    "Trajectory",
    "deskew",
    "gyro_attitude",
    "navigate",
    "place",
    "prepare_inertial",
]
