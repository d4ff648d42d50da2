"""Times of the packets of a recording, by the clock that it goes by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.capture import order
from velocal.packets.data import BLOCKS
from velocal.recording.pairs import (
    CAPTURE_DELAY_S,
    GAP_INTERVALS,
    Pace,
    Pairs,
    goes_on,
    judge_pairs,
    pace_of,
    signed,
)

#: Times of capture may be late by less than `CAPTURE_DELAY_S` if nearly all are late by much less,
#: but by this time in any case.
_LEAST_DELAY_S = 0.02
#: They are a clock if they advance after this share of the packets: every 20 ms at 2500 packets/s.
_ADVANCING = 0.02
#: Pairs of packets from which the pace is measured again.
_PACE_PAIRS = 64


class Clock:
    """Times of packets since the first one, by the device clock, else by the capture.

    Where a clock jumps, the times go on at the usual pace.

    Attributes
    ----------
    kind : str
        "device", "capture" or "none"; the first packets decide if it is not given.
    unused : bool
        Whether there are times of capture that hardly advance.
    jumps : list of (int, float)
        Number of the first packet after a jump of the clock, and how far it jumps, seconds.
    damaged : int
        Packets whose time stamp alone is wrong.
    irregular : int
        Packets that cannot belong where they stand, or whose azimuth is damaged.
    broken : int
        Packets before which the azimuth does not go on as within packets, though the device clock
        says that nothing is missing.
    turned_ticks, elapsed_s, pairs
        Sums of the steps of the azimuth and of the times over the pairs of packets between which
        nothing is missing, and the number of these pairs.
    """

    def __init__(self, kind: str | None = None) -> None:
        self.kind = kind or "none"
        self._known = kind is not None
        self.unused = False
        self.jumps: list[tuple[int, float]] = []
        self.damaged = self.irregular = self.broken = self.pairs = 0
        self.turned_ticks = self.elapsed_s = 0.0
        self._packets = 0
        self._epoch_s = 0.0
        self._hours = 0
        self._offset_us = 0
        self._offset_s = 0.0
        nowhere = np.zeros(BLOCKS, dtype=np.uint16)
        self._last: tuple[int, float, NDArray[np.uint16], bool] = (0, np.nan, nowhere, False)
        #: Pace with one and with two returns a shot.
        self._paces = [Pace(), Pace()]

    @property
    def pace(self) -> Pace:
        """Mean pace of the pairs of packets between which nothing is missing."""
        if not self.pairs:
            return Pace()
        mean_s = self.elapsed_s / self.pairs if self.elapsed_s > 0 else float("nan")
        return Pace(self.turned_ticks / self.pairs, mean_s)

    def times(
        self,
        stamps: NDArray[np.uint32],
        captured_s: Array | None,
        azimuth: NDArray[np.uint16],
        dual: NDArray[np.bool_],
    ) -> tuple[Array, NDArray[np.int64]]:
        """Times of consecutive packets.

        Parameters
        ----------
        stamps : ndarray of uint32, shape (n,)
            Trailing four bytes.
        captured_s : ndarray of float64, shape (n,), or None
            Times of capture, where the framing has them.
        azimuth : ndarray of uint16, shape (n, 12)
            Raw azimuth of every block, 0.01 degree.
        dual : ndarray of bool, shape (n,)
            Whether each packet holds two returns of a shot.

        Returns
        -------
        time_s : ndarray of float64, shape (n,)
            Seconds since the first packet, without jumps; NaN without a clock.
        missing : ndarray of int64, shape (n,)
            Packets that are missing before each packet.
        """
        first = self._packets == 0
        if first:
            self._start(stamps, captured_s)
            at_s = float("nan") if captured_s is None else float(captured_s[0])
            self._last = (int(stamps[0]), at_s, azimuth[0], bool(dual[0]))
        stamp, at_s, last_azimuth, was_dual = self._last
        joined = np.concatenate([last_azimuth[None], azimuth]).astype(np.int64)
        before = np.concatenate([[was_dual], dual[:-1]]).astype(np.int64)
        step, span = signed(np.diff(joined[:, 0])), signed(joined[:-1, -1] - joined[:-1, 0])
        caught = None if captured_s is None else np.diff(captured_s, prepend=at_s)
        ticks = stamps.astype(np.int64)
        raw = np.diff(ticks, prepend=stamp)
        back = raw < -order.HOUR_US // 2
        if self.kind == "device":
            interval = (raw + np.where(back, order.HOUR_US, 0)) * 1e-6
        elif self.kind == "capture" and caught is not None:
            interval = caught
        else:
            interval = np.full(len(stamps), np.nan)
        rows = slice(1, None) if first else slice(None)
        caught = None if caught is None else caught[rows]
        found = self._judge(interval[rows], caught, step[rows], before[rows])
        missing = np.zeros(len(stamps), dtype=np.int64)
        missing[rows] = found.missing
        self._note(found, interval[rows], step[rows], self._packets + int(first))
        told = (found.missing > 0) & ~found.jump if self.kind == "device" else False
        self.broken += int(np.count_nonzero(~goes_on(step[rows], span[rows]) & ~np.array(told)))
        shift = np.zeros(len(stamps))
        shift[rows] = np.where(found.jump, found.elapsed_s - interval[rows], 0.0)
        if self.kind == "device":
            hours = self._hours + np.cumsum(back)
            offset = self._offset_us + np.cumsum(np.rint(shift * 1e6).astype(np.int64))
            time_s = (ticks + hours * order.HOUR_US + offset) * 1e-6 - self._epoch_s
            self._hours, self._offset_us = int(hours[-1]), int(offset[-1])
        elif self.kind == "capture" and captured_s is not None:
            late = self._offset_s + np.cumsum(shift)
            time_s, self._offset_s = captured_s - self._epoch_s + late, float(late[-1])
        else:
            time_s = np.full(len(stamps), np.nan)
        at_s = float("nan") if captured_s is None else float(captured_s[-1])
        self._last = (int(ticks[-1]), at_s, azimuth[-1], bool(dual[-1]))
        self._packets += len(stamps)
        return np.asarray(time_s), missing

    def _start(self, stamps: NDArray[np.uint32], captured_s: Array | None) -> None:
        """Decide for a clock, by the first packets."""
        if self._known:
            return
        if order.has_device_clock(stamps):
            self.kind, self._epoch_s = "device", int(stamps[0]) * 1e-6
        elif captured_s is not None:
            # Times that are nearly all equal, or run backward, are no clock.
            steps = np.diff(captured_s)
            forward, back = int(np.count_nonzero(steps > 0)), int(np.count_nonzero(steps < 0))
            few = max(back, _ADVANCING * len(steps))
            self.unused = bool(len(steps) > 0 and (forward < few or forward == 0))
            if not self.unused:
                self.kind, self._epoch_s = "capture", float(captured_s[0])

    def _judge(
        self,
        interval_s: Array,
        captured_s: Array | None,
        step: NDArray[np.int64],
        dual: NDArray[np.int64],
    ) -> Pairs:
        """Judge pairs of packets by the pace, which they tell as well."""
        for two in np.unique(dual):
            rows = dual == two
            if rows.sum() >= _PACE_PAIRS or np.isnan(self._paces[two].step_ticks):
                found, known = pace_of(step[rows], interval_s[rows]), self._paces[two].interval_s
                usable = found.interval_s > 0 or np.isnan(known)
                self._paces[two] = found if usable else replace(found, interval_s=known)
        usual = np.array([pace.step_ticks for pace in self._paces])[dual]
        usual_s = np.array([pace.interval_s for pace in self._paces])[dual]
        late_s = CAPTURE_DELAY_S
        if captured_s is not None and self.kind == "device":
            # Times of capture count only if they advance as the device clock does.
            even = (interval_s > 0) & (interval_s <= GAP_INTERVALS * usual_s)
            ratio = captured_s[even].sum() / max(interval_s[even].sum(), 1e-9)
            if 0.5 < ratio < 2.0:
                jitter = np.percentile(np.abs(captured_s - interval_s)[even], 99)
                late_s = float(np.clip(20.0 * jitter, _LEAST_DELAY_S, CAPTURE_DELAY_S))
            else:
                captured_s = None
        return judge_pairs(self.kind, interval_s, captured_s, step, (usual, usual_s), late_s)

    def _note(self, found: Pairs, interval_s: Array, step: NDArray[np.int64], first: int) -> None:
        """Count what was found between packets, the first of which has this number."""
        plain = (found.missing == 0) & ~found.jump & ~found.irregular
        self.turned_ticks += float(step[plain].sum())
        self.elapsed_s += float(np.nan_to_num(interval_s[plain]).sum())
        self.pairs += int(plain.sum())
        self.irregular += int(found.irregular.sum())
        rows = np.flatnonzero(found.jump)
        for group in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []:
            size = interval_s[group] - found.elapsed_s[group]
            if self.kind == "device":
                # The clock counts an hour: nobody knows by how many hours it jumps.
                hour_s = order.HOUR_US * 1e-6
                size = np.mod(size + hour_s / 2, hour_s) - hour_s / 2
            if len(group) == 2 and abs(size.sum()) <= 1e-3 * abs(size[0]) + 1e-3:
                self.damaged += 1
                continue
            numbers = (first + group).tolist()
            self.jumps += zip(numbers, np.round(size, 6).tolist(), strict=True)
