"""LAS and LAZ files; the laser is the extra dimension that `velocal points` writes, or a ring."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.clouds import packed
from velocal.errors import ConfigError, RecordingError

MAGIC = b"LASF"
#: Name under which `velocal points` keeps its facts among the records of variable length.
USER = "velocal"
#: LAS has intensities of 16 bits, of which those of the scanner are the upper eight.
INTENSITY_SCALE = 256


def blocks(path: Path) -> Iterator[dict[str, NDArray[Any]]]:
    """Read the points of a file, some at a time; see `pcd.blocks`."""
    with _opened(path) as reader:
        header = reader.header
        if not header.are_points_compressed:
            held = path.stat().st_size - int(header.offset_to_point_data)
            needed = int(header.point_count) * int(header.point_format.size)
            packed.check_size(int(header.point_count), needed, max(held, 0), str(path))
        extra = list(header.point_format.extra_dimension_names)
        for points in reader.chunk_iterator(packed.BATCH):
            columns = {axis: np.asarray(getattr(points, axis)) for axis in "xyz"}
            columns["intensity"] = np.asarray(points.intensity) // INTENSITY_SCALE
            if "gps_time" in header.point_format.dimension_names:
                columns["time"] = np.asarray(points.gps_time)
            yield columns | {name: np.asarray(points[name]) for name in extra}


def comment(path: Path) -> str:
    """Facts that `velocal points` has written; empty for files of other programs."""
    with _opened(path) as reader:
        for record in reader.header.vlrs:
            if record.user_id == USER:
                return bytes(record.record_data_bytes()).decode("utf-8", "replace")
    return ""


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Reader of the package laspy; its errors become ours."""
    try:
        laspy = importlib.import_module("laspy")
    except ImportError:
        raise ConfigError(
            "LAS needs the package laspy, which is not installed",
            where=str(path),
            allowed=".ply, .pcd, .parquet, .bin or a ROS bag",
            hint="Install it: pip install 'velocal[las]'",
        ) from None
    try:
        with laspy.open(path) as reader:
            yield reader
    except (ConfigError, RecordingError):
        raise
    except Exception as error:  # laspy raises what it meets in damaged files
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordingError(
            f"cannot be read as LAS: {reason}", where=str(path), hint="Copy it again."
        ) from None
