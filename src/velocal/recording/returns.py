"""Flat table of returns: the rotations that were asked for, decoded and streamed to Parquet.

Rows keep the order of the wire. The rows of one firing follow one another, as many as the
scanner has lasers in a firing (32, or 16 for a VLP-16). Of two returns of a shot one is chosen,
or both follow as they came.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.io import schemas, storage
from velocal.packets.firings import decode
from velocal.recording.identify import check_scanner
from velocal.recording.inspection import Inspection
from velocal.recording.rotation_index import RotationIndex
from velocal.recording.scan import inspect
from velocal.recording.windows import read_rotations
from velocal.scanner.models import Scanner

#: Packets that are decoded together, and make one row group of the file whatever the container.
PACKETS = 6400

Progress = Callable[[int], None]


def write_returns(
    recording: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    scanner: Scanner,
    path: Path,
    progress: Progress | None = None,
    *,
    returns: str = "strongest",
    source: SourceFilter = ANY_SOURCE,
) -> int:
    """Decode rotations of a recording into a Parquet file of returns.

    Parameters
    ----------
    recording : Path
        Capture file.
    index : RotationIndex
        Of that file.
    rotations : ndarray of int64
        Rotations to decode.
    scanner : Scanner
        What sent the packets.
    path : Path
        Parquet file to write (`schemas.RETURNS`).
    progress : callable, optional
        Called with the number of packets decoded so far.
    returns : {"strongest", "last", "both"}
        Which return, where a shot has two. With both, a shot has two rows.
    source : SourceFilter
        Which of several scanners, as when it was indexed.

    Returns
    -------
    int
        Number of rows.
    """
    rows = 0
    facts: dict[str, Any] = {
        "scanner": scanner.name,
        "rotations": len(rotations),
        "rotation_rate_hz": index.rate_hz(rotations),
        "lasers_per_firing": scanner.lasers_per_firing,
        "distance_tick_m": scanner.distance_tick_m,
        "returns": returns,
    }
    with storage.table_writer(path, schemas.RETURNS, **facts) as writer:
        for columns in returns_of(
            recording, index, rotations, scanner, progress, returns=returns, source=source
        ):
            writer.write(columns)
            rows += len(columns["laser_id"])
    return rows


def returns_of(
    recording: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    scanner: Scanner,
    progress: Progress | None = None,
    *,
    returns: str = "strongest",
    source: SourceFilter = ANY_SOURCE,
) -> Iterator[dict[str, NDArray[Any]]]:
    """Decode rotations of a recording, some thousand packets at a time.

    Parameters are those of `write_returns`.

    Yields
    ------
    dict of str to ndarray
        Columns of `schemas.RETURNS`.
    """
    packets = 0
    parts = read_rotations(recording, index, rotations, source)
    for payloads, rotation in _evenly((chunk.payloads, of_block) for chunk, of_block in parts):
        firings = decode(payloads, scanner, returns)
        of_firing = rotation.reshape(-1)[firings.block]
        keep = of_firing >= 0
        width = scanner.lasers_per_firing
        yield {
            "rotation": np.repeat(of_firing[keep].astype(np.uint32), width),
            "timestamp": np.repeat(firings.timestamp[keep], width),
            "azimuth": np.repeat(firings.azimuth[keep], width),
            "laser_id": firings.laser_id()[keep].reshape(-1),
            "distance": firings.distance[keep].reshape(-1),
            "intensity": firings.intensity[keep].reshape(-1),
            "return": np.repeat(firings.which[keep], width),
        }
        packets += len(payloads)
        if progress is not None:
            progress(packets)


def read_short(
    recording: Path, scanner: Scanner
) -> tuple[Inspection, list[str], dict[str, NDArray[Any]]]:
    """Scan and decode a short recording at once; empty shots are left out.

    Returns
    -------
    inspection : Inspection
    remarks : list of str
        Of `check_scanner`.
    columns : dict of str to ndarray
        Columns of `schemas.RETURNS`, of all rotations.

    Raises
    ------
    RecordingError, ConfigError
        As `inspect` and `check_scanner`.
    """
    found = inspect(recording)
    remarks = check_scanner(found, scanner, str(recording))
    parts = list(returns_of(recording, found.index, np.arange(len(found.index)), scanner))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    seen = columns["distance"] > 0
    return found, remarks, {name: column[seen] for name, column in columns.items()}


_Part = tuple[NDArray[np.uint8], NDArray[np.int64]]


def _evenly(parts: Iterable[_Part]) -> Iterator[_Part]:
    """Payloads and rotations of their blocks, `PACKETS` at a time."""
    held: list[_Part] = []
    n = 0
    for part in parts:
        held.append(part)
        n += len(part[0])
        while n >= PACKETS:
            payloads, rotation = (np.concatenate(column) for column in zip(*held, strict=True))
            yield payloads[:PACKETS], rotation[:PACKETS]
            held, n = [(payloads[PACKETS:], rotation[PACKETS:])], n - PACKETS
    if n:
        payloads, rotation = (np.concatenate(column) for column in zip(*held, strict=True))
        yield payloads, rotation
