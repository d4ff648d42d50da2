"""Datum of a network, and its normal equations bordered by the constraints of the datum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.survey.network.model import ControlPoints

#: Freedoms that levelled instruments leave to the frame: three shifts, a turn about the plumb line.
DEFECT = 4
#: Share of an unknown's own information that is left beside the others: 0 if it is undetermined.
LEAST_DETERMINED = 1e-11


def inner_constraints(control: ControlPoints, unknowns: int) -> Array:
    """Datum: no shift of the control points on average, and no turn about the plumb line.

    Parameters
    ----------
    control : ControlPoints
        The first unknowns.
    unknowns : int
        Number of all unknowns.

    Returns
    -------
    ndarray, shape (unknowns, DEFECT)
        One constraint per column, of unit length.
    """
    xyz = control.xyz - control.xyz.mean(axis=0)
    turn = np.column_stack([-xyz[:, 1], xyz[:, 0], np.zeros(len(xyz))]).ravel()
    border = np.zeros((unknowns, DEFECT))
    border[: xyz.size, :3] = np.tile(np.eye(3), (len(xyz), 1)) / np.sqrt(len(xyz))
    border[: xyz.size, 3] = turn / np.linalg.norm(turn)
    return border


def control_weight(control: ControlPoints) -> Array:
    """Inverse of the covariance of control points, shape (3n, 3n); zero if they have none.

    The covariance is singular, as the datum has no variance: it is inverted in its range.
    """
    covariance = control.covariance
    if covariance is None:
        return np.zeros((3 * len(control.name),) * 2)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2.0)
    vectors = vectors[:, DEFECT:]
    return np.asarray((vectors / values[DEFECT:]) @ vectors.T)


class BorderedNormalEquations:
    """Normal equations bordered by the datum, in units that make their diagonal 1.

    Parameters
    ----------
    design : sparse array, shape (n, u)
        Rows divided by the standard deviations of the observations.
    weight : ndarray, shape (c, c)
        Weights of the first unknowns, which are observed themselves.
    border : ndarray, shape (u, DEFECT)
        See `inner_constraints`.
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If the equations are singular.
    """

    def __init__(
        self, design: sparse.csr_array, weight: Array, border: Array, *, where: str
    ) -> None:
        self.design, self.weight, self.where = design, weight, where
        known = sparse.coo_array(weight)
        normal = design.T @ design + sparse.coo_array(
            (known.data, known.coords), shape=(design.shape[1],) * 2
        )
        own = normal.diagonal()
        self.scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        unit = sparse.diags_array(self.scale)
        self.border = border / np.median(self.scale)
        side = unit @ sparse.csr_array(self.border)
        try:
            self.factors = splu(
                sparse.block_array([[unit @ normal @ unit, side], [side.T, None]], format="csc")
            )
        except RuntimeError:
            raise SurveyError(
                "the observations do not determine the network",
                where=where,
                hint="Add distances, or observations from another place.",
            ) from None

    def step(self, misclosure: Array, difference: Array) -> Array:
        """Corrections of the unknowns; the datum holds the control points on average.

        Parameters
        ----------
        misclosure : ndarray, shape (n,)
            Divided by the standard deviations of the observations.
        difference : ndarray, shape (c,)
            Given minus present coordinates of the control points, metres.

        Returns
        -------
        ndarray, shape (u,)
        """
        right = self.design.T @ misclosure
        right[: len(difference)] += self.weight @ difference
        datum = self.border[: len(difference)].T @ difference
        solved = self.factors.solve(np.concatenate([right * self.scale, datum]))
        return np.asarray(solved[: len(right)] * self.scale)

    def inverse(self) -> Array:
        """Cofactors of all unknowns, shape (u, u)."""
        n = len(self.scale)
        inverse = self.factors.solve(np.eye(n + DEFECT))[:n, :n]
        return np.asarray(inverse * self.scale[:, None] * self.scale)

    def check_determined(self, names: Sequence[str]) -> None:
        """Check that the observations determine every unknown.

        Parameters
        ----------
        names : sequence of str
            Of the points, which are the first unknowns.

        Raises
        ------
        SurveyError
            If one is not determined.
        """
        inflation = np.diag(self.inverse()) / self.scale**2
        bad = np.flatnonzero(~((inflation > 0.0) & (inflation < 1.0 / LEAST_DETERMINED)))
        if len(bad):
            point = bad[0] // 3
            raise SurveyError(
                "the observations do not determine "
                + (f"point {names[point]!r}" if point < len(names) else "the place of a set-up"),
                where=self.where,
                hint="Add distances, or observations from another place.",
            )
