"""The rig: camera, port and laser sheet, and what a pixel under the laser means in metres."""

from garbi_map.rig.camera import Camera
from garbi_map.rig.io import load_rig, parse_camera, parse_rig
from garbi_map.rig.laser import Laser
from garbi_map.rig.port import Port
from garbi_map.rig.rig import Rig, Triangulated
from garbi_map.rig.window import LaserWindow

__all__ = ["Camera", "Laser", "LaserWindow", "Port", "Rig", "Triangulated", "load_rig", "parse_camera", "parse_rig"]
