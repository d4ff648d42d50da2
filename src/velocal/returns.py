"""Flat table of returns: the rotations that were asked for, decoded and streamed to Parquet.

Rows keep the order of the wire. The rows of one firing follow one another, as many as the
scanner has lasers in a firing (32, or 16 for a VLP-16).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal import schemas, storage
from velocal.packets import BLOCKS, decode
from velocal.recording.rotations import RotationIndex
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
    rows = 0
    facts: dict[str, Any] = {
        "scanner": scanner.name,
        "rotations": len(rotations),
        "rotation_rate_hz": index.rate_hz(rotations),
        "lasers_per_firing": scanner.lasers_per_firing,
    }
    with storage.table_writer(path, schemas.RETURNS, **facts) as writer:
        for columns in returns_of(recording, index, rotations, scanner, progress):
            writer.write(columns)
            rows += len(columns["laser_id"])
    return rows


def returns_of(
    recording: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    scanner: Scanner,
    progress: Progress | None = None,
) -> Iterator[dict[str, NDArray[Any]]]:
    """Decode rotations of a recording, some thousand packets at a time.

    Parameters are those of `write_returns`.

    Yields
    ------
    dict of str to ndarray
        Columns of `schemas.RETURNS`.
    """
    packets = 0
    for chunk, rotation in read_rotations(recording, index, rotations):
        firings = decode(chunk.payloads, scanner)
        of_firing = np.repeat(rotation.reshape(-1), len(firings) // (len(rotation) * BLOCKS))
        keep = of_firing >= 0
        width = scanner.lasers_per_firing
        yield {
            "rotation": np.repeat(of_firing[keep].astype(np.uint32), width),
            "timestamp": np.repeat(firings.timestamp[keep], width),
            "azimuth": np.repeat(firings.azimuth[keep], width),
            "laser_id": firings.laser_id()[keep].reshape(-1),
            "distance": firings.distance[keep].reshape(-1),
            "intensity": firings.intensity[keep].reshape(-1),
        }
        packets += len(chunk.payloads)
        if progress is not None:
            progress(packets)
