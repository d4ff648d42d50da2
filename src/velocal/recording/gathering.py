"""Points gathered to the firings that they were measured in, as a table of returns has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.packets.dual import ONLY
from velocal.recording.returns import Returns
from velocal.scanner.models import AZIMUTH_TICKS, Scanner

#: Points farther apart than this belong to two firings, and so do those of a longer stretch, ticks:
#: a scanner turns by 8 ticks or more from firing to firing.
_APART, _SHORT = 2, 7


def whole_firings(
    columns: Mapping[str, NDArray[np.int64]], scanner: Scanner, rate_hz: float
) -> Returns:
    """Rows of whole firings: points of one azimuth and bank, and zeros for the other lasers.

    Several points of a laser at one azimuth (two returns of a shot) become several firings.

    Parameters
    ----------
    columns : mapping of str to ndarray of int64, shape (n,)
        ``rotation``, ``timestamp``, ``azimuth``, ``laser_id``, ``distance`` and ``intensity`` of
        points, as in `Returns`, in any order.
    scanner : Scanner
    rate_hz : float
        Rotation rate.

    Returns
    -------
    table : Returns
        By rotation, bank of lasers, and azimuth.
    """
    width = scanner.lasers_per_firing
    bank, lane = np.divmod(columns["laser_id"], width)
    banks = -(-scanner.n_lasers // width)
    stretch = columns["rotation"] * banks + bank
    order = np.lexsort((columns["azimuth"], stretch))
    firing = stretch[order] * AZIMUTH_TICKS + _of_firing(
        columns["azimuth"][order], stretch[order], width
    )
    again = np.lexsort((lane[order], firing))
    order, firing = order[again], firing[again]
    lane = lane[order]
    shot = firing * width + lane
    occurrence = np.arange(len(shot)) - np.searchsorted(shot, shot)
    firings, row = np.unique(np.stack([firing, occurrence]), axis=1, return_inverse=True)
    row = row.reshape(-1)
    shape = (firings.shape[1], width)
    of_stretch, azimuth = np.divmod(firings[0], AZIMUTH_TICKS)
    rotation, of_bank = np.divmod(of_stretch, banks)

    def spread(name: str, kind: type[np.generic]) -> NDArray[Any]:
        dense = np.zeros(shape, kind)
        dense[row, lane] = columns[name][order]
        return dense.reshape(-1)

    return Returns(
        scanner=scanner,
        rotation_rate_hz=rate_hz,
        rotation=np.repeat(rotation.astype(np.uint32), width),
        timestamp=np.repeat(
            spread("timestamp", np.uint32).reshape(shape).max(axis=1, initial=0), width
        ),
        azimuth=np.repeat(azimuth.astype(np.uint16), width),
        laser_id=(of_bank[:, None] * width + np.arange(width)).astype(np.uint8).reshape(-1),
        distance=spread("distance", np.uint16),
        intensity=spread("intensity", np.uint8),
        which=np.full(shape[0] * width, ONLY, np.uint8),
    )


def _of_firing(
    azimuth: NDArray[np.int64], stretch: NDArray[np.int64], width: int
) -> NDArray[np.int64]:
    """Azimuth of the firing of every point, ticks.

    Lasers that fired together have one azimuth, but for the rounding of files: at 1 m, 1 mm is six
    ticks. Points that follow one another closely, and are no more than a firing holds, get their
    mean.

    Parameters
    ----------
    azimuth : ndarray of int64, shape (n,)
        Ticks, ascending within each stretch.
    stretch : ndarray of int64, shape (n,)
        Rotation and bank, ascending.
    width : int
        Lasers of a firing.
    """
    if not len(azimuth):
        return azimuth
    begins = (np.diff(azimuth, prepend=-_APART) > _APART) | (np.diff(stretch, prepend=-1) != 0)
    first = np.flatnonzero(begins)
    count = np.diff(np.append(first, len(azimuth)))
    span = azimuth[first + count - 1] - azimuth[first]
    mean = np.rint(np.add.reduceat(azimuth, first) / count).astype(np.int64)
    one = (span <= _SHORT) & (count <= width)
    return np.where(np.repeat(one, count), np.repeat(mean, count), azimuth)
