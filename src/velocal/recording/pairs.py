"""What lies between packets that follow one another: missing packets, or a clock that jumps.

From one packet to the next the head turns by the usual step in the usual time. Where time, azimuth
and the number of packets do not agree, the azimuth and the times of capture decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.scanner.models import AZIMUTH_TICKS

#: Packets farther apart than this many usual intervals have a gap between them.
GAP_INTERVALS = 1.5
#: Times of capture may be late by this time.
CAPTURE_DELAY_S = 1.0
#: The azimuth may differ from what is expected by this share of the usual step, ...
_STEP_SHARE = 0.75
#: ... by the steps of a coarse encoder (0.09 deg), and by this share of the turning in between.
_ENCODER_TICKS = 12
_RATE_SHARE = 0.02
#: If the uncertainty is larger than this, the azimuth cannot tell how long a gap is.
_UNKNOWN_TICKS = 9000
#: No more packets than this can be missing: times of capture may be any number.
_MANY = 1e9


def signed(ticks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Angles, 0.01 degree, from half a turn backward to half a turn forward."""
    half = AZIMUTH_TICKS // 2
    return np.mod(ticks + half, AZIMUTH_TICKS) - half


def goes_on(step: NDArray[np.int64], span: NDArray[np.int64]) -> NDArray[np.bool_]:
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


def pace_of(step: NDArray[np.int64], interval_s: Array) -> Pace:
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
    late_s: float = CAPTURE_DELAY_S,
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
        even &= np.abs(interval_s) <= CAPTURE_DELAY_S
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
    ahead = step * np.where(usual < 0, -1.0, 1.0)
    back = (ahead < size / 2) & (ahead > -3.0 * size)
    forward = np.mod(ahead, AZIMUTH_TICKS)
    packets = np.rint(forward / size)
    even = np.abs(ahead - size) <= size / 2
    if captured is not None:
        turns = np.nan_to_num((size * captured / usual_s - forward) / AZIMUTH_TICKS)
        packets += np.where(even, 0.0, np.maximum(np.rint(turns), 0.0) * AZIMUTH_TICKS / size)
        jump = (captured < -CAPTURE_DELAY_S) | (even & (captured > CAPTURE_DELAY_S))
        pairs.jump[rows] = jump
        known = np.nan_to_num(usual_s)
        pairs.elapsed_s[rows[jump]] = (np.maximum(packets, 1.0) * known)[jump]
    packets[standing | back | even] = 1.0
    pairs.irregular[rows] = back & ~even & ~standing
    pairs.missing[rows] = np.clip(np.rint(packets) - 1.0, 0.0, _MANY).astype(np.int64)
