"""Residuals of every laser along the azimuth, before and after: means in bins of equal angle.

A map has one row per laser, plane and bin. It is small enough for a page, and shows what a
number per laser hides: edges of planes, patterns along the azimuth, and single bad lasers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.evaluation.candidates import Candidate
from velocal.evaluation.planes_in_data import Cloud
from velocal.evaluation.unsurveyed import Seen, fitted_residuals
from velocal.scanner.beam import points
from velocal.scanner.parameters import LaserParameters

#: Width of a bin, degrees.
STEP_DEG = 0.5
#: Cells of a whole turn.
BINS = round(360.0 / STEP_DEG)


@dataclass(frozen=True)
class ResidualMap:
    """Mean residuals, one row per laser, plane and bin that has data; columns of the schema.

    Attributes
    ----------
    laser_id, plane, azimuth_bin, count : ndarray of int, shape (n,)
    x_m, y_m, z_m : ndarray, shape (n,)
        Mean point with the calibration ``before``, scanner frame, metres.
    before_m, after_m : ndarray, shape (n,)
        Mean s, metres.
    """

    laser_id: NDArray[np.integer]
    plane: NDArray[np.integer]
    azimuth_bin: NDArray[np.integer]
    count: NDArray[np.integer]
    x_m: NDArray[np.floating]
    y_m: NDArray[np.floating]
    z_m: NDArray[np.floating]
    before_m: NDArray[np.floating]
    after_m: NDArray[np.floating]


def residual_map(data: Observations, before: Candidate, after: Candidate) -> ResidualMap:
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
    ResidualMap
        Sorted by laser, then plane, then bin.

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
    >>> found.azimuth_bin.tolist(), found.count.tolist()
    ([0, 1], [2, 2])
    """
    laser = data.laser_id.astype(np.int64)
    xyz = points(before.observed(data).distance_m, data.phi, laser, before.parameters)
    return in_bins(
        data.phi,
        laser,
        data.plane_number.astype(np.int64),
        xyz,
        before.misclosure(data),
        after.misclosure(data),
    )


def in_bins(
    phi: Array,
    laser: NDArray[np.int64],
    plane: NDArray[np.int64],
    xyz: Array,
    before_m: Array,
    after_m: Array,
) -> ResidualMap:
    """Average residuals over bins of the azimuth.

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Angle about the axis of the scanner, radians.
    laser, plane : ndarray of int, shape (n,)
    xyz : ndarray, shape (n, 3)
        Points in the scanner frame, metres.
    before_m, after_m : ndarray, shape (n,)
        Residuals s, metres.

    Returns
    -------
    ResidualMap
        Sorted by laser, then plane, then bin.
    """
    azimuth_bin = np.floor(np.rad2deg(phi) / STEP_DEG).astype(np.int64) % BINS
    key = (laser * (int(plane.max(initial=0)) + 1) + plane) * BINS + azimuth_bin
    keys, first, member = np.unique(key, return_index=True, return_inverse=True)
    count = np.bincount(member, minlength=len(keys))

    def mean(values: Array) -> NDArray[np.float32]:
        sums = np.bincount(member, weights=values, minlength=len(keys))
        return (sums / np.maximum(count, 1)).astype(np.float32)

    return ResidualMap(
        laser_id=laser[first].astype(np.uint8),
        plane=plane[first].astype(np.uint8),
        azimuth_bin=azimuth_bin[first].astype(np.uint16),
        count=np.minimum(count, np.iinfo(np.uint16).max).astype(np.uint16),
        x_m=mean(xyz[:, 0]),
        y_m=mean(xyz[:, 1]),
        z_m=mean(xyz[:, 2]),
        before_m=mean(before_m),
        after_m=mean(after_m),
    )


def map_without_survey(seen: Seen, after: LaserParameters) -> ResidualMap:
    """Average residuals s of planes that nobody surveyed over bins of the azimuth.

    Parameters
    ----------
    seen : Seen
        Planes of a recording, and its points with the calibration ``before``.
    after : LaserParameters
        Calibration that is compared with it.

    Returns
    -------
    ResidualMap
        Residuals about the planes that are fitted to the points of each calibration. Planes are
        numbered as in `seen`.
    """
    cloud, corrected = seen.cloud, Cloud.from_beams(seen.cloud, after)
    numbers = [np.full(len(plane.rows), number) for number, plane in enumerate(seen.planes)]
    rows = np.concatenate([np.empty(0, np.int64), *(plane.rows for plane in seen.planes)])
    before_m, after_m = (
        np.concatenate([np.empty(0), *(fitted_residuals(each, plane) for plane in seen.planes)])
        for each in (cloud, corrected)
    )
    return in_bins(
        cloud.phi[rows],
        cloud.laser_id[rows].astype(np.int64),
        np.concatenate([np.empty(0, np.int64), *numbers]),
        cloud.xyz[rows],
        before_m,
        after_m,
    )


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


def as_image(found: ResidualMap, residual_m: NDArray[np.floating], order: Sequence[int]) -> Array:
    """Arrange a map as an image: rows are lasers, columns are bins, NaN where nothing is.

    Parameters
    ----------
    found : ResidualMap
        Where two planes share a bin, the one of more data is shown.
    residual_m : ndarray, shape (n,)
        Its residuals before or after.
    order : sequence of int
        Lasers from the lowest row to the highest.

    Returns
    -------
    ndarray, shape (lasers, BINS)
    """
    image = np.full((len(order), BINS), np.nan)
    by_count = np.argsort(found.count, kind="stable")
    row = np.empty(len(order), dtype=np.int64)
    row[np.asarray(order)] = np.arange(len(order))
    image[row[found.laser_id[by_count]], found.azimuth_bin[by_count]] = residual_m[by_count]
    return image
