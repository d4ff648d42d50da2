"""Index of the rotations of a recording, windows of them, and what the packets say of the scanner.

The whole recording is scanned once, a chunk at a time; what is kept grows with the number of
rotations, not of packets.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.capture import order as sequence
from velocal.capture.chunk import Chunk, joined
from velocal.capture.ledger import Ledger
from velocal.capture.reading import Progress, open_capture
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.errors import RecordingError
from velocal.packets.data import (
    BLOCKS,
    MODES,
    flags_and_azimuths,
    median_azimuth_step,
    view,
)
from velocal.packets.dual import two_returns
from velocal.packets.status import TRAILING, StatusReader, StatusStream
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, BANK_FLAGS

#: Packets farther apart than this many usual intervals have a gap between them.
GAP_INTERVALS = 1.5
#: Packets that are looked at together at least, where the recording has so many.
CLOCK_PACKETS = 256
#: Without a device clock: so many usual intervals, and steps of the azimuth, are a gap.
CAPTURE_GAP_INTERVALS = 5
CAPTURE_GAP_STEPS = 4
BANKS = ("upper", "lower", "third", "fourth")


@dataclass(frozen=True)
class RotationIndex:
    """Where every rotation of a recording begins.

    A rotation begins with the first block whose azimuth is smaller than that of the block
    before it. The first and the last row are usually incomplete.

    Attributes
    ----------
    offset : ndarray of int64, shape (n + 1,)
        Byte at which the packet with the first block of a rotation begins; the last element
        is the end of the recording. -1 everywhere if packets cannot be read from the middle of
        the file on: compressed files, bags, and such as had to be put in order.
    block : ndarray of int8, shape (n + 1,)
        Number of that block in its packet.
    packet : ndarray of int64, shape (n + 1,)
        Running number of that packet among the valid data packets.
    time_s : ndarray of float64, shape (n + 1,)
        Time of that packet since the first; from the device clock, else from the capture;
        NaN where neither exists.
    complete : ndarray of bool, shape (n,)
        False for a rotation that the recording cuts, or that has a gap in it.
    """

    offset: NDArray[np.int64]
    block: NDArray[np.int8]
    packet: NDArray[np.int64]
    time_s: NDArray[np.float64]
    complete: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.complete)

    def rate_hz(self, rotations: NDArray[np.integer] | None = None) -> float:
        """Median rotation rate of complete rotations (all, or those given); NaN without time."""
        durations = np.diff(self.time_s)
        chosen = self.complete.copy()
        if rotations is not None:
            chosen &= np.isin(np.arange(len(self)), rotations)
        durations = durations[chosen & (durations > 0)]
        return float(1.0 / np.median(durations)) if len(durations) else float("nan")


@dataclass
class Inspection:
    """What a complete scan of a recording found.

    Attributes
    ----------
    index : RotationIndex
    ledger : Ledger
    gaps, packets_missing : int
        Interruptions of the packet sequence, and the packets they must have held; by the device
        clock, or by capture times where the azimuth agrees.
    packet_interval_s : float
        Median time between packets; NaN without time.
    azimuth_step_ticks : float
        Median difference of azimuths of successive firings.
    azimuth_multiple : int
        Greatest common divisor of all azimuths: 9 for an encoder of 0.09 degree.
    clock : str
        "device", "capture" or "none": where times come from.
    block_counts : dict of str to int
        Number of upper and lower blocks; of the third and fourth bank of a VLS-128.
    dual : bool
        Whether every shot has two returns.
    mode : str
        What the scanner says of its returns: "strongest", "last" or "dual"; empty where it says
        nothing.
    product : int or None
        Last payload byte, where it never changes.
    status_types : str
        Status types seen in the last but one byte, where these are printable (HDL-64E S2/S3).
    status : StatusStream
        What the trailing bytes say: temperature, firmware, time, the factory's table.
    """

    index: RotationIndex
    ledger: Ledger
    gaps: int = 0
    packets_missing: int = 0
    packet_interval_s: float = float("nan")
    azimuth_step_ticks: float = float("nan")
    azimuth_multiple: int = 0
    clock: str = "none"
    block_counts: dict[str, int] = field(default_factory=dict)
    dual: bool = False
    mode: str = ""
    product: int | None = None
    status_types: str = ""
    status: StatusStream = field(default_factory=StatusStream)

    @property
    def calibration_in_stream(self) -> bool:
        """Whether the factory's calibration can be taken from the status bytes."""
        return self.status.parameters is not None

    def as_dict(self) -> dict[str, Any]:
        """Plain mapping for JSON and for people: counts, rates and the ledger."""
        return {
            "duration_s": self.duration_s,
            "clock": self.clock,
            "rotations": len(self.index),
            "rotations_complete": int(self.index.complete.sum()),
            "rotation_rate_hz": self.index.rate_hz(),
            "packet_rate_hz": 1.0 / self.packet_interval_s,
            "azimuth_step_deg": self.azimuth_step_ticks * AZIMUTH_TICK_DEG,
            "azimuth_resolution_deg": self.azimuth_multiple * AZIMUTH_TICK_DEG,
            "gaps": self.gaps,
            "packets_missing": self.packets_missing,
            "block_counts": self.block_counts,
            "returns": "dual" if self.dual else self.mode or "single",
            "product": None if self.product is None else f"0x{self.product:02X}",
            "status_types": self.status_types,
            "calibration_in_stream": self.calibration_in_stream,
            "status": self.status.as_dict(),
            "ledger": self.ledger.as_dict(),
        }

    @property
    def duration_s(self) -> float:
        """Time from the first to the last packet, seconds."""
        return float(self.index.time_s[-1] - self.index.time_s[0])


