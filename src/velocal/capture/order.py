"""Order of packets: duplicates dropped, late ones put back, within a bound.

Order is told by the device clock. Where a scanner has none, only duplicates are seen.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk, joined
from velocal.capture.ledger import Ledger
from velocal.packets.data import view

#: The device clock counts the microseconds of an hour.
HOUR_US = 3_600_000_000
#: A packet is looked for among so many before it.
BOUND = 32
#: Steps of a clock from packet to packet are shorter than this.
_STEP_US = 100_000


def clock_steps(stamps: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Differences of trailing bytes as of a clock that begins again every hour; may be negative."""
    half = HOUR_US // 2
    return np.mod(np.diff(stamps.astype(np.int64)) + half, HOUR_US) - half


def has_device_clock(stamps: NDArray[np.uint32], *, ordered: bool = True) -> bool:
    """Whether trailing bytes look like a clock: rising by less than 0.1 s nearly always.

    HDL-64E S1 and early S2 units send text there, which alternates. Unless `ordered`, steps back
    are as good.
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
    return np.ascontiguousarray(view(chunk.payloads)["timestamp"])


def _rising(stamps: NDArray[np.uint32]) -> bool:
    steps = clock_steps(stamps)
    return bool(((steps > 0) & (steps < _STEP_US)).all())


class Sequence:
    """Brings packets in order; what was not in order is entered in the ledger.

    Attributes
    ----------
    changed : bool
        Whether packets were dropped or moved.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self.changed = False

    def mended(self, chunks: Iterator[Chunk]) -> Iterator[Chunk]:
        """Chunks in order; one is held back, as the next may hold a packet that belongs to it."""
        held: Chunk | None = None
        in_order = True
        for chunk in chunks:
            if len(chunk) == 0:
                continue
            rising = _rising(_stamps(chunk))
            if held is None:
                held, in_order = chunk, rising
                continue
            ends = np.concatenate([_stamps(held.take(slice(-1, None))), _stamps(chunk)[:1]])
            if in_order and rising and _rising(ends):
                yield held
                held = chunk
                continue
            both = self._mend(joined([held, chunk]))
            keep = min(2 * BOUND, len(both))
            if len(both) > keep:
                yield both.take(slice(0, len(both) - keep))
            held, in_order = both.take(slice(len(both) - keep, None)), False
        if held is not None:
            yield held if in_order else self._mend(held)

    def _mend(self, chunk: Chunk) -> Chunk:
        twice = _duplicates(chunk.payloads)
        if twice.any():
            self._drop("duplicate", chunk, twice)
            chunk = chunk.take(~twice)
        stamps = _stamps(chunk)
        if not has_device_clock(stamps, ordered=False):
            return chunk
        time = np.concatenate([[0], np.cumsum(clock_steps(stamps))])
        order, stray, late = _order(time)
        if stray.any():
            self._drop(f"late by more than {BOUND} packets", chunk, stray)
        if late or stray.any():
            self._ledger.reordered += late
            self.changed = True
            chunk = chunk.take(order)
        return chunk

    def _drop(self, reason: str, chunk: Chunk, rows: NDArray[np.bool_]) -> None:
        self._ledger.reject(reason, int(rows.sum()), int(chunk.sizes[rows].sum()))
        self.changed = True


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
    """Order of packets by their clock, which are too late to have a place, and how many were late.

    A clock that is set back is told from a late packet by what follows: it stays back.
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
