"""Time in a recording: its clock, missing packets, and the limits of the field of view.

Time, azimuth and the number of packets must agree: from one packet to the next the head turns by
the usual step in the usual time. Where they do not agree, the azimuth and the times of capture
decide whether packets are missing or a clock has jumped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.capture import order
from velocal.packets.data import BLOCKS
from velocal.recording.rotation_index import Loss
from velocal.scanner.models import AZIMUTH_TICKS

#: Packets farther apart than this many usual intervals have a gap between them.
GAP_INTERVALS = 1.5
#: The azimuth may differ from what is expected by this share of the usual step, ...
_STEP_SHARE = 0.75
#: ... by the steps of a coarse encoder (0.09 deg), and by this share of the turning in between.
_ENCODER_TICKS = 12
_RATE_SHARE = 0.02
#: If the uncertainty is larger than this, the azimuth cannot tell how long a gap is.
_UNKNOWN_TICKS = 9000
#: Times of capture may be late by this time, and by less if nearly all are late by much less.
_CAPTURE_DELAY_S = 1.0
_LEAST_DELAY_S = 0.02
#: They are a clock if they advance after this share of the packets: every 20 ms at 2500 packets/s.
_ADVANCING = 0.02
#: No more packets than this can be missing: times of capture may be any number.
_MANY = 1e9
#: Pairs of packets from which the pace is measured again.
_PACE_PAIRS = 64
#: A limit of the field of view is seen in at least this many rotations, and in this share of them.
_VIEW_TURNS = 3
_VIEW_SHARE = 0.8
#: Where no packet begins over this many usual steps and ticks, the scanner does not look. A few
#: packets with damaged azimuths, this share of the usual ones, may begin there.
_BLIND_STEPS = 1.5
_BLIND_TICKS = 300
_BLIND_SHARE = 0.02
#: This number of missing packets never makes a rotation incomplete, unless none is allowed to miss.
FEW_PACKETS = 3


def signed(ticks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Angles, 0.01 degree, from half a turn backward to half a turn forward."""
    half = AZIMUTH_TICKS // 2
    return np.mod(ticks + half, AZIMUTH_TICKS) - half


