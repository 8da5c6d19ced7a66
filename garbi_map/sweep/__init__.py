"""From stripes and the encoder's counts to sweeps of points in the rig frame."""

from garbi_map.sweep.angle import Angle, FixedAngle, LaserAngle, laser_angle
from garbi_map.sweep.files import write_sweep, write_sweeps
from garbi_map.sweep.settings import SweepSettings
from garbi_map.sweep.sweeps import SweepLosses, make_sweeps
from garbi_map.sweep.types import Sweep

__all__ = [
    "Angle",
    "FixedAngle",
    "LaserAngle",
    "Sweep",
    "SweepLosses",
    "SweepSettings",
    "laser_angle",
    "make_sweeps",
    "write_sweep",
    "write_sweeps",
]
