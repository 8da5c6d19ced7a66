"""From a recorded dive with a camera and a swept laser sheet to a seabed map."""

__version__ = "0.1.0"
