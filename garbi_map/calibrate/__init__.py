"""Calibration of the camera and the laser sheet from targets, with what it does not know; files to files in run.py."""

from garbi_map.calibrate.camera import CameraCalibration, calibrate_camera
from garbi_map.calibrate.laser import LaserCalibration, calibrate_laser
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.sheet_models import compare_sheets
from garbi_map.calibrate.targets import load_target, parse_target

__all__ = [
    "CalibrateSettings",
    "CameraCalibration",
    "LaserCalibration",
    "calibrate_camera",
    "calibrate_laser",
    "compare_sheets",
    "load_target",
    "parse_target",
]
