"""LAS and LAZ files; the laser is the extra dimension that `velocal points` writes, or a ring."""

from __future__ import annotations

import importlib
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from velocal.clouds import packed
from velocal.errors import ConfigError, RecordingError

MAGIC = b"LASF"
#: Name under which `velocal points` keeps its facts among the records of variable length.
USER = "velocal"
#: LAS has intensities of 16 bits, of which those of the scanner are the upper eight.
INTENSITY_SCALE = 256
#: Sizes of the header of LAS 1.4 and of the heads of its records; bit of a compressed format.
_HEADER_BYTES, _RECORD_BYTES, _LATE_RECORD_BYTES, _COMPRESSED = 375, 54, 60, 0x80


def blocks(path: Path) -> Iterator[dict[str, NDArray[Any]]]:
    """Read the points of a file, some at a time; see `pcd.blocks`."""
    with _opened(path) as reader:
        header = reader.header
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
            hint="Install it: pip install 'laspy[lazrs]'",
        ) from None
    _check_header(path)
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


def _check_header(path: Path) -> None:
    """Refuse a header that announces more than the file can hold: laspy would count to its end.

    Places are those of the specification of LAS 1.4, table "Public Header Block".
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        head = file.read(_HEADER_BYTES).ljust(_HEADER_BYTES, b"\0")
        minor, (header, points_at, records) = head[25], struct.unpack_from("<HII", head, 94)
        late_at, late = struct.unpack_from("<QI", head, 235) if minor >= 4 else (0, 0)
        kind, row = head[104], struct.unpack_from("<H", head, 105)[0]
        count = struct.unpack_from("<Q", head, 247)[0] if minor >= 4 else 0
        count = count or struct.unpack_from("<I", head, 107)[0]
        held = size - points_at
        wrong = header > points_at or held < 0 or records * _RECORD_BYTES > points_at
        wrong |= late_at > size or late * _LATE_RECORD_BYTES > size - late_at
        if kind & _COMPRESSED:
            wrong |= not _chunks_fit(file, points_at, size)
        elif not wrong:
            packed.check_size(count, count * row, held, str(path))
    if wrong:
        raise RecordingError(
            "header announces more than the file holds",
            where=str(path),
            hint="The file is cut or damaged. Copy it again.",
        )


def _chunks_fit(file: BinaryIO, begin: int, size: int) -> bool:
    """Whether the table of the chunks of LAZ, before memory is allocated for it, can be there."""
    file.seek(begin)
    table = int.from_bytes(file.read(8), "little", signed=True)
    if table == -1 and size >= 8:  # its place stands at the end of the file
        file.seek(size - 8)
        table = int.from_bytes(file.read(8), "little", signed=True)
    if not begin < table <= size - 8:
        return False
    file.seek(table + 4)
    return int.from_bytes(file.read(4), "little") <= size
