"""PCD files of the Point Cloud Library, version 0.7: ascii, binary and binary_compressed.

The format is described in the library's documentation, "The PCD (Point Cloud Data) file format".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from velocal.clouds import packed
from velocal.errors import RecordingError

#: First bytes; the comment may be missing.
MAGIC = (b"# .PCD", b"VERSION", b"FIELDS")
_TYPES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}
_DATA = ("ascii", "binary", "binary_compressed")
#: LZF unpacks three bytes to 264 at most.
_LZF_GAIN = 88


def blocks(path: Path) -> Iterator[dict[str, NDArray[Any]]]:
    """Read the points of a file, some at a time.

    Parameters
    ----------
    path : Path

    Yields
    ------
    dict of str to ndarray, shape (n,)
        By the names of the fields.

    Raises
    ------
    RecordingError
        If the header or the data are damaged, or do not agree.
    """
    where = str(path)
    with path.open("rb") as file:
        words = {line[0]: line[1:] for line in packed.header_lines(file, "DATA", where)}
        kind, points = _described(words, where)
        layout = words["DATA"][0] if words["DATA"] else ""
        if layout not in _DATA:
            raise RecordingError(f"DATA: {layout[:40]!r}", where=where, allowed=", ".join(_DATA))
        if layout == "ascii":
            yield packed.text_columns(file, kind, points, where)
        elif layout == "binary":
            for begin, count in packed.batches(file, kind, points, where):
                file.seek(begin)
                yield packed.columns_of(np.frombuffer(file.read(count * kind.itemsize), kind))
        else:
            yield _compressed(file, kind, points, where)


def comment(path: Path) -> str:
    """First line of a file, in which `velocal points` writes its facts."""
    with path.open("rb") as file:
        return file.readline(packed.HEADER_BYTES).decode("utf-8", "replace")


def _described(words: dict[str, list[str]], where: str) -> tuple[np.dtype[Any], int]:
    """Type of a point, and number of points."""
    names = words.get("FIELDS", [])
    sizes, types = words.get("SIZE", []), words.get("TYPE", [])
    counts = words.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(sizes) == len(types) == len(counts):
        raise RecordingError(
            f"FIELDS, SIZE, TYPE and COUNT have {len(names)}, {len(sizes)}, {len(types)} and "
            f"{len(counts)} entries",
            where=where,
            allowed="as many of each as there are fields",
        )
    for name, type_, size in zip(names, types, sizes, strict=True):
        if size not in _TYPES.get(type_, ()):
            raise RecordingError(
                f"field {name[:40]!r} is of type {type_[:10]!r} and size {size[:10]!r}",
                where=where,
                allowed="F of 4 or 8 bytes, I or U of 1, 2, 4 or 8 bytes",
            )
    kinds = [type_.lower() + size for type_, size in zip(types, sizes, strict=True)]
    times = [packed.number(text, "COUNT", where, least=1) for text in counts]
    kind = packed.row_type(names, kinds, times, "<", where)
    if "POINTS" in words:
        return kind, packed.number("".join(words["POINTS"][:1]), "POINTS", where)
    width, height = (
        packed.number("".join(words.get(name, [])[:1]), name, where) for name in ("WIDTH", "HEIGHT")
    )
    return kind, width * height


def _compressed(
    file: BinaryIO, kind: np.dtype[Any], points: int, where: str
) -> dict[str, NDArray[Any]]:
    """Fields one after the other, compressed together by LZF."""
    begin = file.tell()
    held = file.seek(0, 2) - begin
    file.seek(begin)
    head = file.read(8)
    small, large = struct.unpack("<II", head) if len(head) == 8 else (0, 0)
    if large != points * kind.itemsize or small > held - 8 or large > small * _LZF_GAIN:
        raise RecordingError(
            f"compressed data of {small} bytes for {large} bytes do not agree with the header and "
            "the length of the file",
            where=where,
            allowed=f"{points * kind.itemsize} bytes for {points} points, as its header states",
            hint="The file is cut or damaged. Copy or write it again.",
        )
    data = _lzf(file.read(small), large)
    if data is None:
        raise RecordingError("compressed data are damaged", where=where, hint="Copy it again.")
    found: dict[str, NDArray[Any]] = {}
    at = 0
    for name in kind.names or ():
        of_field = kind[name]
        if not of_field.shape:
            found[name] = np.frombuffer(data, of_field, points, at)
        at += points * of_field.itemsize
    return found


def _lzf(data: bytes, size: int) -> bytes | None:
    """Unpack LZF (Marc Lehmann): literal runs, and copies of what came before; None if damaged."""
    found = bytearray()
    at, end = 0, len(data)
    while at < end:
        control = data[at]
        at += 1
        if control < 32:
            found += data[at : at + control + 1]
            at += control + 1
        else:
            length = control >> 5
            if length == 7 and at < end:
                length += data[at]
                at += 1
            if at >= end:
                return None
            back = ((control & 31) << 8 | data[at]) + 1
            at += 1
            length += 2
            if back > len(found):
                return None
            piece = found[-back:]
            found += (piece * (length // back + 1))[:length] if back < length else piece[:length]
        if len(found) > size:
            return None
    return bytes(found) if len(found) == size and at == end else None
