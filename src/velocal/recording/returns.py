"""Table of returns: the rotations that were asked for, decoded some thousand packets at a time.

Rows keep the order of the wire. The rows of one firing follow one another, as many as the
scanner has lasers in a firing (32, or 16 for a VLP-16). Of two returns of a shot one is chosen,
or both follow as they came.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import columns_of, rows_of
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.io import schemas, storage
from velocal.packets.dual import check_choice
from velocal.packets.firings import decode
from velocal.recording.rotation_index import RotationIndex
from velocal.recording.windows import read_rotations
from velocal.reduction.medians import medians_of
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner

#: Packets that are decoded together, and make one row group of the file whatever the container.
PACKETS = 6400

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Returns:
    """Returns of some rotations in raw ticks, a row each, in the order of the wire.

    Attributes
    ----------
    scanner : Scanner
    rotation_rate_hz : float
        Rate of all rotations that were asked for, see `RotationIndex.rate_for`.
    rotation : ndarray of uint32, shape (n,)
        Number of the rotation in the recording.
    timestamp : ndarray of uint32, shape (n,)
        Device clock of the packet, microseconds of the hour.
    azimuth : ndarray of uint16, shape (n,)
        Raw azimuth of the firing, 0.01 degree.
    laser_id : ndarray of uint8, shape (n,)
    distance : ndarray of uint16, shape (n,)
        Raw distance in ticks of `Scanner.distance_tick_m`; 0 where nothing came back.
    intensity : ndarray of uint8, shape (n,)
        Raw intensity.
    which : ndarray of uint8, shape (n,)
        `packets.dual.ONLY`, `STRONGEST` or `LAST`.
    """

    scanner: Scanner
    rotation_rate_hz: float
    rotation: NDArray[np.uint32]
    timestamp: NDArray[np.uint32]
    azimuth: NDArray[np.uint16]
    laser_id: NDArray[np.uint8]
    distance: NDArray[np.uint16]
    intensity: NDArray[np.uint8]
    which: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.laser_id)

    def __getitem__(self, rows: NDArray[np.generic] | slice) -> Returns:
        return rows_of(self, rows)

    @property
    def seen(self) -> Returns:
        """Only the rows where something came back."""
        return self[self.distance > 0]

    def beams(self, rotations: int | None = None) -> Beams:
        """Convert the shots where something came back.

        Parameters
        ----------
        rotations : int, optional
            How many of the rotations, from the first; all if left out.

        Returns
        -------
        Beams
            Distances in metres, rotational angles in radians, and lasers.
        """
        chosen = self.distance > 0
        if rotations is not None:
            chosen &= np.isin(self.rotation, np.unique(self.rotation)[:rotations])
        return Beams.from_ticks(self[chosen].columns(), self.scanner, self.rotation_rate_hz)

    def medians(self, *, azimuth_bin_deg: float | None = None, min_count: int = 5) -> Beams:
        """Reduce to medians per laser and azimuth bin.

        Parameters
        ----------
        azimuth_bin_deg : float, optional
            Width of an azimuth bin, degrees, a divisor of the turn; that of the scanner if left
            out.
        min_count : int
            Returns that a bin needs to give a median.

        Returns
        -------
        Beams
            Distances in metres, rotational angles in radians, and lasers.

        Raises
        ------
        VelocalError
            If the bins do not divide the turn.
        """
        bin_ticks = self.scanner.azimuth_bin(azimuth_bin_deg)
        reduced = medians_of(self.columns(), self.scanner, bin_ticks=bin_ticks, min_count=min_count)
        return Beams.from_ticks(asdict(reduced), self.scanner, self.rotation_rate_hz)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of `schemas.RETURNS`."""
        return {_COLUMN.get(name, name): values for name, values in columns_of(self).items()}


#: Columns of `schemas.RETURNS` whose name cannot be that of an attribute.
_COLUMN = {"which": "return"}


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

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `returns` is unknown.
    """
    rows = 0
    facts = table_facts(scanner, len(rotations), index.rate_for(scanner, rotations), returns)
    with storage.table_writer(path, schemas.RETURNS, **facts) as writer:
        for part in returns_of(
            recording, index, rotations, scanner, progress, returns=returns, source=source
        ):
            writer.write(part.columns())
            rows += len(part)
    return rows


def table_facts(scanner: Scanner, rotations: int, rate_hz: float, returns: str) -> dict[str, Any]:
    """Facts that are kept with a table of returns, and with their medians.

    Parameters
    ----------
    scanner : Scanner
    rotations : int
        Number of rotations.
    rate_hz : float
        Rotations in a second.
    returns : str
        Which returns these are, where a shot has two; "points" for those of a cloud.

    Returns
    -------
    dict of str to object
    """
    return {
        "scanner": scanner.name,
        "rotations": rotations,
        "rotation_rate_hz": rate_hz,
        "lasers_per_firing": scanner.lasers_per_firing,
        "distance_tick_m": scanner.distance_tick_m,
        "returns": returns,
    }


def returns_of(
    recording: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    scanner: Scanner,
    progress: Progress | None = None,
    *,
    returns: str = "strongest",
    source: SourceFilter = ANY_SOURCE,
) -> Iterator[Returns]:
    """Decode rotations of a recording, some thousand packets at a time.

    Parameters are those of `write_returns`.

    Yields
    ------
    part : Returns
        Consecutive rows.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `returns` is unknown.
    """
    check_choice(returns)
    rate_hz = index.rate_for(scanner, rotations)
    packets = 0
    parts = read_rotations(recording, index, rotations, source)
    for payloads, rotation in _evenly((chunk.payloads, of_block) for chunk, of_block in parts):
        firings = decode(payloads, scanner, returns)
        of_firing = rotation.reshape(-1)[firings.block]
        keep = of_firing >= 0
        if not keep.all():  # at the edges only; elsewhere a copy of everything is saved
            firings, of_firing = firings[keep], of_firing[keep]
        width = scanner.lasers_per_firing
        yield Returns(
            scanner=scanner,
            rotation_rate_hz=rate_hz,
            rotation=np.repeat(of_firing.astype(np.uint32), width),
            timestamp=np.repeat(firings.timestamp, width),
            azimuth=np.repeat(firings.azimuth, width),
            laser_id=firings.laser_id().reshape(-1),
            distance=firings.distance.reshape(-1),
            intensity=firings.intensity.reshape(-1),
            which=np.repeat(firings.which, width),
        )
        packets += len(payloads)
        if progress is not None:
            progress(packets)


_Part = tuple[NDArray[np.uint8], NDArray[np.int64]]


def _evenly(parts: Iterable[_Part]) -> Iterator[_Part]:
    """Payloads and rotations of their blocks, `PACKETS` at a time."""
    held: list[_Part] = []
    n = 0
    for payloads, rotation in parts:
        begin = 0
        while n + len(payloads) - begin >= PACKETS:
            end = begin + PACKETS - n
            held.append((payloads[begin:end], rotation[begin:end]))
            yield _joined(held)
            held, n, begin = [], 0, end
        if begin < len(payloads):
            held.append((payloads[begin:], rotation[begin:]))
            n += len(payloads) - begin
    if n:
        yield _joined(held)


def _joined(parts: list[_Part]) -> _Part:
    if len(parts) == 1:
        return parts[0]
    payloads, rotation = (np.concatenate(column) for column in zip(*parts, strict=True))
    return payloads, rotation
