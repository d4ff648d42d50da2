"""Order of packets: duplicates are dropped, late packets are put back, within a bound.

The device clock tells the order. Where a scanner has none, only duplicates are seen.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk, joined
from velocal.capture.ledger import Ledger
from velocal.packets.data import view
from velocal.scanner.models import AZIMUTH_TICKS

#: The device clock counts the microseconds of an hour.
HOUR_US = 3_600_000_000
#: Number of packets before a packet among which its place, or its duplicate, is looked for.
BOUND = 32
#: Steps of a clock from packet to packet are shorter than this.
_STEP_US = 100_000
#: The encoder of an HDL-64E is as coarse as this, 0.01 degree.
_ENCODER_TICKS = 12
#: A clock that jumps more often, as a share of the packets, is not put right.
_FEW_UNEVEN = 0.1


def clock_steps(stamps: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Differences of time stamps of a clock that begins again every hour; they may be negative."""
    half = HOUR_US // 2
    return np.mod(np.diff(stamps.astype(np.int64)) + half, HOUR_US) - half


def has_device_clock(stamps: NDArray[np.uint32], *, ordered: bool = True) -> bool:
    """Whether trailing bytes look like a clock: rising by less than 0.1 s nearly always.

    HDL-64E S1 and early S2 units send text there, which alternates.

    Parameters
    ----------
    stamps : ndarray of uint32, shape (n,)
        Trailing four bytes of successive packets.
    ordered : bool
        Whether the packets are in order. If not, steps back count as well.

    Returns
    -------
    bool
    """
    if len(stamps) < 2:
        return False
    steps = clock_steps(stamps)
    if not ordered:
        steps = np.abs(steps)
    return bool(np.mean((steps > 0) & (steps < _STEP_US)) > 0.9) and bool(
        np.mean(stamps < HOUR_US) > 0.99
    )


def _stamps(chunk: Chunk) -> NDArray[np.uint32]:
    """Trailing four bytes of every packet, shape (n,)."""
    return np.ascontiguousarray(view(chunk.payloads)["timestamp"])


def _rising(stamps: NDArray[np.uint32]) -> bool:
    """Whether every step is that of a clock between packets in order."""
    steps = clock_steps(stamps)
    return bool(((steps > 0) & (steps < _STEP_US)).all())


class Reorder:
    """Bring packets in order; what was not in order is entered in the ledger.

    Attributes
    ----------
    changed : bool
        Whether packets were dropped or moved.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self.changed = False

    def reordered(self, chunks: Iterator[Chunk]) -> Iterator[Chunk]:
        """Bring chunks in order.

        One chunk is always kept back, because the next one may hold a packet that belongs to it.
        """
        held: Chunk | None = None
        in_order = True
        for chunk in chunks:
            if len(chunk) == 0:
                continue
            rising = _rising(_stamps(chunk))
            if held is None:
                held, in_order = chunk, rising
                continue
            ends = np.concatenate([_stamps(held.select(slice(-1, None))), _stamps(chunk)[:1]])
            if in_order and rising and _rising(ends):
                yield held
                held = chunk
                continue
            both = self._sort(joined([held, chunk]))
            keep = min(2 * BOUND, len(both))
            if len(both) > keep:
                yield both.select(slice(0, len(both) - keep))
            held = both.select(slice(len(both) - keep, None))
            in_order = _rising(_stamps(held))
        if held is not None:
            yield held if in_order else self._sort(held)

    def _sort(self, chunk: Chunk) -> Chunk:
        """Drop duplicates and sort by the device clock, where there is one."""
        twice = _duplicates(chunk.payloads)
        if twice.any():
            self._drop("duplicate", chunk, twice)
            chunk = chunk.select(~twice)
        stamps = _stamps(chunk)
        if not has_device_clock(stamps, ordered=False):
            return chunk
        azimuth = view(chunk.payloads)["blocks"]["azimuth"][:, 0]
        time = np.concatenate([[0], np.cumsum(_steady_steps(clock_steps(stamps), azimuth))])
        order, stray, late = _order(time)
        if stray.any():
            self._drop(f"late by more than {BOUND} packets", chunk, stray)
        if late or stray.any():
            self._ledger.reordered += late
            self.changed = True
            chunk = chunk.select(order)
        return chunk

    def _drop(self, reason: str, chunk: Chunk, rows: NDArray[np.bool_]) -> None:
        """Enter packets in the ledger that are dropped."""
        self._ledger.reject(reason, int(rows.sum()), int(chunk.sizes[rows].sum()))
        self.changed = True


def _steady_steps(steps: NDArray[np.int64], azimuth: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Steps of the clock without its jumps and without damaged stamps.

    There the head goes on evenly, from the packet before to the packet after. A packet that comes
    late interrupts the azimuth.

    Parameters
    ----------
    steps : ndarray of int64, shape (n - 1,)
        Microseconds.
    azimuth : ndarray of uint16, shape (n,)
        Raw azimuth of the first block, 0.01 degree.

    Returns
    -------
    ndarray of int64, shape (n - 1,)
    """
    half = AZIMUTH_TICKS // 2
    turned = np.mod(np.diff(azimuth.astype(np.int64)) + half, AZIMUTH_TICKS) - half
    usual, forward = float(np.median(turned)), steps[steps > 0]
    if not len(forward) or abs(usual) < _ENCODER_TICKS:
        return steps
    even = np.abs(turned - usual) <= max(abs(usual) / 4, _ENCODER_TICKS)
    padded = np.concatenate([[True], even, [True]])
    interval = float(np.median(forward))
    uneven = even & padded[:-2] & padded[2:] & ((steps <= 0) | (steps > 1.5 * interval))
    if np.count_nonzero(uneven) > _FEW_UNEVEN * len(steps):
        return steps  # the packets, not the clock, are out of order
    return np.where(uneven, round(interval), steps)


def _duplicates(payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Payloads that are equal to one of the `BOUND` before."""
    twice = np.zeros(len(payloads), dtype=bool)
    last: dict[bytes, int] = {}
    for number, payload in enumerate(payloads):
        content = payload.tobytes()
        twice[number] = number - last.get(content, -BOUND - 1) <= BOUND
        last[content] = number
    return twice


def _order(time: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Order of packets by their clock.

    A clock that is set back differs from a late packet by the packets that follow: they stay back.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        Microseconds of the clock, without jumps at the hour.

    Returns
    -------
    order : ndarray of int64
        Numbers of the packets that have a place, in their order.
    stray : ndarray of bool, shape (n,)
        Packets that are too late to have a place.
    late : int
        Number of packets that were late and have a place.
    """
    forward = np.diff(time)
    forward = forward[forward > 0]
    reach = BOUND * float(np.median(forward)) if len(forward) else 0.0
    stray = np.zeros(len(time), dtype=bool)
    orders: list[NDArray[np.int64]] = []
    begin = late = 0
    while begin < len(time):
        end = len(time)
        behind = np.maximum.accumulate(time[begin:]) - time[begin:]
        far = np.flatnonzero(behind > reach)
        # Runs of packets that lie far back.
        for run in np.split(far, np.flatnonzero(np.diff(far) > 1) + 1) if len(far) else []:
            if len(run) > BOUND or begin + run[-1] + 1 == len(time):
                end = begin + int(run[0])
                break
            stray[begin + run] = True
        rows = begin + np.flatnonzero(~stray[begin:end])
        late += int(np.count_nonzero(behind[rows - begin] > 0))
        orders.append(rows[np.argsort(time[rows], kind="stable")])
        begin = end
    return np.concatenate(orders), stray, late
