"""Points of a recording with one calibration, and how far another one would shift each point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, joined_rows
from velocal.calibration.applied import applied
from velocal.calibration.files.document import CalibrationFile
from velocal.errors import ConfigError
from velocal.packets.data import BLOCKS, flags_and_azimuths, view
from velocal.packets.dual import ONLY, check_choice, dual_packets
from velocal.packets.firings import decode
from velocal.points.placing import FRAMES, Columns, Lasers, Settings, place
from velocal.recording import timing
from velocal.recording.inspection import Inspection
from velocal.recording.recording import Recording
from velocal.recording.returns import returns_of
from velocal.recording.windows import read_rotations
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters

#: Packets that are decoded together, and that are placed together: the arrays of points, which are
#: larger, stay in the processor's cache.
DECODED, PACKETS = 1024, 256
#: The device clock counts the seconds of an hour.
HOUR_S = 3600.0


class _Clock:
    """Seconds since the first packet, on the clock that the index of rotations goes by."""

    def __init__(self, inspection: Inspection, scanner: Scanner) -> None:
        self.kind, self.times = inspection.clock, inspection.index.time_s
        #: Blocks of a shot of all lasers, and time between packets, with one and with two returns.
        self.together = len(scanner.flags) * np.array([1, 2])
        self.interval_s = np.array([inspection.interval_for(scanner, two) for two in (False, True)])
        self.per_block = scanner.firings_per_block
        self.epoch: float | None = None
        jumps = inspection.clock_jumps or inspection.damaged_stamps
        self.steady = timing.Clock(inspection.clock) if jumps else None
        self.last, self.offset_s = -1, 0.0

    def packets(
        self,
        captured: Array | None,
        payloads: NDArray[np.uint8],
        rotation: NDArray[np.int64],
    ) -> Array:
        """Time of packets, shape (n,), of the given rotations; NaN without a clock."""
        stamps = view(payloads)["timestamp"]
        if self.steady is not None:
            return self._without_jumps(self.steady, captured, payloads, rotation)
        about = self.times[rotation]
        if self.kind == "device":
            clock = stamps * 1e-6
        elif self.kind == "capture" and captured is not None:
            clock = captured
        else:
            return np.full(len(stamps), np.nan)
        if self.epoch is None:
            # Reading begins with the packet in which a rotation does, whose time is known.
            self.epoch = float(clock[0] - about[0])
        since = clock - self.epoch
        if self.kind == "device":
            since += HOUR_S * np.rint((about - since) / HOUR_S)
        return np.asarray(since)

    def _without_jumps(
        self,
        clock: timing.Clock,
        captured: Array | None,
        payloads: NDArray[np.uint8],
        rotation: NDArray[np.int64],
    ) -> Array:
        """Time of packets of a recording whose clock jumps, counted from where rotations begin."""
        wire = view(payloads)
        flag, azimuth = flags_and_azimuths(wire)
        stamps, dual = np.ascontiguousarray(wire["timestamp"]), dual_packets(flag, azimuth)
        since, _ = clock.times(stamps, captured, azimuth, dual)
        begins = np.flatnonzero(np.diff(rotation, prepend=self.last))
        offsets = np.concatenate([[self.offset_s], self.times[rotation[begins]] - since[begins]])
        at = np.searchsorted(begins, np.arange(len(rotation)), side="right")
        self.last, self.offset_s = int(rotation[-1]), float(offsets[-1])
        return np.asarray(since + offsets[at])

    def firings(self, block: NDArray[np.int64], dual: NDArray[np.bool_]) -> Array:
        """Time from the stamp of its packet to every firing, shape (n,).

        By its block within the packet, and by whether the packet holds two returns of a shot.
        """
        together = self.together[:, None]
        shot = together * self.interval_s[:, None] / BLOCKS
        time_s = np.arange(BLOCKS) // together * shot
        kind = dual.astype(np.intp)
        found = time_s[kind, block]
        if self.per_block > 1:  # the later firings of a block follow the first
            later = np.flatnonzero(block[1:] == block[:-1]) + 1
            found[later] += shot[kind[later], 0] / self.per_block
        return np.asarray(found, dtype=np.float64)


def stream(
    recording: Path, inspection: Inspection, rotations: NDArray[np.int64], settings: Settings
) -> Iterator[tuple[Columns, int]]:
    """Points of some rotations of a recording, in the order of the wire.

    Memory does not depend on the length of the recording.

    Parameters
    ----------
    recording : Path
        Capture file.
    inspection : Inspection
        Of that file.
    rotations : ndarray of int64
        Rotations to use, ascending.
    settings : Settings

    Yields
    ------
    columns : dict of str to ndarray, shape (n,)
        ``x``, ``y``, ``z`` and ``shift`` in metres (float32; ``x`` and ``y`` are views of one
        array), ``intensity``, ``laser_id``, ``rotation``; ``time`` in seconds since the first
        packet of the recording, of the shot.
    packets : int
        Packets that they come from.
    """
    scanner = settings.scanner
    lasers = Lasers(settings, inspection.index.rate_for(scanner, rotations))
    clock = _Clock(inspection, scanner)
    index, source = inspection.index, settings.source
    for chunk, rotation_of_block in read_rotations(recording, index, rotations, source):
        for begin in range(0, len(chunk.payloads), DECODED):
            part = slice(begin, begin + DECODED)
            payloads, of_block = chunk.payloads[part], rotation_of_block[part]
            firings = decode(payloads, scanner, settings.returns)
            rotation = of_block.reshape(-1)[firings.block]
            captured = None if chunk.capture_time_s is None else chunk.capture_time_s[part]
            sent = clock.packets(captured, payloads, of_block.max(axis=1))
            packet = firings.block // BLOCKS
            time_s = sent[packet] + clock.firings(
                firings.block - BLOCKS * packet, firings.which != ONLY
            )
            n = len(payloads)
            edges = np.searchsorted(packet, np.arange(0, n + PACKETS, PACKETS))
            for number, (first, last) in enumerate(pairwise(edges.tolist())):
                rows = slice(first, last)
                columns = place(firings[rows], rotation[rows], time_s[rows], lasers)
                yield columns, min(PACKETS, n - PACKETS * number)


def stream_points(
    recording: Recording,
    calibration: CalibrationFile | LaserParameters,
    rotations: str | int | slice | Sequence[int] | NDArray[np.integer] = "all",
    *,
    before: CalibrationFile | LaserParameters | None = None,
    min_range_m: float = -np.inf,
    max_range_m: float = np.inf,
    frame: str = "velocal",
    returns: str = "strongest",
) -> Iterator[Columns]:
    """Apply a calibration to a recording, some thousand packets at a time.

    Parameters
    ----------
    recording : Recording
        See `open_recording`.
    calibration : CalibrationFile or LaserParameters
        Calibration that gives the points. That of `read_calibration` is applied as the program
        does for which the file is written, with its near-point corrections; parameters give the
        points of equations (1) to (3).
    rotations : str, int, slice or sequence of int
        See `Recording.select`.
    before : CalibrationFile or LaserParameters, optional
        Another calibration; with it, the column ``shift`` tells how far every point has moved.
    min_range_m, max_range_m : float
        Points whose calibrated distance lies outside are left out, metres.
    frame : {"velocal", "ros"}
        Y forward and X right, as everywhere here, or X forward and Y left.
    returns : {"strongest", "last", "both"}
        Which return, where a shot has two.

    Yields
    ------
    dict of str to ndarray, shape (n,)
        See `stream`.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `rotations`, `frame` or `returns` are unknown.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> points = next(velocal.stream_points(recording, factory, slice(1, 3)))
    >>> points["x"].dtype, bool(points["rotation"].max() == 2)
    (dtype('float32'), True)
    """
    if frame not in FRAMES:
        raise ConfigError(f"unknown frame {frame!r}", where="frame", allowed=", ".join(FRAMES))
    check_choice(returns, "returns")
    chosen = recording.select(rotations, None)
    settings = Settings(
        recording.scanner,
        calibration,
        before,
        min_range_m,
        max_range_m,
        frame,
        returns,
        recording.source,
    )
    for columns, _ in stream(recording.path, recording.scan(), chosen, settings):
        yield columns


def raw_returns(
    recording: Path, inspection: Inspection, rotations: NDArray[np.int64], settings: Settings
) -> Beams:
    """Returns of a few rotations that are within the limits of range, all in memory.

    Parameters
    ----------
    recording : Path
        Capture file.
    inspection : Inspection
        Of that file.
    rotations : ndarray of int64
        Rotations to use, ascending.
    settings : Settings

    Returns
    -------
    Beams
        In the order of the wire.
    """
    parts = returns_of(
        recording, inspection.index, rotations, settings.scanner,
        returns=settings.returns, source=settings.source,
    )  # fmt: skip
    found = joined_rows(list(parts))
    beams = found.beams()
    dl = applied(settings.parameters, settings.scanner, found.rotation_rate_hz).model.dl
    range_m = beams.distance_m + dl[beams.laser_id]
    return beams[(range_m >= settings.min_range_m) & (range_m <= settings.max_range_m)]
