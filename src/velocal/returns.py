"""Flat table of returns: the rotations that were asked for, decoded and streamed to Parquet.

Rows keep the order of the wire. The rows of one firing follow one another, as many as the
scanner has lasers in a firing (32, or 16 for a VLP-16).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal import schemas, storage
from velocal.packets import BLOCKS, decode
from velocal.recording.identify import check_scanner
from velocal.recording.rotations import Inspection, RotationIndex, inspect
from velocal.recording.windows import read_rotations
from velocal.sensors import Scanner

Progress = Callable[[int], None]


def write_returns(
    recording: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    scanner: Scanner,
    path: Path,
    progress: Progress | None = None,
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

    Returns
    -------
    int
        Number of rows.
    """
    rows = packets = 0
    facts: dict[str, Any] = {
        "scanner": scanner.name,
        "rotations": len(rotations),
        "rotation_rate_hz": index.rate_hz(rotations),
        "lasers_per_firing": scanner.lasers_per_firing,
    }
    with storage.table_writer(path, schemas.RETURNS, **facts) as writer:
        for chunk, rotation in read_rotations(recording, index, rotations):
            firings = decode(chunk.payloads, scanner)
            of_firing = np.repeat(rotation.reshape(-1), len(firings) // (len(rotation) * BLOCKS))
            keep = of_firing >= 0
            width = scanner.lasers_per_firing
            count = int(keep.sum())
            columns = {
                "rotation": np.repeat(of_firing[keep].astype(np.uint32), width),
                "timestamp": np.repeat(firings.timestamp[keep], width),
                "azimuth": np.repeat(firings.azimuth[keep], width),
                "laser_id": firings.laser_id()[keep].reshape(-1),
                "distance": firings.distance[keep].reshape(-1),
                "intensity": firings.intensity[keep].reshape(-1),
            }
            writer.write(columns)
            rows += count * width
            packets += len(chunk.payloads)
            if progress is not None:
                progress(packets)
    return rows


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
        Columns of `schemas.RETURNS`, all rotations, the cut ones as well.

    Raises
    ------
    RecordingError
        If there is no sound packet, or the recording comes from another scanner.
    """
    found = inspect(recording)
    remarks = check_scanner(found, scanner, str(recording))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "returns.parquet"
        write_returns(recording, found.index, np.arange(len(found.index)), scanner, path)
        columns, _ = storage.read_table(path, schemas.RETURNS)
    seen = columns["distance"] > 0
    return found, remarks, {name: column[seen] for name, column in columns.items()}
