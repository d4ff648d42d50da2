"""What the help names, without importing the modules that hold it: these need NumPy.

A test compares each value with the one that it repeats.
"""

from __future__ import annotations

#: `velocal.scanner.models.SCANNERS`
SCANNERS = (
    "HDL-64E", "HDL-64E-S1", "HDL-64E-S3", "HDL-32E", "VLP-16", "VLP-16-Hi-Res", "VLP-32C",
    "VLS-128",
)  # fmt: skip
#: `velocal.calibration.dialects.DIALECTS`
DIALECTS = (
    "paper", "manual", "manual_s2", "ros", "libvelodyne", "veloview", "pcl", "mrpt",
    "velodyne_decoder",
)  # fmt: skip
#: `velocal.points.files.FORMATS`
SUFFIXES = (".ply", ".pcd", ".las", ".laz", ".parquet", ".mcap")
#: `velocal.calibration.convert.RANGES_M` and `RATE_HZ`
RANGES_M = (3.0, 10.0, 25.0, 80.0)
RATE_HZ = 10.0
