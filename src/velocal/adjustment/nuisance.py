"""Derivatives of the misclosure by what is not adjusted, but not exactly known either.

Pose and planes are common to all observations of a station: their errors do not average out, and
reach the parameters through the gain of the adjustment ("consider parameters").
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.stochastic import Stochastic

Array = NDArray[np.float64]


def by_pose(point: Array, normal: Array, towards: Array, translation: Array) -> Array:
    """Derivatives by rotation vector and translation of ``T_scanner_field``, shape (n, 6).

    Parameters
    ----------
    point : ndarray, shape (n, 3)
        Where each beam meets its plane, scanner frame.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane.
    towards : ndarray, shape (n,)
        ``n . u``.
    translation : ndarray, shape (3,)
        Of the transformation.

    Notes
    -----
    The plane moves with the pose: dn = w x n, dd = -(w x n) . t - n . dt, and
    ds = (Q . dn + dd) / (n . u) with Q on the plane.
    """
    turned = np.cross(normal, point - translation)
    return np.concatenate([turned, -normal], axis=1) / towards[:, None]


def by_plane(point: Array, towards: Array) -> Array:
    """Derivatives by normal and offset of the plane, shape (n, 4)."""
    return np.column_stack([point, np.ones(len(point))]) / towards[:, None]


def contributions(
    gain: Array,
    stochastic: Stochastic,
    *,
    point: Array,
    normal: Array,
    towards: Array,
    distance_m: Array,
    station: NDArray[np.integer],
    plane: NDArray[np.integer],
    scale_adjusted: bool,
) -> Iterator[tuple[str, Array]]:
    """Name and covariance of what each source adds to the parameters of a laser.

    Parameters
    ----------
    gain : ndarray, shape (u, n)
        Answer of the parameters to the misclosures (`Step.gain`).
    stochastic : Stochastic
        Sizes of the sources.
    point, normal, towards, distance_m : ndarray
        Of every row; see `by_pose`.
    station, plane : ndarray of int, shape (n,)
        Station of every row, and its plane among those of the station.
    scale_adjusted : bool
        Whether the range scale is a parameter, and so no nuisance.
    """
    u = len(gain)
    pose, planes = np.zeros((u, u)), np.zeros((u, u))
    for number, survey in enumerate(stochastic.survey):
        rows = station == number
        moved = gain[:, rows] @ by_pose(
            point[rows], normal[rows], towards[rows], survey.translation
        )
        pose += moved @ survey.pose @ moved.T
        for index, covariance in enumerate(survey.planes):
            own = rows & (plane == index)
            bent = gain[:, own] @ by_plane(point[own], towards[own])
            planes += bent @ covariance @ bent.T
    yield "pose", pose
    yield "planes", planes
    if not scale_adjusted:
        stretched = gain @ distance_m * stochastic.range_scale
        yield "range_scale", np.outer(stretched, stretched)
    shifted = np.zeros((u, u))
    for number in np.unique(station):
        moved = gain @ (station == number) * stochastic.repeatability_m
        shifted += np.outer(moved, moved)
    yield "repeatability", shifted
