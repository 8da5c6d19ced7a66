"""The rig: camera, port and laser sheet, and what a pixel under the laser means in metres."""

from garbi_map.rig.camera import Camera
from garbi_map.rig.io import load_rig, parse_rig
from garbi_map.rig.laser import Laser
from garbi_map.rig.port import Port
from garbi_map.rig.rig import Rig, Triangulated

__all__ = ["Camera", "Laser", "Port", "Rig", "Triangulated", "load_rig", "parse_rig"]
