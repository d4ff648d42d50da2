"""Packets that are missing in a recording, and the limits of the field of view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.packets.data import BLOCKS
from velocal.recording.rotation_index import Loss
from velocal.scanner.models import AZIMUTH_TICKS

#: This number of missing packets never makes a rotation incomplete, unless none is allowed to miss.
FEW_PACKETS = 3
#: A limit of the field of view is seen in at least this many rotations, and in this share of them.
_VIEW_TURNS = 3
_VIEW_SHARE = 0.8
#: Where no packet begins over this many usual steps and ticks, the scanner does not look. A few
#: packets with damaged azimuths, this share of the usual ones, may begin there.
_BLIND_STEPS = 1.5
_BLIND_TICKS = 300
_BLIND_SHARE = 0.02


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
            of = np.searchsorted(begins, BLOCKS * number - np.array([1, 0]), side="right") - 1
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
    ends = [int(last[last >= one][0]) if (last >= one).any() else int(last[0]) for one in first]
    return list(zip(first.tolist(), ends, strict=True))