def inspect(
    path: Path, progress: Progress | None = None, source: SourceFilter = ANY_SOURCE
) -> Inspection:
    """Scan a recording once: ledger, rotations, timing, what the packets say of the scanner.

    Parameters
    ----------
    path : Path
        Capture file, or folder of a ROS 2 bag.
    progress : callable, optional
        Called with bytes done and bytes in all.
    source : SourceFilter
        Which of several scanners.

    Raises
    ------
    RecordingError
        If the file has no known framing, not one valid data packet, or several scanners.
    """
    reading = open_capture(path, source).read(progress)
    scan = _Scan()
    for chunk in _merged(reading):
        scan.take(chunk)
    if scan.packets == 0:
        raise RecordingError("holds no valid data packet", where=str(path))
    return scan.result(reading.ledger, reading.seekable)


def _merged(chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Join chunks, which damage may cut to single packets, so that each has a clock to judge by."""
    held: list[Chunk] = []
    for chunk in chunks:
        held.append(chunk)
        if sum(len(part) for part in held) >= CLOCK_PACKETS:
            yield joined(held)
            held = []
    if any(len(part) for part in held):
        yield joined(held)


class _Scan:
    """State of a scan between chunks."""

    def __init__(self) -> None:
        self.packets = 0
        self.last_azimuth: int | None = None
        self.clock: str | None = None
        self.epoch: float = 0.0
        self.last_time: float = float("nan")
        self.hours = 0
        self.last_stamp = 0
        self.starts: list[tuple[int, int, int, float]] = []
        self.gap_after: list[tuple[int, float]] = []
        self.intervals: list[NDArray[np.float64]] = []
        self.interval = float("nan")
        self.steps = np.zeros(AZIMUTH_TICKS, dtype=np.int64)
        self.azimuth_seen = np.zeros(AZIMUTH_TICKS, dtype=bool)
        self.blocks = np.zeros(len(BANKS), dtype=np.int64)
        self.dual = 0
        self.products = np.zeros(256, dtype=np.int64)
        self.statuses = np.zeros(256, dtype=np.int64)
        self.status = StatusReader()

    def take(self, chunk: Chunk) -> None:
        packets = view(chunk.payloads)
        flags, azimuth = flags_and_azimuths(packets)
        n = len(packets)
        times = self._times(chunk, np.ascontiguousarray(packets["timestamp"]))
        flat = azimuth.reshape(-1).astype(np.int32)
        before = flat[0] if self.last_azimuth is None else self.last_azimuth
        # A rotation begins where the azimuth falls by more than half a turn.
        wraps = np.flatnonzero(np.diff(flat, prepend=before) < -AZIMUTH_TICKS // 2)
        if self.packets == 0:
            wraps = np.concatenate([[0], wraps])
        for wrap in wraps:
            packet, block = divmod(int(wrap), BLOCKS)
            self.starts.append(
                (int(chunk.offsets[packet]), block, self.packets + packet, float(times[packet]))
            )
        self._gaps(times, flat, int(before))
        self.steps += np.bincount(median_azimuth_step(azimuth), minlength=AZIMUTH_TICKS)
        self.azimuth_seen[flat] = True
        self.dual += int(two_returns(flags, azimuth).sum())
        self.blocks += [np.count_nonzero(flags == flag) for flag in BANK_FLAGS]
        self.products += np.bincount(packets["status"][:, 1], minlength=256)
        self.status.take(chunk.payloads[:, -TRAILING.itemsize :])
        self.statuses += np.bincount(packets["status"][:, 0], minlength=256)
        self.last_azimuth = int(flat[-1])
        self.last_time = float(times[-1])
        self.packets += n

    def _times(self, chunk: Chunk, stamps: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Seconds since the first packet, unwrapped at the hour."""
        if self.clock is None:
            if sequence.has_device_clock(stamps):
                self.clock = "device"
                self.last_stamp = int(stamps[0])
            else:
                self.clock = "none" if chunk.capture_time_s is None else "capture"
                if chunk.capture_time_s is not None:
                    self.epoch = float(chunk.capture_time_s[0])
            if self.clock == "device":
                self.epoch = int(stamps[0]) * 1e-6
        if self.clock == "device":
            ticks = stamps.astype(np.int64)
            back = np.diff(ticks, prepend=self.last_stamp) < -sequence.HOUR_US // 2
            hours = self.hours + np.cumsum(back)
            self.hours, self.last_stamp = int(hours[-1]), int(ticks[-1])
            return np.asarray((ticks + hours * sequence.HOUR_US) * 1e-6 - self.epoch)
        if self.clock == "capture" and chunk.capture_time_s is not None:
            return chunk.capture_time_s - self.epoch
        return np.full(len(stamps), np.nan)

    def _gaps(self, times: NDArray[np.float64], azimuth: NDArray[np.int32], last: int) -> None:
        before = times[:1] if np.isnan(self.last_time) else np.array([self.last_time])
        interval = np.diff(times, prepend=before)
        if self.packets == 0:
            interval = interval[1:]
        if len(interval) and np.isnan(self.interval):
            self.interval = float(np.median(interval))
        if len(interval):
            self.intervals.append(np.array([np.median(interval), len(interval)]))
        skipped = len(times) - len(interval)
        limit = GAP_INTERVALS if self._clocked else CAPTURE_GAP_INTERVALS
        gaps = np.flatnonzero(interval > limit * self.interval)
        if self.clock == "capture" and len(gaps):
            # Capture times jitter by more than a packet: the head must have turned as well.
            steps = np.mod(np.diff(azimuth, prepend=last), AZIMUTH_TICKS)
            usual = float(np.median(steps[steps > 0])) if steps.any() else np.inf
            gaps = gaps[steps[(gaps + skipped) * BLOCKS] > CAPTURE_GAP_STEPS * usual]
        for at in gaps:
            missing = float(np.rint(interval[at] / self.interval) - 1.0)
            self.gap_after.append((self.packets + int(at) + skipped, missing))

    @property
    def _clocked(self) -> bool:
        return self.clock == "device"

    def result(self, ledger: Ledger, seekable: bool) -> Inspection:
        columns = [*self.starts, (ledger.file_bytes, 0, self.packets, self.last_time)]
        offset, block, packet, time = (np.array(c) for c in zip(*columns, strict=True))
        complete = np.ones(len(self.starts), dtype=bool)
        complete[[0, -1]] = False
        for at, _ in self.gap_after:
            # The gap lies between two packets, which may belong to two rotations.
            complete[np.searchsorted(packet[:-1], [at - 1, at], side="right") - 1] = False
        offset = offset.astype(np.int64) if seekable else np.full(len(offset), -1)
        index = RotationIndex(
            offset, block.astype(np.int8), packet.astype(np.int64), time, complete
        )
        interval = float("nan")
        if self.intervals:
            medians = np.array(self.intervals)
            # Weighted median over chunks: exact enough for a rate, and constant memory.
            order = np.argsort(medians[:, 0])
            half = np.searchsorted(np.cumsum(medians[order, 1]), medians[:, 1].sum() / 2)
            interval = float(medians[order[half], 0])
        common = int(np.gcd.reduce(np.flatnonzero(self.azimuth_seen)))
        product = np.flatnonzero(self.products)
        modes = np.flatnonzero(self.statuses)
        statuses = [chr(code) for code in modes if 32 <= code < 127]
        hdl64e = self.blocks[1] > 0 and self.blocks[2] == 0
        mode = MODES.get(int(modes[0]), "") if len(modes) == 1 and not hdl64e else ""
        return Inspection(
            index=index,
            ledger=ledger,
            gaps=len(self.gap_after),
            packets_missing=int(sum(missing for _, missing in self.gap_after)),
            packet_interval_s=interval,
            azimuth_step_ticks=float(np.searchsorted(np.cumsum(self.steps), self.steps.sum() / 2)),
            azimuth_multiple=common,
            clock=self.clock or "none",
            block_counts={
                bank: int(n)
                for bank, n in zip(BANKS, self.blocks, strict=True)
                if n or bank in BANKS[:2]
            },
            dual=2 * self.dual > self.packets,
            mode=mode,
            product=int(product[0]) if len(product) == 1 else None,
            status_types="".join(statuses) if hdl64e and self._clocked else "",
            status=self.status.result(),
        )
