"""A recording as one object: what it holds, which scanner made it, and its returns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import joined_rows
from velocal.capture.ledger import Ledger
from velocal.capture.reading import Progress, open_capture
from velocal.capture.source import SourceFilter
from velocal.errors import ConfigError
from velocal.packets.dual import check_choice
from velocal.packets.status import TrailingStatus
from velocal.recording.identify import identify
from velocal.recording.inspection import Inspection
from velocal.recording.motion import moved
from velocal.recording.returns import Returns, returns_of
from velocal.recording.rotation_index import RotationIndex
from velocal.recording.scan import inspect
from velocal.recording.windows import window_rotations
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner, scanner_named
from velocal.study.windows import MAX_MISSING

#: Complete rotations of a window, unless a caller says otherwise.
WINDOW_ROTATIONS = 100
WINDOWS = ("all", "beginning", "middle", "end")


class Recording:
    """A recording of one scanner; see `open_recording`.

    The file is scanned once, when something is asked for the first time. Returns are decoded from
    the file each time they are asked for, so that a recording of hours needs no more memory than
    one of minutes.

    Parameters
    ----------
    path : Path
        Capture file, or folder of a ROS 2 bag.
    source : SourceFilter
        Which of several scanners in the capture.
    stated : Scanner or None
        The scanner that is said to have made it; found from the packets if None.
    max_missing : float
        Largest share of its azimuth that a complete rotation may miss where packets are lost.

    Attributes
    ----------
    path : Path
    source : SourceFilter
    """

    def __init__(
        self,
        path: Path,
        source: SourceFilter,
        stated: Scanner | None = None,
        max_missing: float = MAX_MISSING,
    ) -> None:
        self.path = path
        self.source = source
        self._stated = stated
        self._max_missing = max_missing
        self._inspection: Inspection | None = None

    def __repr__(self) -> str:
        return f"Recording({str(self.path)!r})"

    def scan(self, progress: Progress | None = None) -> Inspection:
        """Scan the recording, unless that is done already.

        Parameters
        ----------
        progress : callable, optional
            Called with the bytes that are done and with all bytes.

        Returns
        -------
        Inspection
            Everything that the scan found.

        Raises
        ------
        RecordingError
            If the recording has not one valid data packet, or holds several scanners.
        """
        if self._inspection is None:
            self._inspection = inspect(
                self.path, progress, self.source, max_missing=self._max_missing
            )
        return self._inspection

    @property
    def ledger(self) -> Ledger:
        """What became of every byte."""
        return self.scan().ledger

    @property
    def rotations(self) -> RotationIndex:
        """Index of the rotations."""
        return self.scan().index

    @property
    def status(self) -> TrailingStatus:
        """What the trailing bytes say: temperature, time, embedded calibration (HDL-64E)."""
        return self.scan().status

    @property
    def scanner(self) -> Scanner:
        """The scanner that made the recording: the stated one, checked, or the one that fits best.

        Raises
        ------
        RecordingError
            If the recording cannot come from the stated scanner, or fits no known one.
        """
        return self._identified[0]

    @property
    def remarks(self) -> list[str]:
        """What is unusual in the recording for its scanner."""
        return self._identified[1]

    def motion_remarks(self) -> list[str]:
        """What tells that the scanner moved; see `moved`."""
        return moved(self.path, self.rotations, self.scanner, self.source)

    @cached_property
    def _identified(self) -> tuple[Scanner, list[str]]:
        """Scanner and remarks, see `identify`."""
        return identify(self.scan(), self._stated, str(self.path))

    def select(
        self, rotations: str | int | slice | Sequence[int] | NDArray[np.integer], length: int | None
    ) -> NDArray[np.int64]:
        """Numbers of the rotations that are meant.

        Parameters
        ----------
        rotations : str, int, slice or sequence of int
            "beginning", "middle" or "end" for a window of complete rotations, "all" for every
            rotation, also those that the recording cuts; or numbers of rotations from 0.
        length : int or None
            Rotations of a window; `WINDOW_ROTATIONS` if None.

        Returns
        -------
        ndarray of int64
            Ascending, each number once.

        Raises
        ------
        ConfigError
            If the window is unknown, the recording is too short for it, or a number is not one of
            a rotation.
        """
        where, n = str(self.path), len(self.rotations)
        if isinstance(rotations, str):
            if rotations not in WINDOWS:
                raise ConfigError(
                    f"unknown window {rotations!r}", where=where, allowed=", ".join(WINDOWS)
                )
            length = WINDOW_ROTATIONS if length is None else length
            return window_rotations(self.rotations, rotations, length, where)
        if isinstance(rotations, slice):
            chosen = np.arange(n)[rotations]
        else:
            chosen = np.unique(np.atleast_1d(np.asarray(rotations, dtype=np.int64)))
        outside = chosen[(chosen < 0) | (chosen >= n)]
        if len(outside) or len(chosen) == 0:
            what = f"rotation {outside[0]} does not exist" if len(outside) else "no rotation chosen"
            raise ConfigError(what, where=where, allowed=f"0 to {n - 1}")
        return np.sort(chosen)

    def returns(
        self,
        rotations: str | int | slice | Sequence[int] | NDArray[np.integer],
        *,
        length: int | None = None,
        which: str = "strongest",
    ) -> Returns:
        """Decode rotations; all their returns are in memory at once.

        Parameters
        ----------
        rotations, length
            See `select`.
        which : {"strongest", "last", "both"}
            Which return, where a shot has two. With both, a shot has two rows.

        Returns
        -------
        table : Returns
            Raw ticks; shots without a return have the distance 0.

        Raises
        ------
        RecordingError
            If the recording cannot be read, or its scanner is not what is said.
        ConfigError
            If rotations or `which` are unknown, see `select`.
        """
        return joined_rows(list(self.stream_returns(rotations, length=length, which=which)))

    def medians(
        self,
        rotations: str | int | slice | Sequence[int] | NDArray[np.integer],
        *,
        length: int | None = None,
        which: str = "strongest",
        azimuth_bin_deg: float | None = None,
        min_count: int = 5,
    ) -> Beams:
        """Medians of the distances of some rotations, per laser and azimuth bin.

        Parameters
        ----------
        rotations, length
            See `select`; usually a window such as "beginning".
        which : {"strongest", "last"}
            Which return, where a shot has two.
        azimuth_bin_deg, min_count
            See `Returns.medians`.

        Returns
        -------
        Beams
            Distances in metres, rotational angles in radians, and lasers.

        Raises
        ------
        RecordingError
            If the recording cannot be read, or its scanner is not what is said.
        ConfigError
            If rotations or `which` are unknown, see `select`.
        VelocalError
            If the bins do not divide the turn.
        """
        found = self.returns(rotations, length=length, which=which)
        return found.medians(azimuth_bin_deg=azimuth_bin_deg, min_count=min_count)

    def stream_returns(
        self,
        rotations: str | int | slice | Sequence[int] | NDArray[np.integer],
        *,
        length: int | None = None,
        which: str = "strongest",
    ) -> Iterator[Returns]:
        """Decode rotations, some thousand packets at a time.

        Parameters and errors are those of `returns`; errors come at once.

        Returns
        -------
        iterator of Returns
        """
        check_choice(which, "which")
        chosen = self.select(rotations, length)
        return returns_of(
            self.path, self.rotations, chosen, self.scanner, returns=which, source=self.source
        )


def open_recording(
    path: str | Path,
    scanner: str | Scanner | None = None,
    port: int | None = None,
    address: str | None = None,
    max_missing: float = MAX_MISSING,
) -> Recording:
    """Open a recording: records of 1206 or 1248 bytes, pcap, pcapng, gzipped or not, or a ROS bag.

    Only the beginning of the file is read.

    Parameters
    ----------
    path : str or Path
        Capture file, or folder of a ROS 2 bag.
    scanner : str or Scanner, optional
        The scanner that made it, such as "HDL-64E"; found from the packets if left out.
    port : int, optional
        UDP port to which the scanner sends, where a capture holds several scanners.
    address : str, optional
        IPv4 address from which it sends; in a bag, its topic.
    max_missing : float
        Largest share of its azimuth that a complete rotation may miss where packets are lost. Three
        lost packets are allowed as well, unless it is 0.

    Returns
    -------
    Recording

    Raises
    ------
    RecordingError
        If the file is missing, empty or of no known kind.
    ConfigError
        If no scanner of that name is known.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> len(recording.rotations), recording.ledger.unaccounted_bytes
    (12, 0)
    >>> returns = recording.returns("beginning", length=3)
    >>> len(returns) > len(returns.seen) > 0
    True
    """
    stated = scanner_named(scanner, where="scanner") if isinstance(scanner, str) else scanner
    capture = open_capture(Path(path), SourceFilter(port, address))
    return Recording(capture.path, SourceFilter(port, address), stated, max_missing)
