"""Scan of a whole recording: its rotations, and what its packets say of the scanner.

The recording is read once, a chunk at a time. What is kept grows with the number of rotations, not
of packets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.capture.chunk import Chunk, gathered
from velocal.capture.ledger import Ledger
from velocal.capture.reading import Progress, open_capture
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.io.identity import identify
from velocal.packets.data import BLOCKS, MODES, flags_and_azimuths, median_azimuth_step, view
from velocal.packets.dual import dual_packets
from velocal.packets.status import TRAILING, StatusReader
from velocal.recording.gaps import Gaps, Missing
from velocal.recording.inspection import Inspection
from velocal.recording.rotation_index import RotationIndex
from velocal.recording.timing import Clock
from velocal.scanner.models import AZIMUTH_TICKS, BANK_FLAGS, SCANNERS
from velocal.study.windows import MAX_MISSING

#: Smallest number of packets that are examined together, where the recording has as many.
CLOCK_PACKETS = 256
#: A smaller fall of the azimuth than this is jitter, or a head that turns backward.
_FALL_TICKS = 500
#: A last byte of fewer packets than this share is a damaged one.
_RARE = 0.01
#: A head that turns by less than this from packet to packet, 0.01 degree, stands still.
_STANDING_TICKS = 2.0
#: Names of the banks of 32 lasers, in the order of `BANK_FLAGS`.
BANKS = ("upper", "lower", "third", "fourth")


def inspect(
    path: Path,
    progress: Progress | None = None,
    source: SourceFilter = ANY_SOURCE,
    *,
    max_missing: float = MAX_MISSING,
) -> Inspection:
    """Scan a recording once: ledger, rotations, timing, what the packets say of the scanner.

    Parameters
    ----------
    path : Path
        Capture file, or folder of a ROS 2 bag.
    progress : callable, optional
        Called with the bytes that are done and with all bytes.
    source : SourceFilter
        Which of several scanners.
    max_missing : float
        Largest share of its azimuth that a complete rotation may miss; see `Missing.tolerable`.

    Returns
    -------
    Inspection

    Raises
    ------
    RecordingError
        If the file has no known framing, not one valid data packet, or several scanners.
    """
    reading = open_capture(path, source).read(progress)
    made_from = identify(path)
    scan = _Scan()
    # Damage may cut chunks to single packets; each needs a clock to judge by.
    for chunk in gathered(reading, CLOCK_PACKETS):
        scan.consume(chunk)
    if scan.packets == 0:
        raise reading.ledger.nothing_usable(str(path))
    found = scan.result(reading.ledger, reading.seekable, max_missing)
    return replace(found, index=replace(found.index, recording=made_from))


@dataclass(frozen=True)
class _Packets:
    """Consecutive packets, as the parts of a scan look at them.

    Attributes
    ----------
    first : int
        Number of the first packet.
    offset : ndarray of int64, shape (n,)
        Byte at which each packet begins.
    time_s : ndarray of float64, shape (n,)
    flag : ndarray of uint16, shape (n, 12)
    azimuth : ndarray of uint16, shape (n, 12)
    status : ndarray of uint8, shape (n, 2)
        Last two bytes.
    dual : ndarray of bool, shape (n,)
        Whether each packet holds two returns of a shot.
    """

    first: int
    offset: NDArray[np.int64]
    time_s: Array
    flag: NDArray[np.uint16]
    azimuth: NDArray[np.uint16]
    status: NDArray[np.uint8]
    dual: NDArray[np.bool_]


class _Rotations:
    """Where rotations begin."""

    def __init__(self) -> None:
        #: Byte, block, packet and time; and whether the azimuth falls by less than half a turn.
        self._starts: list[tuple[int, int, int, float, bool]] = []
        self._last_azimuth = 0
        self._end = 0
        self._last_time_s = float("nan")

    def consume(self, packets: _Packets) -> None:
        """Find the rotations that begin in some packets."""
        flat = packets.azimuth.reshape(-1).astype(np.int32)
        before = self._last_azimuth if packets.first else flat[0]
        # A rotation begins where the azimuth falls by more than half a turn. It falls by less where
        # the field of view does not hold azimuth 0, which is known after the scan only.
        fall = np.diff(flat, prepend=before)
        begins = np.flatnonzero(fall < -_FALL_TICKS)
        if packets.first == 0:
            begins = np.concatenate([[0], begins])
        for begin in begins:
            packet, block = divmod(int(begin), BLOCKS)
            number, time_s = packets.first + packet, float(packets.time_s[packet])
            small = bool(-AZIMUTH_TICKS // 2 <= fall[begin] < -_FALL_TICKS)
            self._starts.append((int(packets.offset[packet]), block, number, time_s, small))
        self._last_azimuth = int(flat[-1])
        self._end = packets.first + len(packets.time_s)
        self._last_time_s = float(packets.time_s[-1])

    def index(self, file_bytes: int, *, small_falls: bool, seekable: bool) -> RotationIndex:
        """Index of all rotations, of which all but the first and the last are complete.

        Parameters
        ----------
        file_bytes : int
            End of the recording.
        small_falls : bool
            Whether rotations begin where the azimuth falls by less than half a turn as well.
        seekable : bool
        """
        starts = [start[:4] for start in self._starts if small_falls or not start[4]]
        columns = [*starts, (file_bytes, 0, self._end, self._last_time_s)]
        offset, block, packet, time_s = (np.array(c) for c in zip(*columns, strict=True))
        complete = np.ones(len(starts), dtype=bool)
        complete[[0, -1]] = False
        return RotationIndex(
            offset.astype(np.int64),
            block.astype(np.int8),
            packet.astype(np.int64),
            time_s,
            complete,
            seekable,
        )


class _Azimuths:
    """Usual step and resolution of azimuths."""

    def __init__(self) -> None:
        self._steps = np.zeros(AZIMUTH_TICKS, dtype=np.int64)
        self._seen = np.zeros(AZIMUTH_TICKS, dtype=bool)

    def consume(self, packets: _Packets) -> None:
        """Count the steps and the values of some packets."""
        self._steps += np.bincount(median_azimuth_step(packets.azimuth), minlength=AZIMUTH_TICKS)
        self._seen[packets.azimuth.reshape(-1)] = True

    @property
    def step_ticks(self) -> float:
        """Median step from firing to firing."""
        return float(np.searchsorted(np.cumsum(self._steps), self._steps.sum() / 2))

    @property
    def multiple(self) -> int:
        """Greatest common divisor of all azimuths."""
        return int(np.gcd.reduce(np.flatnonzero(self._seen)))


class _Blocks:
    """Banks of blocks, and whether packets hold two returns."""

    def __init__(self) -> None:
        self._of_bank = np.zeros(len(BANKS), dtype=np.int64)
        self._dual = self._packets = 0

    def consume(self, packets: _Packets) -> None:
        """Count the blocks of some packets."""
        self._of_bank += [np.count_nonzero(packets.flag == flag) for flag in BANK_FLAGS]
        self._dual += int(packets.dual.sum())
        self._packets += len(packets.flag)

    @property
    def counts(self) -> dict[str, int]:
        """Blocks of every bank that occurs; of the first two in any case."""
        found = zip(BANKS, self._of_bank, strict=True)
        return {bank: int(n) for bank, n in found if n or bank in BANKS[:2]}

    @property
    def banks(self) -> int:
        """Number of banks that occur."""
        return int(np.count_nonzero(self._of_bank))

    @property
    def packets_dual(self) -> int:
        """Packets that hold two returns of a shot."""
        return self._dual

    @property
    def dual(self) -> bool:
        """Whether most packets hold two returns."""
        return 2 * self._dual > self._packets


class _LastBytes:
    """Last two bytes of the packets: status type and value, or return mode and product."""

    def __init__(self) -> None:
        self._counts = np.zeros((2, 256), dtype=np.int64)

    def consume(self, packets: _Packets) -> None:
        """Count the values of some packets."""
        for count, values in zip(self._counts, packets.status.T, strict=True):
            count += np.bincount(values, minlength=256)

    @property
    def products(self) -> dict[int, int]:
        """Packets by their last byte, for those that are not rare."""
        count = self._counts[1]
        return {int(v): int(count[v]) for v in np.flatnonzero(count > _RARE * count.sum())}

    @property
    def product(self) -> int | None:
        """Last byte, if it changes in a few damaged packets at most."""
        values = list(self.products)
        return values[0] if len(values) == 1 else None

    @property
    def mode(self) -> str:
        """Return mode that the last but one byte means, if it never changes and means one."""
        values = np.flatnonzero(self._counts[0])
        return MODES.get(int(values[0]), "") if len(values) == 1 else ""

    @property
    def status_types(self) -> str:
        """Printable values of the last but one byte."""
        return "".join(chr(value) for value in np.flatnonzero(self._counts[0]) if 32 <= value < 127)


def turning(step_ticks: float) -> str:
    """How the head turns, by its step from packet to packet: forward, backward, or not at all."""
    if abs(step_ticks) < _STANDING_TICKS:
        return "standing"
    return "backward" if step_ticks < 0 else "forward"


class _Scan:
    """A scan between chunks: its parts, each of which looks at one subject."""

    def __init__(self) -> None:
        self.packets = 0
        self._clock = Clock()
        self._gaps = Gaps()
        self._rotations = _Rotations()
        self._azimuths = _Azimuths()
        self._blocks = _Blocks()
        self._last_bytes = _LastBytes()
        self._status = StatusReader()

    def consume(self, chunk: Chunk) -> None:
        """Let all parts look at a chunk."""
        wire = view(chunk.payloads)
        stamps = np.ascontiguousarray(wire["timestamp"])
        flag, azimuth = flags_and_azimuths(wire)
        dual = dual_packets(flag, azimuth)
        time_s, missing = self._clock.times(stamps, chunk.capture_time_s, azimuth, dual)
        status = wire["status"]
        packets = _Packets(self.packets, chunk.offsets, time_s, flag, azimuth, status, dual)
        for part in (self._rotations, self._azimuths, self._blocks, self._last_bytes):
            part.consume(packets)
        self._gaps.consume(time_s, azimuth[:, 0], missing, dual)
        self._status.consume(chunk.payloads[:, -TRAILING.itemsize :])
        self.packets += len(wire)

    def _index(
        self, file_bytes: int, seekable: bool, max_missing: float
    ) -> tuple[RotationIndex, Missing]:
        """Index of the rotations, and what is missing in the recording."""
        pace = self._clock.pace
        blind = self._gaps.blind(pace.step_ticks)
        small = bool(blind[0])
        index = self._rotations.index(file_bytes, small_falls=small, seekable=seekable)
        begins = index.packet[:-1] * BLOCKS + index.block[:-1]
        missing = self._gaps.result(pace.step_ticks, blind, begins)
        complete = index.complete & missing.tolerable(max_missing)
        mean_hz = abs(pace.step_ticks) / AZIMUTH_TICKS / pace.interval_s
        found = replace(
            index,
            complete=complete,
            loss=missing.loss,
            step_ticks=pace.step_ticks,
            mean_rate_hz=mean_hz,
            dual=self._blocks.dual,
        )
        return found, missing

    def result(self, ledger: Ledger, seekable: bool, max_missing: float) -> Inspection:
        """Tell what was found; `ledger` and `seekable` are those of the complete reading."""
        clock, banks = self._clock, self._blocks.banks
        index, missing = self._index(ledger.file_bytes, seekable, max_missing)
        # The last bytes of scanners with as many banks mean a status, or mode and product.
        status = any(s.sends_status for s in SCANNERS.values() if len(s.flags) == banks)
        types = status and clock.kind == "device"
        return Inspection(
            index=index,
            ledger=ledger,
            view_deg=missing.view_deg,
            packet_interval_s=self._gaps.interval_s(dual=self._blocks.dual),
            azimuth_step_ticks=self._azimuths.step_ticks,
            azimuth_multiple=self._azimuths.multiple,
            clock=clock.kind,
            unused_times=clock.unused,
            clock_jumps=tuple(clock.jumps),
            damaged_stamps=clock.damaged,
            irregular=clock.irregular,
            broken=clock.broken,
            turning=turning(index.step_ticks),
            packets_dual=self._blocks.packets_dual,
            block_counts=self._blocks.counts,
            dual=self._blocks.dual,
            mode="" if status else self._last_bytes.mode,
            product=self._last_bytes.product,
            products=self._last_bytes.products,
            status_types=self._last_bytes.status_types if types else "",
            status=self._status.result(),
        )
