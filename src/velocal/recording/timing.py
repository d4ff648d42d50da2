"""Time in a recording: the clock that its packets go by, and the gaps between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.capture import order
from velocal.packets.data import BLOCKS
from velocal.scanner.models import AZIMUTH_TICKS

#: Packets farther apart than this many usual intervals have a gap between them.
GAP_INTERVALS = 1.5
#: Without a device clock, a gap is as many usual intervals and usual steps of the azimuth.
CAPTURE_GAP_INTERVALS = 5
CAPTURE_GAP_STEPS = 4


class Clock:
    """Times of packets since the first one, by the device clock, else by the capture.

    Attributes
    ----------
    kind : str
        "device", "capture" or "none"; the first packets decide.
    """

    def __init__(self) -> None:
        self.kind = "none"
        self._started = False
        self._epoch_s = 0.0
        self._hours = 0
        self._last_stamp = 0

    def times(
        self, stamps: NDArray[np.uint32], captured_s: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Times of consecutive packets.

        Parameters
        ----------
        stamps : ndarray of uint32, shape (n,)
            Trailing four bytes.
        captured_s : ndarray of float64, shape (n,), or None
            Times of capture, where the framing has them.

        Returns
        -------
        ndarray of float64, shape (n,)
            Seconds since the first packet, without jumps at the hour; NaN without a clock.
        """
        if not self._started:
            self._start(stamps, captured_s)
        if self.kind == "device":
            ticks = stamps.astype(np.int64)
            back = np.diff(ticks, prepend=self._last_stamp) < -order.HOUR_US // 2
            hours = self._hours + np.cumsum(back)
            self._hours, self._last_stamp = int(hours[-1]), int(ticks[-1])
            return np.asarray((ticks + hours * order.HOUR_US) * 1e-6 - self._epoch_s)
        if self.kind == "capture" and captured_s is not None:
            return captured_s - self._epoch_s
        return np.full(len(stamps), np.nan)

    def _start(self, stamps: NDArray[np.uint32], captured_s: NDArray[np.float64] | None) -> None:
        """Decide for a clock, by the first packets."""
        self._started = True
        if order.has_device_clock(stamps):
            self.kind, self._last_stamp = "device", int(stamps[0])
            self._epoch_s = int(stamps[0]) * 1e-6
        elif captured_s is not None:
            self.kind, self._epoch_s = "capture", float(captured_s[0])


class Gaps:
    """Usual interval between packets, and the places where packets are missing.

    Attributes
    ----------
    packet : list of int
        Numbers of the packets after which there is a gap, counted from 1.
    packets_missing : int
        Packets that are missing in the gaps.
    """

    def __init__(self) -> None:
        self.packet: list[int] = []
        self.packets_missing = 0
        self._packets = 0
        self._last_time_s = float("nan")
        self._last_azimuth = 0
        self._interval_s = float("nan")
        #: Median interval of a chunk, and the number of intervals in it.
        self._medians: list[tuple[float, int]] = []

    def consume(self, time_s: NDArray[np.float64], azimuth: NDArray[np.int32], clock: str) -> None:
        """Look at consecutive packets.

        Parameters
        ----------
        time_s : ndarray of float64, shape (n,)
        azimuth : ndarray of int32, shape (n, 12)
            Raw azimuth of every block, 0.01 degree.
        clock : {"device", "capture", "none"}
            Where times come from.
        """
        flat = azimuth.reshape(-1)
        before_s = time_s[:1] if np.isnan(self._last_time_s) else np.array([self._last_time_s])
        interval = np.diff(time_s, prepend=before_s)
        if self._packets == 0:
            interval = interval[1:]
            self._last_azimuth = int(flat[0])
        if len(interval):
            median = float(np.median(interval))
            self._medians.append((median, len(interval)))
            if np.isnan(self._interval_s):
                self._interval_s = median
        skipped = len(time_s) - len(interval)
        limit = GAP_INTERVALS if clock == "device" else CAPTURE_GAP_INTERVALS
        # Where most times are equal, as in a bag without stamps, they cannot show a gap.
        known = self._interval_s > 0
        gaps = np.flatnonzero((interval > limit * self._interval_s) & known)
        if clock == "capture" and len(gaps):
            # Capture times jitter by more than a packet: the head must have turned as well.
            steps = np.mod(np.diff(flat, prepend=self._last_azimuth), AZIMUTH_TICKS)
            usual = float(np.median(steps[steps > 0])) if steps.any() else np.inf
            gaps = gaps[steps[(gaps + skipped) * BLOCKS] > CAPTURE_GAP_STEPS * usual]
        for at in gaps:
            self.packet.append(self._packets + int(at) + skipped)
            self.packets_missing += int(np.rint(interval[at] / self._interval_s) - 1.0)
        self._packets += len(time_s)
        self._last_time_s, self._last_azimuth = float(time_s[-1]), int(flat[-1])

    @property
    def interval_s(self) -> float:
        """Median time between packets; NaN without time, or if most times are equal.

        It is the weighted median of the medians of all chunks: exact enough for a rate, and its
        memory does not grow with the packets.
        """
        if not self._medians:
            return float("nan")
        medians = np.array(self._medians)
        ascending = np.argsort(medians[:, 0])
        half = np.searchsorted(np.cumsum(medians[ascending, 1]), medians[:, 1].sum() / 2)
        interval_s = float(medians[ascending[half], 0])
        return interval_s if interval_s > 0 else float("nan")
