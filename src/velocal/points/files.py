"""Files of points, streamed; they appear when they are finished."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from velocal import __version__
from velocal.clouds import las
from velocal.errors import ConfigError
from velocal.io import schemas, storage
from velocal.io.output import new_file
from velocal.points.bag import bag

#: One array per field, as `velocal.points.stream.stream` gives them.
Columns = Mapping[str, NDArray[Any]]
Write = Callable[[Columns], None]

#: Bytes of a text header, whatever the number of points that is entered at the end.
HEADER_BYTES = 1024
#: Resolution of coordinates in LAS, metres.
LAS_SCALE_M = 0.001
#: LAS must name the day it was made; the same input gives the same bytes on any day.
LAS_DAY = date(2000, 1, 1)

_PLY = {"f4": "float", "f8": "double", "u1": "uchar", "u4": "uint"}
_ROW = {field.name: np.dtype(field.type.to_pandas_dtype()).str[1:] for field in schemas.POINTS}


def fields(*, shift: bool) -> list[str]:
    """Names of the fields of a file of points, in their order.

    Parameters
    ----------
    shift : bool
        Whether the points have a shift.

    Returns
    -------
    list of str
    """
    return [name for name in _ROW if shift or name != "shift"]


@contextmanager
def _text_headed(
    path: Path,
    names: Sequence[str],
    facts: Mapping[str, Any],
    header: Callable[[Sequence[str], int, str], str],
) -> Iterator[Write]:
    """Rows of packed little-endian numbers behind a text header with their number in it.

    The header is written last, and padded within a comment so that its length is known before. The
    comment holds the facts as JSON.
    """
    told = json.dumps(facts)
    row = np.dtype([(name, "<" + _ROW[name]) for name in names])

    def head(points: int) -> bytes:
        pad = HEADER_BYTES - len(header(names, points, f"{told} "))
        return header(names, points, f"{told} {'.' * pad}").encode("ascii")

    points = 0
    with new_file(path) as file:

        def write(columns: Columns) -> None:
            nonlocal points
            rows = np.empty(len(columns["x"]), dtype=row)
            pairs = _pairs(columns)
            if pairs is not None:
                # Half as many numbers; a row has 26 bytes, to which numbers go one by one.
                np.ndarray(pairs.shape, pairs.dtype, rows, 0, rows.strides)[:] = pairs
            for name in names if pairs is None else names[2:]:
                rows[name] = np.ascontiguousarray(columns[name])
            # The memory itself: a copy of it as bytes takes longer than writing them.
            file.write(rows.view(np.uint8).data)
            points += len(rows)

        file.write(head(0))
        yield write
        file.seek(0)
        file.write(head(points))


def _pairs(columns: Columns) -> NDArray[np.uint64] | None:
    """X and Y of every point as one number, if they are the parts of one array."""
    x, y = columns["x"], columns["y"]
    both = x.base
    if both is None or both is not y.base or both.dtype != np.complex64 or sys.byteorder == "big":
        return None
    in_order = x.ctypes.data == both.ctypes.data == y.ctypes.data - 4
    return both.view(np.uint64) if in_order and x.shape == y.shape == both.shape else None


def _ply_header(names: Sequence[str], points: int, pad: str) -> str:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment velocal {__version__} {pad}",
        f"element vertex {points}",
        *(f"property {_PLY[_ROW[name]]} {name}" for name in names),
        "end_header",
    ]
    return "\n".join(lines) + "\n"


def _pcd_header(names: Sequence[str], points: int, pad: str) -> str:
    kinds = [_ROW[name] for name in names]
    lines = [
        f"# .PCD v0.7 - velocal {__version__} {pad}",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(kind[1:] for kind in kinds)}",
        f"TYPE {' '.join(kind[0].upper() for kind in kinds)}",
        f"COUNT {' '.join('1' for _ in kinds)}",
        f"WIDTH {points}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {points}",
        "DATA binary",
    ]
    return "\n".join(lines) + "\n"


def _ply(
    path: Path, names: Sequence[str], facts: Mapping[str, Any]
) -> AbstractContextManager[Write]:
    return _text_headed(path, names, facts, _ply_header)


def _pcd(
    path: Path, names: Sequence[str], facts: Mapping[str, Any]
) -> AbstractContextManager[Write]:
    return _text_headed(path, names, facts, _pcd_header)


@contextmanager
def _parquet(path: Path, names: Sequence[str], facts: Mapping[str, Any]) -> Iterator[Write]:
    schema = pa.schema(
        [schemas.POINTS.field(name) for name in names], metadata=schemas.POINTS.metadata
    )
    # Only intensities become smaller with a higher level: the last bytes of coordinates are noise,
    # and the other columns repeat themselves. A row group holds most of a rotation, so that only
    # two columns have least and largest values that tell a reader which groups it needs.
    settings = {
        "compression_level": {name: 1 if name == "intensity" else -1 for name in names},
        "compression": dict.fromkeys(names, "zstd"),
        "write_statistics": ["rotation", "time"],
        "write_batch_size": 1 << 16,
    }
    with storage.table_writer(path, schema, settings, **facts) as writer:
        yield writer.write


@contextmanager
def _las(path: Path, names: Sequence[str], facts: Mapping[str, Any]) -> Iterator[Write]:
    """LAS 1.4, point format 6; what LAS has no field for becomes an extra dimension."""
    laspy = _laspy(path)
    compress = path.suffix.lower() == ".laz"
    if compress and not laspy.LazBackend.detect_available():
        raise ConfigError(
            "LAZ needs the package lazrs, which is not installed",
            where=str(path),
            allowed=".las, which is not compressed",
            hint="Install it: pip install 'laspy[lazrs]'",
        )
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, LAS_SCALE_M), np.zeros(3)
    header.creation_date = LAS_DAY
    header.system_identifier = "velocal points"
    header.generating_software = f"velocal {__version__}"
    extra = [name for name in names if name in ("laser_id", "rotation", "shift")]
    header.add_extra_dims([laspy.ExtraBytesParams(name, _ROW[name]) for name in extra])
    told = laspy.VLR(las.USER, 1, "how the points were made", json.dumps(facts).encode("ascii"))
    header.vlrs.append(told)
    with new_file(path) as file:
        writer = laspy.open(file, mode="w", header=header, do_compress=compress, closefd=False)

        def write(columns: Columns) -> None:
            points = laspy.ScaleAwarePointRecord.zeros(len(columns["x"]), header=header)
            # Raw fields: setting scaled ones costs more than all the rest.
            raw = points.array
            for axis in ("x", "y", "z"):
                ticks = columns[axis].astype(np.float64) / LAS_SCALE_M
                raw[axis.upper()] = np.rint(ticks, out=ticks)
            raw["intensity"] = columns["intensity"].astype(np.uint16) * las.INTENSITY_SCALE
            raw["gps_time"] = columns["time"]
            points["return_number"][:] = points["number_of_returns"][:] = 1
            for name in extra:
                raw[name] = columns[name]
            writer.write_points(points)

        yield write
        writer.close()


def _laspy(path: Path) -> Any:
    try:
        import laspy
    except ImportError:
        raise ConfigError(
            f"{path.suffix} needs the package laspy, which is not installed",
            where=str(path),
            allowed=".ply, .pcd, .parquet, .mcap",
            hint="Install it: pip install 'laspy[lazrs]'",
        ) from None
    return laspy


#: By suffix.
FORMATS = {
    ".ply": _ply,
    ".pcd": _pcd,
    ".las": _las,
    ".laz": _las,
    ".parquet": _parquet,
    ".mcap": bag,
}


def cloud_writer(
    path: Path, *, shift: bool, facts: Mapping[str, Any]
) -> AbstractContextManager[Write]:
    """Open a file of points, in the format that its suffix names, for streaming.

    Parameters
    ----------
    path : Path
    shift : bool
        Whether the points have a shift.
    facts : mapping
        Plain values that are kept in the file, of which `velocal.clouds.origin.Origin` is read
        back: in the metadata of Parquet, a comment of PLY and PCD, a record of LAS.

    Returns
    -------
    context manager
        Gives a function that appends columns; the file takes its name when the block succeeds.

    Raises
    ------
    ConfigError
        If the suffix is unknown, or a package is missing that the format needs.
    """
    try:
        form = FORMATS[path.suffix.lower()]
    except KeyError:
        raise ConfigError(
            f"unknown suffix {path.suffix!r}", where=str(path), allowed=", ".join(FORMATS)
        ) from None
    return form(path, fields(shift=shift), facts)
