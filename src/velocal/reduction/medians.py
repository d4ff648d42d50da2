"""Median, spread and number of the raw distances per laser and azimuth bin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.models import AZIMUTH_TICKS, Scanner

#: Quartiles of a normal distribution lie this many standard deviations apart.
QUARTILES_PER_STD = 1.3489795
_NOTHING = np.uint16(65535)


@dataclass(frozen=True)
class Medians:
    """Reduced distances, one element per laser and azimuth bin that was hit often enough.

    Attributes
    ----------
    laser_id : ndarray of uint8, shape (n,)
    azimuth : ndarray of float32, shape (n,)
        Mean raw azimuth of the firings in the bin, 0.01 degree.
    distance : ndarray of float32, shape (n,)
        Median of the raw distances, ticks (`Scanner.distance_tick_m`).
    spread : ndarray of float32, shape (n,)
        Interquartile range over 1.349, ticks; the standard deviation of normal noise.
    count : ndarray of uint16, shape (n,)
        Returns in the bin.
    """

    laser_id: NDArray[np.uint8]
    azimuth: NDArray[np.float32]
    distance: NDArray[np.float32]
    spread: NDArray[np.float32]
    count: NDArray[np.uint16]


def medians_of(
    returns: Mapping[str, NDArray[Any]], scanner: Scanner, *, bin_ticks: int, min_count: int
) -> Medians:
    """Reduce a table of returns; see `binned_medians`.

    Parameters
    ----------
    returns : mapping of str to ndarray
        Columns ``azimuth``, ``laser_id`` and ``distance`` of `schemas.RETURNS`.
    scanner : Scanner
    bin_ticks, min_count : int

    Returns
    -------
    Medians
    """
    return binned_medians(
        returns["azimuth"],
        returns["laser_id"],
        returns["distance"],
        lasers_per_firing=scanner.lasers_per_firing,
        bin_ticks=bin_ticks,
        min_count=min_count,
    )


def binned_medians(
    azimuth: NDArray[np.uint16],
    laser_id: NDArray[np.uint8],
    distance: NDArray[np.uint16],
    *,
    lasers_per_firing: int,
    bin_ticks: int,
    min_count: int,
) -> Medians:
    """Reduce returns to exact medians per laser and azimuth bin.

    Firings are sorted by bin and scattered to a dense (bin, slot, laser) array that is sorted
    along its slots; a bin of `bin_ticks` begins at every multiple of it.

    Parameters
    ----------
    azimuth, laser_id, distance : ndarray, shape (n,)
        Columns of the table of returns, in its order.
    lasers_per_firing : int
        Rows of one firing.
    bin_ticks : int
        Width of a bin, 0.01 degree; a divisor of 36000.
    min_count : int
        Bins with fewer returns are left out.

    Returns
    -------
    Medians
        Sorted by laser, then azimuth.

    Raises
    ------
    VelocalError
        If the bin does not divide the turn or the rows are not whole firings.
    """
    if AZIMUTH_TICKS % bin_ticks:
        raise VelocalError(
            f"an azimuth bin of {bin_ticks / 100:g} deg does not divide the turn",
            allowed="a divisor of 360 deg in steps of 0.01 deg",
        )
    if len(azimuth) % lasers_per_firing:
        raise VelocalError(f"{len(azimuth)} returns are not whole firings of {lasers_per_firing}")
    if len(azimuth) == 0:
        none = np.empty(0, dtype=np.float32)
        return Medians(none.astype(np.uint8), none, none, none, none.astype(np.uint16))
    shape = (-1, lasers_per_firing)
    firing_azimuth = azimuth.reshape(shape)[:, 0]
    first_laser = laser_id.reshape(shape)[:, 0]
    by_firing = distance.reshape(shape)
    parts = []
    for first in np.unique(first_laser):
        chosen = first_laser == first
        part = _dense_medians(firing_azimuth[chosen], by_firing[chosen], bin_ticks, min_count)
        parts.append((part[0] + first, *part[1:]))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    laser, mean_azimuth, median, spread, count = (column[order] for column in columns)
    return Medians(
        laser.astype(np.uint8),
        mean_azimuth.astype(np.float32),
        median.astype(np.float32),
        spread.astype(np.float32),
        count.astype(np.uint16),
    )


def _dense_medians(
    azimuth: NDArray[np.uint16], distance: NDArray[np.uint16], bin_ticks: int, min_count: int
) -> tuple[NDArray[np.generic], ...]:
    """Laser column, mean azimuth, median, spread and count of the bins of one kind of block."""
    bin_id = azimuth // np.uint16(bin_ticks)
    order = np.argsort(bin_id, kind="stable")
    bin_id = bin_id[order]
    bins, begin, firings = np.unique(bin_id, return_index=True, return_counts=True)
    row = np.repeat(np.arange(len(bins)), firings)
    slot = np.arange(len(bin_id)) - begin[row]
    dense = np.full((len(bins), int(firings.max()), distance.shape[1]), _NOTHING)
    # One less than each distance, so that 0, where nothing came back, wraps to the largest number:
    # what does not count is sorted behind all distances.
    dense[row, slot] = distance[order] - np.uint16(1)
    dense.sort(axis=1)
    count = np.sum(dense != _NOTHING, axis=1)
    mean_azimuth = np.add.reduceat(azimuth[order].astype(np.float64), begin) / firings

    keep_bin, keep_laser = np.nonzero(count >= max(min_count, 1))
    n = count[keep_bin, keep_laser]

    def quantile(share: float) -> Array:
        # Linear between order statistics, as numpy.quantile; the median is its 0.5.
        place = share * (n - 1)
        low = np.floor(place).astype(np.int64)
        below = dense[keep_bin, low, keep_laser] + 1.0
        above = dense[keep_bin, np.minimum(low + 1, n - 1), keep_laser] + 1.0
        return np.asarray(below + (place - low) * (above - below))

    spread = (quantile(0.75) - quantile(0.25)) / QUARTILES_PER_STD
    return keep_laser, mean_azimuth[keep_bin], quantile(0.5), spread, n
