"""Intrinsic calibration of Velodyne multi-beam laser scanners against surveyed planes."""

from importlib.metadata import version

__version__ = version("velocal")
