"""Index of the rotations of a recording, windows of them, and what the packets say of the scanner.

The whole recording is scanned once, a chunk at a time; what is kept grows with the number of
rotations, not of packets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.errors import RecordingError
from velocal.packets import BLOCKS, median_azimuth_step, view
from velocal.recording.framing import Chunk, detect
from velocal.recording.ledger import Ledger
from velocal.sensors import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, FLAG_LOWER
from velocal.status import TRAILING, StatusReader, StatusStream

#: The device clock counts the microseconds of an hour.
HOUR_US = 3_600_000_000
#: Packets farther apart than this many usual intervals have a gap between them.
GAP_INTERVALS = 1.5
#: Packets that are looked at together at least, where the recording has so many.
CLOCK_PACKETS = 256

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RotationIndex:
    """Where every rotation of a recording begins.

    A rotation begins with the first block whose azimuth is smaller than that of the block
    before it. The first and the last row are usually incomplete.

    Attributes
    ----------
    offset : ndarray of int64, shape (n + 1,)
        Byte at which the packet with the first block of a rotation begins; the last element
        is the end of the recording.
    block : ndarray of int8, shape (n + 1,)
        Number of that block in its packet.
    packet : ndarray of int64, shape (n + 1,)
        Running number of that packet among the sound data packets.
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
        Interruptions of the packet sequence, and the packets they must have held.
    packet_interval_s : float
        Median time between packets; NaN without time.
    azimuth_step_ticks : float
        Median difference of azimuths of successive firings.
    azimuth_multiple : int
        Greatest common divisor of all azimuths: 9 for an encoder of 0.09 degree.
    clock : str
        "device", "capture" or "none": where times come from.
    block_counts : dict of str to int
        Number of upper and lower blocks.
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


def _has_device_clock(timestamps: NDArray[np.uint32]) -> bool:
    """Whether trailing bytes look like a clock: rising by less than 0.1 s nearly always.

    HDL-64E S1 and early S2 units send text there, which alternates.
    """
    if len(timestamps) < 2:
        return False
    steps = np.mod(np.diff(timestamps.astype(np.int64)), HOUR_US)
    return bool(np.mean((steps > 0) & (steps < 100_000)) > 0.9) and bool(
        np.mean(timestamps < HOUR_US) > 0.99
    )


def inspect(path: Path, progress: Progress | None = None) -> Inspection:
    """Scan a recording once: ledger, rotations, timing, what the packets say of the scanner.

    Parameters
    ----------
    path : Path
        Capture file.
    progress : callable, optional
        Called with bytes done and bytes in all.

    Raises
    ------
    RecordingError
        If the file has no known framing or not one sound data packet.
    """
    framing = detect(path)
    size = path.stat().st_size
    ledger = Ledger(file_bytes=size, framing=framing.name, framing_bytes=framing.first_packet)
    scan = _Scan()
    with path.open("rb") as file:
        for chunk in _merged(framing.chunks(file, framing.first_packet, size, ledger)):
            scan.take(chunk)
            if progress is not None:
                progress(chunk.end, size)
    if scan.packets == 0:
        raise RecordingError("holds no sound data packet", where=str(path))
    return scan.result(ledger, size)


def _merged(chunks: Iterator[Chunk]) -> Iterator[Chunk]:
    """Join chunks, which damage may cut to single packets, so that each has a clock to judge by."""
    held: list[Chunk] = []
    for chunk in chunks:
        held.append(chunk)
        if sum(len(part.payloads) for part in held) >= CLOCK_PACKETS:
            yield _joined(held)
            held = []
    if any(len(part.payloads) for part in held):
        yield _joined(held)


