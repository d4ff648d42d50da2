"""Residuals of every laser along the azimuth, before and after: means in bins of equal angle.

A map has one row per laser, plane and bin. It is small enough for a page, and shows what a
number per laser hides: edges of planes, patterns along the azimuth, and single bad lasers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.evaluation.candidates import Candidate
from velocal.scanner.beam import points

#: Width of a bin, degrees.
STEP_DEG = 0.5
#: Cells of a whole turn.
BINS = round(360.0 / STEP_DEG)


def residual_map(
    data: Observations, before: Candidate, after: Candidate
) -> dict[str, NDArray[np.generic]]:
    """Average residuals s over bins of the azimuth.

    Parameters
    ----------
    data : Observations
        Returns, or medians, of one station with the plane that each hit; the angle `phi` counts in
        radians about the axis of the scanner.
    before, after : Candidate
        Calibrations whose residuals are compared. Points are computed with `before`.

    Returns
    -------
    dict of str to ndarray
        Columns of `schemas.RESIDUAL_MAP`, one row per laser, plane and bin that has data, sorted
        by laser, then plane, then bin.

    Examples
    --------
    >>> import numpy as np
    >>> from velocal.evaluation.candidates import Role
    >>> from velocal.scanner.models import SCANNERS
    >>> from velocal.scanner.parameters import nominal
    >>> factory = nominal(SCANNERS["VLP-16"])
    >>> wall = np.tile([0.0, -1.0, 0.0], (4, 1))
    >>> phi = np.deg2rad([0.1, 0.2, 0.6, 0.7])
    >>> data = Observations(np.full(4, 5.0), phi, np.zeros(4, int), wall, np.full(4, -4.8))
    >>> candidate = Candidate(Role.FACTORY, factory)
    >>> found = residual_map(data, candidate, candidate)
    >>> found["azimuth_bin"].tolist(), found["count"].tolist()
    ([0, 1], [2, 2])
    """
    azimuth_bin = np.floor(np.rad2deg(data.phi) / STEP_DEG).astype(np.int64) % BINS
    plane = data.plane_number.astype(np.int64)
    laser = data.laser_id.astype(np.int64)
    key = (laser * (int(plane.max(initial=0)) + 1) + plane) * BINS + azimuth_bin
    keys, first, member = np.unique(key, return_index=True, return_inverse=True)
    count = np.bincount(member, minlength=len(keys))
    xyz = points(before.observed(data).distance_m, data.phi, laser, before.parameters)

    def mean(values: Array) -> NDArray[np.float32]:
        sums = np.bincount(member, weights=values, minlength=len(keys))
        return (sums / np.maximum(count, 1)).astype(np.float32)

    return {
        "laser_id": laser[first].astype(np.uint8),
        "plane": plane[first].astype(np.uint8),
        "azimuth_bin": azimuth_bin[first].astype(np.uint16),
        "count": np.minimum(count, np.iinfo(np.uint16).max).astype(np.uint16),
        "x_m": mean(xyz[:, 0]),
        "y_m": mean(xyz[:, 1]),
        "z_m": mean(xyz[:, 2]),
        "before_m": mean(before.misclosure(data)),
        "after_m": mean(after.misclosure(data)),
    }


def root_mean_square(values: Array, laser_id: NDArray[np.integer], n_lasers: int) -> Array:
    """Root mean square of values per laser; NaN for a laser without values.

    Parameters
    ----------
    values : ndarray, shape (n,)
    laser_id : ndarray of int, shape (n,)
    n_lasers : int

    Returns
    -------
    ndarray, shape (n_lasers,)
    """
    count = np.bincount(laser_id, minlength=n_lasers)
    sums = np.bincount(laser_id, weights=np.asarray(values, dtype=float) ** 2, minlength=n_lasers)
    return np.sqrt(np.where(count > 0, sums / np.maximum(count, 1), np.nan))


def as_image(
    columns: dict[str, NDArray[np.generic]], state: str, n_lasers: int, order: Sequence[int]
) -> Array:
    """Arrange a map as an image: rows are lasers, columns are bins, NaN where nothing is.

    Parameters
    ----------
    columns : dict of str to ndarray
        What `residual_map` gives. Where two planes share a bin, the one of more data is shown.
    state : str
        ``before`` or ``after``.
    n_lasers : int
    order : sequence of int
        Lasers from the lowest row to the highest.

    Returns
    -------
    ndarray, shape (n_lasers, BINS)
    """
    image = np.full((n_lasers, BINS), np.nan)
    by_count = np.argsort(columns["count"], kind="stable")
    row = np.empty(n_lasers, dtype=np.int64)
    row[np.asarray(order)] = np.arange(n_lasers)
    image[row[columns["laser_id"][by_count]], columns["azimuth_bin"][by_count]] = columns[
        f"{state}_m"
    ][by_count]
    return image
