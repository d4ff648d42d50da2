"""Rows of packed numbers: what binary PCD, PLY and PointCloud2 have in common."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from velocal.errors import RecordingError

#: Longest header, largest number of fields, and largest row that are read.
HEADER_BYTES, MOST_FIELDS, ROW_BYTES = 1 << 16, 256, 1 << 16
#: Points that are read together.
BATCH = 1 << 20


def row_type(
    names: list[str], kinds: list[str], counts: list[int], order: str, where: str
) -> np.dtype[Any]:
    """Type of a row of fields without gaps.

    Parameters
    ----------
    names, kinds, counts : list
        Of every field: its name, its type as numpy writes it ("f4"), and how many of them.
    order : {"<", ">"}
    where : str
        For errors.

    Returns
    -------
    dtype
        Structured. Of fields of one name only the first is accessible by it.

    Raises
    ------
    RecordingError
        If there are too many fields, or a row is too long.
    """
    seen: dict[str, int] = {}
    parts: list[Any] = []
    for name, kind, count in zip(names, kinds, counts, strict=True):
        seen[name] = seen.get(name, 0) + 1
        unique = name if seen[name] == 1 else f"{name} {seen[name]}"
        parts.append((unique, order + kind) if count == 1 else (unique, order + kind, (count,)))
    size = sum(int(kind[1:]) * count for kind, count in zip(kinds, counts, strict=True))
    if not 0 < len(parts) <= MOST_FIELDS or not 0 < size <= ROW_BYTES:
        raise RecordingError(
            f"header states {len(parts)} fields of {size} bytes",
            where=where,
            allowed=f"up to {MOST_FIELDS} fields and {ROW_BYTES} bytes",
        )
    try:
        return np.dtype(parts)
    except ValueError as error:  # such as two names that become one
        raise RecordingError(f"header cannot be used: {error}", where=where) from None


def columns_of(rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Fields with one number a point, by name."""
    return {name: rows[name] for name in rows.dtype.names or () if rows[name].ndim == 1}


def text_columns(
    file: BinaryIO, kind: np.dtype[Any], points: int, where: str
) -> dict[str, NDArray[Any]]:
    """Points as text, a line each.

    Parameters
    ----------
    file : BinaryIO
        At the first point.
    kind : dtype
        Of a point, if it were binary.
    points : int
    where : str

    Returns
    -------
    dict of str to ndarray, shape (n,)

    Raises
    ------
    RecordingError
        If the lines do not hold as many numbers as the header states.
    """
    names = kind.names or ()
    width = [int(np.prod(kind[name].shape, dtype=np.int64)) for name in names]
    begin = file.tell()
    # A number and the space behind it.
    check_size(points, points * 2 * sum(width) - 1, file.seek(0, 2) - begin, where)
    file.seek(begin)
    if points == 0:
        return {name: np.empty(0) for name in names}
    try:
        table = np.loadtxt(file, dtype=np.float64, comments=None, ndmin=2, max_rows=points)
    except ValueError as error:
        reason = str(error).partition(";")[0]
        raise RecordingError(f"points cannot be read: {reason}", where=where) from None
    if table.shape != (points, sum(width)):
        raise RecordingError(
            f"holds {len(table)} points of {table.shape[1]} numbers",
            where=where,
            allowed=f"{points} points of {sum(width)} numbers, as its header states",
        )
    first = np.cumsum([0, *width])
    found = {name: table[:, first[k]] for k, name in enumerate(names) if not kind[name].shape}
    # Whole numbers of time are nanoseconds, see `block`.
    return {
        name: values.astype(np.int64)
        if kind[name].kind in "iu" and (np.abs(values) < 2**62).all()
        else values
        for name, values in found.items()
    }


def check_size(points: int, least_bytes: int, held: int, where: str) -> None:
    """Refuse a header that announces more points than the file can hold, before they are read.

    Parameters
    ----------
    points : int
        Points that are announced.
    least_bytes : int
        Bytes that they need at least.
    held : int
        Bytes behind the header.
    where : str

    Raises
    ------
    RecordingError
    """
    if least_bytes > held:
        raise RecordingError(
            f"header announces {points} points, which need {least_bytes} bytes; {held} bytes follow"
            if points < 10**18
            else "header announces more points than any file holds",
            where=where,
            hint="The file is cut or damaged. Copy or write it again.",
        )


def batches(file: BinaryIO, kind: np.dtype[Any], points: int, where: str) -> list[tuple[int, int]]:
    """First byte and number of points of the parts that are read one after the other.

    Parameters
    ----------
    file : BinaryIO
        At the first point.
    kind : dtype
        Of a point.
    points : int
    where : str

    Returns
    -------
    list of (int, int)

    Raises
    ------
    RecordingError
        See `check_size`.
    """
    begin = file.tell()
    check_size(points, points * kind.itemsize, file.seek(0, 2) - begin, where)
    return [
        (begin + first * kind.itemsize, min(BATCH, points - first))
        for first in range(0, points, BATCH)
    ]


def number(text: str, name: str, where: str, *, least: int = 0) -> int:
    """Whole number out of a header.

    Raises
    ------
    RecordingError
        If it is none, or smaller than `least`.
    """
    # Longer ones are slow to convert, and mean nothing.
    if text.isascii() and text.isdigit() and len(text) <= 30 and int(text) >= least:
        return int(text)
    raise RecordingError(
        f"{name}: {text[:40]!r}", where=where, allowed=f"a whole number from {least} on"
    )


def header_lines(file: BinaryIO, last: str, where: str) -> list[list[str]]:
    """Words of the lines of a text header, up to and with the line that begins with a word.

    Parameters
    ----------
    file : BinaryIO
        Read up to the end of the header.
    last : str
        First word of its last line.
    where : str

    Returns
    -------
    list of list of str
        Without empty lines.

    Raises
    ------
    RecordingError
        If no such line is within `HEADER_BYTES`.
    """
    found: list[list[str]] = []
    while file.tell() < HEADER_BYTES:
        line = file.readline(HEADER_BYTES)
        if not line:
            break
        words = line.decode("utf-8", "replace").split()
        if words:
            found.append(words)
            if words[0] == last:
                return found
    raise RecordingError(
        f"has no line {last!r} in its header",
        where=where,
        hint="The file is cut or damaged, or of another kind.",
    )