def _joined(parts: list[Chunk]) -> Chunk:
    if len(parts) == 1:
        return parts[0]
    times = [part.capture_time_s for part in parts if part.capture_time_s is not None]
    return Chunk(
        np.concatenate([part.payloads for part in parts]),
        np.concatenate([part.offsets for part in parts]),
        parts[-1].end,
        np.concatenate(times) if times else None,
    )


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
        self.blocks = {"upper": 0, "lower": 0}
        self.products = np.zeros(256, dtype=np.int64)
        self.statuses = np.zeros(256, dtype=np.int64)
        self.status = StatusReader()

    def take(self, chunk: Chunk) -> None:
        packets = view(chunk.payloads)
        blocks = packets["blocks"]
        azimuth = blocks["azimuth"] % np.uint16(AZIMUTH_TICKS)
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
        self._gaps(times)
        self.steps += np.bincount(median_azimuth_step(azimuth), minlength=AZIMUTH_TICKS)
        self.azimuth_seen[flat] = True
        lower = int((blocks["flag"] == FLAG_LOWER).sum())
        self.blocks["lower"] += lower
        self.blocks["upper"] += n * BLOCKS - lower
        self.products += np.bincount(packets["status"][:, 1], minlength=256)
        self.status.take(chunk.payloads[:, -TRAILING.itemsize :])
        self.statuses += np.bincount(packets["status"][:, 0], minlength=256)
        self.last_azimuth = int(flat[-1])
        self.last_time = float(times[-1])
        self.packets += n

    def _times(self, chunk: Chunk, stamps: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Seconds since the first packet, unwrapped at the hour."""
        if self.clock is None:
            if _has_device_clock(stamps):
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
            back = np.diff(ticks, prepend=self.last_stamp) < -HOUR_US // 2
            hours = self.hours + np.cumsum(back)
            self.hours, self.last_stamp = int(hours[-1]), int(ticks[-1])
            return np.asarray((ticks + hours * HOUR_US) * 1e-6 - self.epoch)
        if self.clock == "capture" and chunk.capture_time_s is not None:
            return chunk.capture_time_s - self.epoch
        return np.full(len(stamps), np.nan)

    def _gaps(self, times: NDArray[np.float64]) -> None:
        before = times[:1] if np.isnan(self.last_time) else np.array([self.last_time])
        interval = np.diff(times, prepend=before)
        if self.packets == 0:
            interval = interval[1:]
        if len(interval) and np.isnan(self.interval):
            self.interval = float(np.median(interval))
        if len(interval):
            self.intervals.append(np.array([np.median(interval), len(interval)]))
        # Capture clocks jitter by more than a packet: only the device clock can show a gap.
        if self.clock == "device":
            skipped = len(times) - len(interval)
            for at in np.flatnonzero(interval > GAP_INTERVALS * self.interval):
                missing = float(np.rint(interval[at] / self.interval) - 1.0)
                self.gap_after.append((self.packets + int(at) + skipped, missing))

    @property
    def _clocked(self) -> bool:
        return self.clock == "device"

    def result(self, ledger: Ledger, size: int) -> Inspection:
        columns = [*self.starts, (size, 0, self.packets, self.last_time)]
        offset, block, packet, time = (np.array(c) for c in zip(*columns, strict=True))
        complete = np.ones(len(self.starts), dtype=bool)
        complete[[0, -1]] = False
        for at, _ in self.gap_after:
            # The gap lies between two packets, which may belong to two rotations.
            complete[np.searchsorted(packet[:-1], [at - 1, at], side="right") - 1] = False
        index = RotationIndex(
            offset.astype(np.int64), block.astype(np.int8), packet.astype(np.int64), time, complete
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
        statuses = [chr(code) for code in np.flatnonzero(self.statuses) if 32 <= code < 127]
        return Inspection(
            index=index,
            ledger=ledger,
            gaps=len(self.gap_after),
            packets_missing=int(sum(missing for _, missing in self.gap_after)),
            packet_interval_s=interval,
            azimuth_step_ticks=float(np.searchsorted(np.cumsum(self.steps), self.steps.sum() / 2)),
            azimuth_multiple=common,
            clock=self.clock or "none",
            block_counts=self.blocks,
            product=int(product[0]) if len(product) == 1 else None,
            status_types="".join(statuses) if self.blocks["lower"] and self._clocked else "",
            status=self.status.result(),
        )
