"""Uncertainty from quantities that are not adjusted, but not known exactly ("consider parameters").

Pose and planes, for instance, are common to all observations of a station, so that their errors do
not average out. They enter the misclosures by the derivatives of this module, and the parameters
through the influence of the misclosures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.stochastic import Stochastic

Array = NDArray[np.float64]

#: Length over which the deviation of a surface from its plane is about the same, metres. It is the
#: integral of the correlation along a line, for waves of 0.7 to 2.5 m in all directions.
FLATNESS_LENGTH_M = 0.5


def by_pose(point: Array, normal: Array, towards: Array, translation: Array) -> Array:
    """Derivatives by rotation vector and translation of ``T_scanner_site``, shape (n, 6).

    Parameters
    ----------
    point : ndarray, shape (n, 3)
        Where each beam meets its plane, scanner frame.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane.
    towards : ndarray, shape (n,)
        ``n . u``, with u the direction of the beam.
    translation : ndarray, shape (3,) or (n, 3)
        Translation of the transformation, metres.

    Returns
    -------
    ndarray, shape (n, 6)
        Metres per radian, and metres per metre.

    Notes
    -----
    The plane moves with the pose: dn = w x n, dd = -(w x n) . t - n . dt, and
    ds = (Q . dn + dd) / (n . u) with Q on the plane.
    """
    x, y, z = (point - translation).T
    n_x, n_y, n_z = normal.T
    found = np.empty((6, len(point)))
    found[0], found[1], found[2] = n_y * z - n_z * y, n_z * x - n_x * z, n_x * y - n_y * x
    found[3:] = -normal.T
    found /= towards
    return found.T


def by_plane(point: Array, towards: Array) -> Array:
    """Derivatives by normal and offset of the plane.

    Parameters
    ----------
    point : ndarray, shape (n, 3)
        Where each beam meets its plane, scanner frame.
    towards : ndarray, shape (n,)
        ``n . u``, with u the direction of the beam.

    Returns
    -------
    ndarray, shape (n, 4)
    """
    found = np.empty((4, len(point)))
    found[:3], found[3] = point.T, 1.0
    found /= towards
    return found.T


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of misclosures by what is not adjusted, and what those by pose and plane need.

    Attributes
    ----------
    point, normal, towards : ndarray
        Of every row; see `by_pose` and `by_plane`.
    offset : ndarray, shape (n,)
        Derivative by the deviation of the surface from its plane, times the standard deviation
        of the latter, metres.
    stretch : ndarray, shape (n,)
        Derivative by a range scale: the raw distance, metres.
    begins : ndarray of bool, shape (n,)
        First row of every segment. The rows of a segment meet the surface near each other and
        share its deviation from the plane.
    station, number : ndarray of int, shape (n,)
        Station of every row, and its plane among those of the station.
    """

    point: Array
    normal: Array
    towards: Array
    offset: Array
    stretch: Array
    begins: NDArray[np.bool_]
    station: NDArray[np.integer]
    number: NDArray[np.integer]

    def take(self, rows: slice) -> Derivatives:
        """Return those of some rows."""
        return Derivatives(*(getattr(self, field.name)[rows] for field in fields(self)))


def derivatives(
    stochastic: Stochastic,
    *,
    point: Array,
    normal: Array,
    towards: Array,
    distance_m: Array,
    phi: Array,
    laser_id: NDArray[np.integer],
    station: NDArray[np.integer],
    plane: NDArray[np.integer],
) -> Derivatives:
    """Derivatives for rows that are sorted by laser, station and rotational angle.

    Parameters
    ----------
    stochastic : Stochastic
        Sizes of the sources.
    point, normal, towards : ndarray
        Of every row; see `by_pose`.
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance, rotational angle and laser of every row.
    station, plane : ndarray of int, shape (n,)
        Station of every row, and its plane among those of the station.

    Returns
    -------
    Derivatives
    """
    n, flatness = len(point), np.zeros(len(point))
    for index, survey in enumerate(stochastic.survey):
        own = station == index
        flatness[own] = survey.flatness_m[plane[own]]
    # Cut the trace of a laser on a plane into segments.
    path = np.zeros(n)
    along = np.diff(point.T)
    np.cumsum(np.sqrt(np.einsum("in,in->n", along, along)), out=path[1:])
    changes = np.zeros(n, dtype=bool)
    for key in (laser_id, station, plane, (path / FLATNESS_LENGTH_M).astype(np.int64)):
        changes[1:] |= key[1:] != key[:-1]
    changes[:1] = True
    begins, segment = changes.copy(), np.cumsum(changes) - 1
    if stochastic.block_rad is not None:
        # The noise part already contains what is the same within a block. Of the variance of a
        # segment that n blocks share equally, 1 - 1 / n is left.
        block = np.floor(phi / stochastic.block_rad)
        changes[1:] |= block[1:] != block[:-1]
        piece = np.cumsum(changes) - 1
        rows = np.bincount(piece)
        within = np.bincount(segment, rows[piece]) / np.bincount(segment) ** 2
        flatness *= np.sqrt(1.0 - within)[segment]
    return Derivatives(
        point,
        normal,
        towards,
        flatness / towards,
        distance_m,
        begins,
        station,
        plane,
    )


def contributions(
    influence: Array, stochastic: Stochastic, by: Derivatives, *, scale_adjusted: bool
) -> Iterator[tuple[str, Array]]:
    """Covariance of the parameters of a laser from every source.

    Parameters
    ----------
    influence : ndarray, shape (u, n)
        Change of the parameters by the misclosures (`Step.influence`).
    stochastic : Stochastic
        Sizes of the sources.
    by : Derivatives
        Of the rows of the laser.
    scale_adjusted : bool
        Whether the range scale is adjusted; its uncertainty is then not a source.

    Yields
    ------
    name : str
    covariance : ndarray, shape (u, u)
    """
    u, known, stations = len(influence), stochastic.survey, int(by.station.max()) + 1
    pose, bent = np.zeros((2, u, u))
    translation = known[0].translation if known else np.zeros(3)
    if len(known) > 1:
        translation = np.stack([survey.translation for survey in known])[by.station]
    derivatives = np.vstack(
        [
            by_pose(by.point, by.normal, by.towards, translation).T,
            by_plane(by.point, by.towards).T,
            by.stretch,
            np.ones(len(by.begins)),
        ]
    ).T
    # Changes of the parameters by all derivatives, for every station and plane.
    planes = int(by.number.max()) + 1
    group = by.station * planes + by.number
    masked = influence * (group == np.arange(stations * planes)[:, None, None])
    change = (masked.reshape(-1, len(group)) @ derivatives).reshape(stations, planes, u, -1)
    for own, survey in zip(change, known, strict=False):
        moved = own[..., :6].sum(axis=0)
        pose += moved @ survey.pose @ moved.T
        for part, covariance in zip(own, survey.planes, strict=False):
            bent += part[:, 6:10] @ covariance @ part[:, 6:10].T
    yield "pose", pose
    yield "planes", bent
    uneven = np.add.reduceat(influence * by.offset, np.flatnonzero(by.begins), axis=1)
    yield "flatness", uneven @ uneven.T
    if not scale_adjusted:
        stretched = change[..., 10].sum(axis=(0, 1)) * stochastic.range_scale
        yield "range_scale", np.outer(stretched, stretched)
    shifted = change[..., 11].sum(axis=1) * stochastic.repeatability_m
    yield "repeatability", shifted.T @ shifted
