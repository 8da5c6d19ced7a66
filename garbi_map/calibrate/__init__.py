"""Calibration of the camera and the laser sheet, from targets, with what it does not know."""
