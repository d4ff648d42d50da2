"""PLY files (Stanford triangle format 1.0), as far as their first element is `vertex`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.clouds import packed
from velocal.errors import RecordingError

MAGIC = b"ply"
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}


def blocks(path: Path) -> Iterator[dict[str, NDArray[Any]]]:
    """Read the points of a file, some at a time; see `pcd.blocks`."""
    where = str(path)
    with path.open("rb") as file:
        lines = packed.header_lines(file, "end_header", where)
        layout = next((" ".join(line[1:2]) for line in lines if line[0] == "format"), "")
        if layout not in _ORDERS:
            raise RecordingError(
                f"format: {layout[:40]!r}", where=where, allowed=", ".join(_ORDERS)
            )
        kind, points = _described(lines, _ORDERS[layout], where)
        if layout == "ascii":
            yield packed.text_columns(file, kind, points, where)
            return
        for begin, count in packed.batches(file, kind, points, where):
            file.seek(begin)
            yield packed.columns_of(np.frombuffer(file.read(count * kind.itemsize), kind))


def comment(path: Path) -> str:
    """Comments of a file, in which `velocal points` writes its facts."""
    with path.open("rb") as file:
        lines = packed.header_lines(file, "end_header", str(path))
    return "\n".join(" ".join(line[1:]) for line in lines if line[0] == "comment")


def _described(lines: list[list[str]], order: str, where: str) -> tuple[np.dtype[Any], int]:
    """Type of a point, and number of points."""
    elements = [line for line in lines if line[0] == "element"]
    if not elements or elements[0][1:2] != ["vertex"] or len(elements[0]) != 3:
        raise RecordingError(
            "its first element is not 'vertex'",
            where=where,
            hint="Write the points as vertices, before all other elements.",
        )
    points = packed.number(elements[0][2], "element vertex", where)
    begin = lines.index(elements[0]) + 1
    end = lines.index(elements[1]) if len(elements) > 1 else len(lines)
    properties = [line for line in lines[begin:end] if line[0] == "property"]
    for line in properties:
        if len(line) != 3 or line[1] not in _TYPES:
            raise RecordingError(
                f"property {' '.join(line[1:])[:40]!r}",
                where=where,
                allowed=f"a name and one of {', '.join(_TYPES)}",
                hint="Properties of points that are lists are not read.",
            )
    names = [line[2] for line in properties]
    kinds = [_TYPES[line[1]] for line in properties]
    return packed.row_type(names, kinds, [1] * len(names), order, where), points