def _goes_on(step: NDArray[np.int64], span: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the azimuth goes on from packet to packet as within packets.

    Parameters
    ----------
    step, span : ndarray of int64, shape (n,)
        Signed azimuth from the first block of a packet to that of the next, and to its own last
        block. A packet holds at least two shots, so that the step is up to twice the span; the span
        of one shot is zero and tells nothing.
    """
    forward, size = step * np.sign(span), np.abs(span)
    low, high = 0.75 * size - _ENCODER_TICKS, 2.25 * size + _ENCODER_TICKS
    return np.asarray((span == 0) | ((forward >= low) & (forward <= high)))


def _circular(ticks: Array) -> Array:
    """Size of angles, 0.01 degree, of which whole turns do not count."""
    half = AZIMUTH_TICKS / 2
    return np.asarray(np.abs(np.mod(ticks + half, AZIMUTH_TICKS) - half))


@dataclass(frozen=True)
class Pace:
    """How a recording usually goes on from one packet to the next.

    Attributes
    ----------
    step_ticks : float
        Mean step of the azimuth, 0.01 degree; negative if the head turns backward.
    interval_s : float
        Median time; NaN without time.
    """

    step_ticks: float = float("nan")
    interval_s: float = float("nan")


def _pace(step: NDArray[np.int64], interval_s: Array) -> Pace:
    """Pace of pairs of packets; there must be one at least."""
    median = float(np.median(step))
    usual = step[np.abs(step - median) <= abs(median) / 2]
    interval = float(np.median(interval_s))
    mean = float(usual.mean()) if len(usual) else median
    return Pace(mean, interval if interval > 0 else float("nan"))


@dataclass(frozen=True)
class Pairs:
    """What lies between packets that follow one another, n of them.

    Attributes
    ----------
    elapsed_s : ndarray of float64, shape (n,)
        Time; where a clock has jumped, what the azimuth and the times of capture give.
    missing : ndarray of int64, shape (n,)
        Packets that are missing in between.
    jump : ndarray of bool, shape (n,)
        Whether the clock jumps.
    irregular : ndarray of bool, shape (n,)
        Whether the second packet cannot belong where it stands, or its azimuth is damaged.
    """

    elapsed_s: Array
    missing: NDArray[np.int64]
    jump: NDArray[np.bool_]
    irregular: NDArray[np.bool_]


def judge_pairs(
    kind: str,
    interval_s: Array,
    captured_s: Array | None,
    step: NDArray[np.int64],
    pace: tuple[Array, Array],
    late_s: float = _CAPTURE_DELAY_S,
) -> Pairs:
    """Judge whether packets are missing between packets that follow one another, or a clock jumps.

    Parameters
    ----------
    kind : {"device", "capture", "none"}
        Clock.
    interval_s : ndarray, shape (n,)
        Differences of its times.
    captured_s : ndarray, shape (n,), or None
        Differences of the times of capture.
    step : ndarray of int64, shape (n,)
        Signed steps of the azimuth.
    pace : (ndarray, ndarray), each of shape (n,)
        Usual step in ticks, and usual interval in seconds.
    late_s : float
        Times of capture may be late by this time.

    Returns
    -------
    Pairs
    """
    usual, usual_s = pace
    n = len(step)
    pairs = Pairs(
        np.array(interval_s, dtype=np.float64),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=bool),
        np.zeros(n, dtype=bool),
    )
    allowed = _STEP_SHARE * np.abs(usual) + _ENCODER_TICKS
    even = np.abs(step - usual) <= allowed
    if kind == "device":
        turning = even
        even = even & (interval_s > 0) & (interval_s <= GAP_INTERVALS * usual_s)
    elif kind == "capture":
        even &= np.abs(interval_s) <= _CAPTURE_DELAY_S
    rows = np.flatnonzero(~even if kind != "device" else ~even & (usual_s > 0))
    if len(rows) == 0:
        return pairs
    captured = None if captured_s is None else captured_s[rows]
    of = (step[rows].astype(np.float64), usual[rows], usual_s[rows])
    if kind == "device":
        _by_device(pairs, rows, captured, *of, late_s)
        _single_stamps(pairs, rows, turning, interval_s, usual_s)
    else:
        _by_azimuth(pairs, rows, captured, *of)
    return pairs


def _by_device(
    pairs: Pairs,
    rows: NDArray[np.int64],
    captured: Array | None,
    step: Array,
    usual: Array,
    usual_s: Array,
    late_s: float,
) -> None:
    """Judge uneven pairs of a recording with a device clock."""
    interval = pairs.elapsed_s[rows]
    turned = usual * interval / usual_s
    allowed = _STEP_SHARE * np.abs(usual) + _ENCODER_TICKS + _RATE_SHARE * np.abs(turned)
    told = allowed <= _UNKNOWN_TICKS
    agree = ~told | (_circular(step - turned) <= allowed)
    if captured is not None:
        late = np.maximum(late_s, 0.05 * np.abs(interval))
        agree &= np.abs(interval - captured) <= late
    else:
        # A long pause ends at any azimuth; that it goes on as if there was none is the clock's.
        agree &= told | (_circular(step - usual) > np.abs(usual) / 2)
    standing = np.abs(usual) < 1.0
    agree = (agree | standing) & (interval > 0)
    usual_interval = (interval > 0) & (interval <= GAP_INTERVALS * usual_s)
    gap = agree & ~usual_interval
    pairs.missing[rows[gap]] = np.rint(interval[gap] / usual_s[gap]).astype(np.int64) - 1
    pairs.irregular[rows] = usual_interval & ~agree
    jump = ~agree & ~usual_interval
    packets = np.ones(len(rows))
    turning = jump & ~standing
    forward = np.mod(step * np.sign(usual), AZIMUTH_TICKS)
    if captured is not None:
        turns = (np.abs(usual) * captured / usual_s - forward) / AZIMUTH_TICKS
        forward = forward + AZIMUTH_TICKS * np.maximum(np.rint(turns), 0.0)
    packets[turning] = np.rint(forward[turning] / np.abs(usual[turning]))
    packets = np.clip(packets, 1.0, _MANY)
    pairs.missing[rows[jump]] = packets[jump].astype(np.int64) - 1
    pairs.elapsed_s[rows[jump]] = packets[jump] * usual_s[jump]
    pairs.jump[rows] = jump


def _single_stamps(
    pairs: Pairs,
    rows: NDArray[np.int64],
    turning: NDArray[np.bool_],
    interval_s: Array,
    usual_s: Array,
) -> None:
    """Put right where a single stamp is wrong: the clock jumps, and back with the next packet."""
    first = rows[rows + 1 < len(turning)]
    both = interval_s[first] + interval_s[first + 1] - usual_s[first] - usual_s[first + 1]
    first = first[(np.abs(both) <= usual_s[first] / 2) & turning[first] & turning[first + 1]]
    for at in (first, first + 1):
        pairs.elapsed_s[at] = usual_s[at]
        pairs.missing[at] = 0
        pairs.irregular[at] = False
        pairs.jump[at] = True


def _by_azimuth(
    pairs: Pairs,
    rows: NDArray[np.int64],
    captured: Array | None,
    step: Array,
    usual: Array,
    usual_s: Array,
) -> None:
    """Judge uneven pairs of a recording without a device clock."""
    size = np.abs(usual)
    standing = size < 1.0
    size = np.maximum(size, 1.0)
    signed = step * np.where(usual < 0, -1.0, 1.0)
    back = (signed < size / 2) & (signed > -3.0 * size)
    forward = np.mod(signed, AZIMUTH_TICKS)
    packets = np.rint(forward / size)
    even = np.abs(signed - size) <= size / 2
    if captured is not None:
        turns = np.nan_to_num((size * captured / usual_s - forward) / AZIMUTH_TICKS)
        packets += np.where(even, 0.0, np.maximum(np.rint(turns), 0.0) * AZIMUTH_TICKS / size)
        jump = (captured < -_CAPTURE_DELAY_S) | (even & (captured > _CAPTURE_DELAY_S))
        pairs.jump[rows] = jump
        known = np.nan_to_num(usual_s)
        pairs.elapsed_s[rows[jump]] = (np.maximum(packets, 1.0) * known)[jump]
    packets[standing | back | even] = 1.0
    pairs.irregular[rows] = back & ~even & ~standing
    pairs.missing[rows] = np.clip(np.rint(packets) - 1.0, 0.0, _MANY).astype(np.int64)


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
        found = self._judge(interval[rows], caught if caught is None else caught[rows],
                            step[rows], before[rows])  # fmt: skip
        missing = np.zeros(len(stamps), dtype=np.int64)
        missing[rows] = found.missing
        self._note(found, interval[rows], step[rows], self._packets + int(first))
        told = (found.missing > 0) & ~found.jump if self.kind == "device" else False
        self.broken += int(np.count_nonzero(~_goes_on(step[rows], span[rows]) & ~np.array(told)))
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
                found, known = _pace(step[rows], interval_s[rows]), self._paces[two].interval_s
                usable = found.interval_s > 0 or np.isnan(known)
                self._paces[two] = found if usable else replace(found, interval_s=known)
        usual = np.array([pace.step_ticks for pace in self._paces])[dual]
        usual_s = np.array([pace.interval_s for pace in self._paces])[dual]
        late_s = _CAPTURE_DELAY_S
        if captured_s is not None and self.kind == "device":
            # Times of capture count only if they advance as the device clock does.
            even = (interval_s > 0) & (interval_s <= GAP_INTERVALS * usual_s)
            ratio = captured_s[even].sum() / max(interval_s[even].sum(), 1e-9)
            if 0.5 < ratio < 2.0:
                jitter = np.percentile(np.abs(captured_s - interval_s)[even], 99)
                late_s = float(np.clip(20.0 * jitter, _LEAST_DELAY_S, _CAPTURE_DELAY_S))
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


@dataclass(frozen=True)
class Missing:
    """What is missing in a recording, of what the scanner looks at.

    Attributes
    ----------
    loss : Loss
    view_deg : tuple of (float, float)
        First and last azimuth of every part of the field of view; empty if it is the whole turn.
    share : ndarray of float64, shape (n,)
        Share of the field of view that each rotation misses.
    packets : ndarray of float64, shape (n,)
        The same in packets.
    """

    loss: Loss
    view_deg: tuple[tuple[float, float], ...]
    share: Array
    packets: Array

    def tolerable(self, max_missing: float) -> NDArray[np.bool_]:
        """Tell which rotations miss little.

        Parameters
        ----------
        max_missing : float
            Share of the field of view that a rotation may miss. `FEW_PACKETS` are tolerated as
            well, as a packet may be 2.6 % of a rotation (VLP-16 at 20 Hz), unless this is 0.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        few = (self.packets <= FEW_PACKETS + 1e-6) if max_missing > 0 else False
        return np.asarray((self.share <= max_missing + 1e-9) | few)


class Gaps:
    """Usual interval between packets, and the places where packets are missing."""

    def __init__(self) -> None:
        self._packets = 0
        self._last = (float("nan"), 0)
        #: Of every gap: number of the packet after it, packets missing, azimuths before and after.
        self._gaps: list[NDArray[np.int64]] = []
        #: Azimuths at which packets begin.
        self._starts = np.zeros(AZIMUTH_TICKS, dtype=np.int64)
        #: Of packets with one and with two returns a shot: median interval of every chunk, and the
        #: number of intervals in it.
        self._medians: tuple[list[tuple[float, int]], ...] = ([], [])

    def consume(
        self,
        time_s: Array,
        azimuth: NDArray[np.uint16],
        missing: NDArray[np.int64],
        dual: NDArray[np.bool_],
    ) -> None:
        """Look at consecutive packets.

        Parameters
        ----------
        time_s : ndarray of float64, shape (n,)
        azimuth : ndarray of uint16, shape (n,)
            Raw azimuth of the first block, 0.01 degree.
        missing : ndarray of int64, shape (n,)
            Packets that are missing before each packet.
        dual : ndarray of bool, shape (n,)
            Whether each packet holds two returns of a shot.
        """
        before_s, before = self._last
        interval = np.diff(time_s, prepend=before_s)[0 if self._packets else 1 :]
        of_dual = dual[0 if self._packets else 1 :]
        for two, medians in enumerate(self._medians):
            chosen = interval[of_dual == bool(two)]
            if len(chosen):
                medians.append((float(np.median(chosen)), len(chosen)))
        at = np.flatnonzero(missing)
        previous = np.concatenate([[before], azimuth[:-1]])
        gaps = np.stack([self._packets + at, missing[at], previous[at], azimuth[at]], axis=1)
        self._gaps.append(gaps.astype(np.int64))
        self._starts += np.bincount(azimuth, minlength=AZIMUTH_TICKS)
        self._packets += len(time_s)
        self._last = (float(time_s[-1]), int(azimuth[-1]))

    def interval_s(self, *, dual: bool) -> float:
        """Median time between packets; NaN without time, or if most times are equal.

        It is the weighted median of the medians of all chunks: exact enough for a rate, and its
        memory does not grow with the packets. It is that of packets with two returns of a shot, or
        with one.
        """
        if not self._medians[dual]:
            return float("nan")
        medians = np.array(self._medians[dual])
        ascending = np.argsort(medians[:, 0])
        half = np.searchsorted(np.cumsum(medians[ascending, 1]), medians[:, 1].sum() / 2)
        interval_s = float(medians[ascending[half], 0])
        return interval_s if interval_s > 0 else float("nan")

    def blind(self, step_ticks: float) -> NDArray[np.bool_]:
        """Azimuths at which the scanner does not look.

        That is a gap at the same azimuths in nearly every rotation, as of a scanner whose field of
        view was limited in its settings.

        Parameters
        ----------
        step_ticks : float
            Mean step of the azimuth from packet to packet.

        Returns
        -------
        ndarray of bool, shape (36000,)
        """
        nowhere = np.zeros(AZIMUTH_TICKS, dtype=bool)
        gaps, size = np.concatenate(self._gaps), abs(step_ticks)
        turns = (self._packets + int(gaps[:, 1].sum())) * size / AZIMUTH_TICKS
        if not (turns >= _VIEW_TURNS and len(gaps) >= _VIEW_SHARE * turns):
            return nowhere
        width = int(np.ceil(max(_BLIND_STEPS * size, _BLIND_TICKS)))
        if not 0 < width < AZIMUTH_TICKS:
            return nowhere
        few = int(_BLIND_SHARE * _BLIND_STEPS * turns)
        empty = _ahead(self._starts, width) <= few
        blind = np.asarray(_ahead(empty[::-1].astype(np.int64), width)[::-1] > 0)
        return nowhere if blind.all() else blind

    def result(
        self, step_ticks: float, blind: NDArray[np.bool_], begins: NDArray[np.int64]
    ) -> Missing:
        """Packets that are missing of those that the scanner has sent.

        Parameters
        ----------
        step_ticks : float
            Mean step of the azimuth from packet to packet.
        blind : ndarray of bool, shape (36000,)
            See `blind`.
        begins : ndarray of int64, shape (n,)
            Running number of the block with which every rotation begins.

        Returns
        -------
        Missing
        """
        size = abs(step_ticks) if abs(step_ticks) >= 1.0 else float(AZIMUTH_TICKS)
        seen = int(np.count_nonzero(~blind))
        per_turn = seen / size
        view = _arcs(~blind) if blind.any() else []
        # Rotations begin at azimuth 0, or where the field of view does.
        start = view[0][0] if view and blind[0] else 0
        packets = np.zeros(len(begins))
        gaps = missing = largest = 0
        for number, lost, before, after in np.concatenate(self._gaps):
            whole = int(lost * size / AZIMUTH_TICKS)
            rest = int(lost) - round(whole * AZIMUTH_TICKS / size)
            # A gap of nearly whole turns may end a step before the azimuth at which it begins.
            turned = (after - before) * np.sign(step_ticks) % AZIMUTH_TICKS
            each = turned / (rest + 1) if abs(turned / size - rest - 1) < 1 else size
            at = before + np.sign(step_ticks) * each * np.arange(1, rest + 1)
            at = at[~blind[np.mod(at, AZIMUTH_TICKS).astype(np.int64)]]
            count = round(whole * per_turn) + len(at)
            if not count:
                continue
            gaps, missing, largest = gaps + 1, missing + count, max(largest, count)
            of = np.searchsorted(begins, [12 * number - 1, 12 * number], side="right") - 1
            if whole or of[0] == of[1]:
                packets[of[0]] += count / (1 if of[0] == of[1] else 2)
                packets[of[1]] += count / 2 if of[0] != of[1] else 0.0
                continue
            boundary = before + np.mod(start - before - 1, AZIMUTH_TICKS) + 1
            earlier = np.clip((boundary - at) / size, 0.0, 1.0)
            packets[of] += [earlier.sum(), len(at) - earlier.sum()]
        view_deg = tuple((first / 100.0, last / 100.0) for first, last in view)
        return Missing(Loss(gaps, missing, largest), view_deg, packets / per_turn, packets)


def _ahead(values: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Sum of `width` values from every one on, around the turn."""
    total = np.concatenate([[0], np.cumsum(np.concatenate([values, values[:width]]))])
    return np.asarray(total[width : width + len(values)] - total[: len(values)])


def _arcs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last azimuth of every run, around the turn; the mask is not all true."""
    before = np.roll(mask, 1)
    first = np.flatnonzero(mask & ~before)
    last = np.flatnonzero(~mask & before) - 1
    last = np.mod(last, AZIMUTH_TICKS)
    order_ = [int(last[last >= one][0]) if (last >= one).any() else int(last[0]) for one in first]
    return list(zip(first.tolist(), order_, strict=True))
