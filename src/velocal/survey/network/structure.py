"""Structure of a network: which set-up observes which point, and whether all are connected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.survey.network.model import (
    ControlPoints,
    ImageObservations,
    PolarObservations,
    Unknowns,
    image_equations,
    polar_equations,
)

Index = NDArray[np.int64]


class Structure:
    """Observations of a network, with numbered points and set-ups.

    Parameters
    ----------
    control : ControlPoints
    polar : PolarObservations
    images : ImageObservations
    where : str
        File, for errors.

    Attributes
    ----------
    points : tuple of str
        The control points, then the other points in order of appearance.
    instruments, cameras : tuple of str
        Set-ups of the polar observations, and images.
    polar_point, polar_setup, image_point, image_setup : ndarray of int
        Number of the point and of the set-up of every row of the observations.
    unknowns : int
        Number of unknowns: 3 per point, 4 per instrument, 6 per camera.

    Raises
    ------
    SurveyError
        If a point is observed from one set-up only, or is not connected to the others.
    """

    def __init__(
        self,
        control: ControlPoints,
        polar: PolarObservations,
        images: ImageObservations,
        where: str,
    ) -> None:
        self.control, self.polar, self.images, self.where = control, polar, images, where
        self.points = tuple(dict.fromkeys((*control.name, *polar.target, *images.target)))
        self.instruments = tuple(dict.fromkeys(polar.setup))
        self.cameras = tuple(dict.fromkeys(images.setup))
        self.polar_point = _numbered(polar.target, self.points)
        self.polar_setup = _numbered(polar.setup, self.instruments)
        self.image_point = _numbered(images.target, self.points)
        self.image_setup = _numbered(images.setup, self.cameras)
        self.unknowns = 3 * len(self.points) + 4 * len(self.instruments) + 6 * len(self.cameras)
        self._check()

    def _check(self) -> None:
        known = self.control.covariance is not None
        points, setups = len(self.points), len(self.instruments) + len(self.cameras)
        point = np.concatenate([self.polar_point, self.image_point])
        setup = np.concatenate([self.polar_setup, len(self.instruments) + self.image_setup])
        observed, _ = np.unique(np.column_stack([point, setup]), axis=0).T
        count = np.bincount(observed, minlength=points)
        for number, name in enumerate(self.points):
            if count[number] < 2 and not (known and number < len(self.control.name)):
                raise SurveyError(
                    f"point {name!r} is seen from {count[number]} set-up(s)",
                    where=self.where,
                    allowed="2 or more",
                    hint="One set-up does not check a point: observe it from another one too.",
                )
        setup = setup + points
        if known:  # control points are connected through their covariance
            point = np.concatenate([point, np.zeros(len(self.control.name), dtype=np.int64)])
            setup = np.concatenate([setup, np.arange(len(self.control.name))])
        graph = sparse.coo_array(
            (np.ones(len(point)), (point, setup)), shape=(points + setups, points + setups)
        )
        parts, part = connected_components(graph, directed=False)
        if parts > 1:
            lost = int(np.flatnonzero(part[:points] != np.bincount(part).argmax())[0])
            raise SurveyError(
                f"point {self.points[lost]!r} is not connected to the rest of the network",
                where=self.where,
                hint="Set-ups must share points with each other.",
            )

    def label(self, row: int) -> str:
        """Name of an observation by its row of the design matrix."""
        polar = int(np.isfinite(self.polar.value).sum())
        return self.polar.label(row) if row < polar else self.images.label(row - polar)

    def linearise(self, at: Unknowns) -> tuple[Array, sparse.csr_array]:
        """Linearise all observations; rows are divided by their standard deviations.

        Parameters
        ----------
        at : Unknowns

        Returns
        -------
        misclosure : ndarray, shape (n,)
            Observed minus computed.
        design : sparse array, shape (n, unknowns)
            Derivatives of the computed observations.
        """
        point, setup, first = self.polar_point, self.polar_setup, 3 * len(self.points)
        computed, *by = polar_equations(at.points[point], at.instruments[setup])
        misclosure = self.polar.value - computed
        misclosure[:, 0] = np.mod(misclosure[:, 0] + np.pi, 2.0 * np.pi) - np.pi
        polar = _rows(misclosure, self.polar.std, by, point, first + 4 * setup)
        point, setup = self.image_point, self.image_setup
        first += 4 * len(self.instruments)
        computed, *by = image_equations(at.points[point], at.cameras[setup], at.rotations[setup])
        misclosure = self.images.value - computed
        images = _rows(misclosure, self.images.std, by, point, first + 6 * setup)
        size = np.concatenate([np.full(len(w), d.shape[1]) for w, d, _ in (polar, images)])
        design = sparse.csr_array(
            (
                np.concatenate([polar[1].ravel(), images[1].ravel()]),
                np.concatenate([polar[2].ravel(), images[2].ravel()]),
                np.concatenate([[0], np.cumsum(size)]),
            ),
            shape=(len(size), self.unknowns),
        )
        return np.concatenate([polar[0], images[0]]), design


def _rows(
    misclosure: Array, std: Array, derivatives: Sequence[Array], point: Index, first: Index
) -> tuple[Array, Array, Index]:
    """Misclosures, derivatives and their columns, without what was not observed.

    Parameters
    ----------
    misclosure, std : ndarray, shape (n, k)
    derivatives : sequence of ndarray, shape (n, k, 3) and (n, k, u)
        By the point, and by the set-up.
    point : ndarray of int, shape (n,)
        Number of the point.
    first : ndarray of int, shape (n,)
        First column of the unknowns of the set-up.
    """
    there = np.isfinite(misclosure)
    by = np.concatenate(derivatives, axis=2)
    columns = np.column_stack(
        [3 * point[:, None] + np.arange(3), first[:, None] + np.arange(by.shape[2] - 3)]
    )
    std = std[there]
    return misclosure[there] / std, by[there] / std[:, None], columns[np.nonzero(there)[0]]


def _numbered(names: Sequence[str], order: Sequence[str]) -> Index:
    number = {name: row for row, name in enumerate(order)}
    return np.array([number[name] for name in names], dtype=np.int64)
