"""Standard deviation of a point that is computed with the calibration of a unit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.unit.result import UnitCalibration
from velocal.arrays import Array

#: Parameters that a point depends on, in the order of the covariance matrices of a unit.
_DL, _ALPHA, _V = range(3)


class Use(StrEnum):
    """What a standard deviation is for."""

    PARAMETERS = "parameters"  #: the calibration alone
    MEAN = "mean at another place"  #: many shots, where the scanner did not stand before
    SHOT = "single shot"  #: one shot at another place


@dataclass(frozen=True)
class PointStd:
    """Standard deviations of points in the frame of their beam, metres, each of shape (n,).

    Attributes
    ----------
    along : ndarray
        In the direction of the beam.
    across : ndarray
        Horizontal, at right angles to the beam.
    up : ndarray
        At right angles to both.
    extrapolated : ndarray of bool
        Whether the range is outside those of the calibration.
    """

    along: Array
    across: Array
    up: Array
    extrapolated: NDArray[np.bool_]


def point_std(
    unit: UnitCalibration, laser_id: NDArray[np.integer], range_m: Array, use: Use
) -> PointStd:
    """Standard deviations of points of some lasers at some ranges.

    Parameters
    ----------
    unit : UnitCalibration
    laser_id : ndarray of int, shape (n,)
    range_m : ndarray, shape (n,)
        Raw ranges, metres.
    use : Use

    Returns
    -------
    PointStd

    Notes
    -----
    With u the beam, the derivatives of a point by dl, alpha and v are u, ``-l cos v`` across and
    ``l`` up. Along the beam the correction of the distance has the factor of
    `UnitCalibration.range_factor`; to its variance are added that of the range-dependent error
    (the scale, or the error at the far point), and for the use at another place those of the
    shift of a laser at a station and on a plane, of the pattern along the azimuth and, for one
    shot, of its noise. The scanner's resolution of the azimuth is part of the noise. Offsets of
    the beams are left out: they are smaller than 3 mm.
    """
    laser = np.asarray(laser_id, dtype=np.int64)
    ranges = np.asarray(range_m, dtype=np.float64)
    covariance = unit.calibration.covariance[laser]
    mean = unit.mean_range_m[laser]
    if unit.far_point_m is None:
        factor, other = np.ones(len(ranges)), (ranges - mean) * unit.sigma("sigma_scale")
    else:
        share = np.clip((ranges - mean) / (unit.far_point_m - mean), -np.inf, 1.0)
        factor, other = 1.0 - share, share * unit.sigma("sigma_far")
    along = factor**2 * covariance[:, _DL, _DL] + other**2
    if use is not Use.PARAMETERS:
        along += unit.sigma("sigma_shift") ** 2 + unit.sigma("sigma_plane") ** 2
        along += _by_laser(unit.noise.tau)[laser] ** 2
    if use is Use.SHOT:
        along += _by_laser(unit.noise.omega)[laser] ** 2
    flat = np.cos(unit.calibration.adjusted.v[laser])
    low, high = unit.range_limits_m
    return PointStd(
        np.sqrt(along),
        ranges * flat * np.sqrt(covariance[:, _ALPHA, _ALPHA]),
        ranges * np.sqrt(covariance[:, _V, _V]),
        (ranges < low) | (ranges > high),
    )


def _by_laser(values: Array) -> Array:
    """Root mean square over the stations; the median of the unit for a laser without any."""
    seen = np.isfinite(values).any(axis=1)
    found = np.full(len(values), np.nan)
    found[seen] = np.sqrt(np.nanmean(values[seen] ** 2, axis=1))
    return np.where(seen, found, np.nanmedian(found))
