"""Sums of the rows of every laser: all that the population and the posterior need of the data."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from velocal.adjustment.unit.model import UNKNOWNS, WITH_MEAN, Linearised, Shared
from velocal.adjustment.unit.noise import Noise
from velocal.adjustment.unit.station import Bins
from velocal.arrays import Array


@dataclass(frozen=True)
class Layout:
    """Places of the unknowns.

    The random unknowns of a laser are its parameters (`UNKNOWNS`), its shift at every station, and
    its shift on every plane of every station. The common unknowns are the means of the parameters,
    the common shift of every station, and the errors of the survey.

    Attributes
    ----------
    stations : int
    planes : tuple of int
        Number of planes of every station.
    shared : int
        Number of errors of the survey.
    """

    stations: int
    planes: tuple[int, ...]
    shared: int

    @property
    def own(self) -> int:
        """Number of random unknowns of a laser."""
        return len(UNKNOWNS) + self.stations + sum(self.planes)

    @property
    def common(self) -> int:
        """Number of common unknowns."""
        return WITH_MEAN + self.stations + self.shared

    def shift(self, station: int) -> int:
        """Place of the shift of a laser at a station."""
        return len(UNKNOWNS) + station

    def plane(self, station: int) -> slice:
        """Places of the shifts of a laser on the planes of a station."""
        start = len(UNKNOWNS) + self.stations + sum(self.planes[:station])
        return slice(start, start + self.planes[station])

    @property
    def common_shift(self) -> slice:
        """Places of the common shifts of the stations among the common unknowns."""
        return slice(WITH_MEAN, WITH_MEAN + self.stations)

    @property
    def survey(self) -> slice:
        """Places of the errors of the survey among the common unknowns."""
        return slice(WITH_MEAN + self.stations, self.common)


@dataclass(frozen=True)
class Sums:
    """Weighted sums; x are the random unknowns of a laser, b the common ones.

    Attributes
    ----------
    layout : Layout
    xx : ndarray, shape (lasers, q, q)
        ``X' V^-1 X`` of every laser, with V the covariance of its noise.
    xb : ndarray, shape (lasers, q, m)
    bb : ndarray, shape (m, m)
        Of all lasers together.
    x : ndarray, shape (lasers, q)
        ``X' V^-1 z``.
    b : ndarray, shape (m,)
    square : float
        ``z' V^-1 z`` of all lasers.
    log_determinant : float
        Of all V.
    """

    layout: Layout
    xx: Array
    xb: Array
    bb: Array
    x: Array
    b: Array
    square: float
    log_determinant: float


def groups_of(bins: Bins, lasers: int, stations: int) -> list[NDArray[np.int64]]:
    """Rows of every laser at every station; the group number is laser * stations + station."""
    key = bins.mean.laser_id * stations + bins.mean.station_number
    # Bins are sorted by laser and station.
    edges = np.searchsorted(key, np.arange(lasers * stations + 1))
    return [np.arange(a, b) for a, b in itertools.pairwise(edges)]


def sums(
    bins: Bins,
    at: Linearised,
    shared: Shared,
    noise: Noise,
    layout: Layout,
    groups: Sequence[NDArray[np.int64]],
) -> Sums:
    """Sum the rows of all lasers with the inverse covariance of their noise.

    Parameters
    ----------
    bins : Bins
    at : Linearised
    shared : Shared
    noise : Noise
        Of every group.
    layout : Layout
    groups : sequence of ndarray of int
        Rows of every laser at every station; see `groups_of`.
    """
    lasers, q, m = len(groups) // layout.stations, layout.own, layout.common
    xx, xb, x = np.zeros((lasers, q, q)), np.zeros((lasers, q, m)), np.zeros((lasers, q))
    bb, b, square, log_determinant = np.zeros((m, m)), np.zeros(m), 0.0, 0.0
    used = [
        np.flatnonzero(np.any(shared.matrix[bins.mean.station_number == p] != 0.0, axis=0))
        for p in range(layout.stations)
    ]
    u = len(UNKNOWNS)
    for number, rows in enumerate(groups):
        if not len(rows):
            continue
        laser, station = divmod(number, layout.stations)
        n, planes = len(rows), layout.planes[station]
        own = np.zeros((n, u + 1 + planes))
        own[:, :u] = at.matrix[rows]
        own[:, u] = 1.0
        own[np.arange(n), u + 1 + bins.mean.plane_number[rows]] = 1.0
        columns = np.concatenate(
            [own, shared.matrix[np.ix_(rows, used[station])], at.z[rows, None]], axis=1
        )
        covariance = noise.covariance(number, bins.mean.phi[rows], bins.count[rows])
        root = np.linalg.cholesky(covariance)
        white = solve_triangular(root, columns, lower=True, check_finite=False)
        gram = white.T @ white
        e = u + 1 + planes
        in_x = np.concatenate([np.arange(u), [layout.shift(station)], np.r_[layout.plane(station)]])
        in_b = np.concatenate(
            [
                np.arange(WITH_MEAN),
                [layout.common_shift.start + station],
                layout.survey.start + used[station],
            ]
        )
        # The means multiply the columns of the parameters, the common shift that of the shift.
        as_b = np.concatenate([np.arange(WITH_MEAN), [u], e + np.arange(len(used[station]))])
        xx[laser][np.ix_(in_x, in_x)] += gram[:e, :e]
        xb[laser][np.ix_(in_x, in_b)] += gram[:e, as_b]
        bb[np.ix_(in_b, in_b)] += gram[np.ix_(as_b, as_b)]
        x[laser, in_x] += gram[:e, -1]
        b[in_b] += gram[as_b, -1]
        square += float(gram[-1, -1])
        log_determinant += 2.0 * float(np.log(np.diag(root)).sum())
    return Sums(layout, xx, xb, bb, x, b, square, log_determinant)
