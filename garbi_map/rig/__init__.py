"""The rig: camera, port and laser sheet, and what a pixel under the laser means in metres."""

from garbi_map.rig.camera import Camera
from garbi_map.rig.io import camera_entries, laser_entries, load_rig, parse_camera, parse_laser, parse_rig
from garbi_map.rig.laser import Laser
from garbi_map.rig.port import Port
from garbi_map.rig.rig import Rig, Triangulated
from garbi_map.rig.window import LaserWindow

__all__ = [
    "Camera",
    "Laser",
    "LaserWindow",
    "Port",
    "Rig",
    "Triangulated",
    "camera_entries",
    "laser_entries",
    "load_rig",
    "parse_camera",
    "parse_laser",
    "parse_rig",
]
