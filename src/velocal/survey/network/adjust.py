"""Least-squares adjustment of a network of polar observations, images and control points.

Functional model: directions, zenith angles and slope distances of levelled total stations, image
coordinates of calibrated cameras (collinearity), coordinates of control points with their full
covariance. Levelled instruments leave four freedoms of the frame, the shifts and the turn about
the plumb line: the datum, fixed by inner constraints over the control points (minimum partial
trace). The normal equations are assembled from a sparse design matrix and bordered by the
constraints; all statistics follow from their inverse. Textbook: Caspary, Concepts of Network
and Deformation Analysis; Luhmann et al., Close-Range Photogrammetry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from velocal.adjustment.quality import variance_factor_test
from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.survey.network.approximate import approximate_unknowns
from velocal.survey.network.model import ControlPoints, ImageObservations, PolarObservations
from velocal.survey.network.normal_equations import (
    DEFECT,
    BorderedNormalEquations,
    control_weight,
    inner_constraints,
)
from velocal.survey.network.structure import Structure

#: Largest change of an unknown (metres, radians) at which the iteration ends.
TOLERANCE = 1e-9
MAX_ITERATIONS = 30


@dataclass(frozen=True)
class Network:
    """An adjusted network.

    Attributes
    ----------
    name : tuple of str
        Points: the control points, then the others in order of appearance.
    xyz : ndarray, shape (n, 3)
        Metres.
    cofactor : ndarray, shape (3n, 3n)
        Covariance as it follows from the stated standard deviations alone, square metres.
    variance_factor : float
        Estimated from the residuals; NaN without redundancy.
    probability : float
        Global test: probability of a variance factor that differs more from 1, on both sides.
    redundancy : int
    largest_residual : float
        Largest normalised residual (Baarda).
    largest_residual_of : str
        The observation that has it.
    setups : dict of str to ndarray, shape (3,)
        Adjusted places of instruments and cameras, metres.
    iterations : int
    """

    name: tuple[str, ...]
    xyz: Array
    cofactor: Array
    variance_factor: float
    probability: float
    redundancy: int
    largest_residual: float
    largest_residual_of: str
    setups: dict[str, Array]
    iterations: int

    @property
    def covariance(self) -> Array:
        """A posteriori: cofactors times the estimated variance factor, square metres."""
        return self.cofactor * self.variance_factor

    def part(self, names: Sequence[str], *, a_priori: bool = False) -> tuple[Array, Array]:
        """Coordinates of some points, and their covariance.

        Parameters
        ----------
        names : sequence of str
        a_priori : bool
            Give the cofactors instead of the a-posteriori covariance.

        Returns
        -------
        xyz : ndarray, shape (m, 3)
            Metres.
        covariance : ndarray, shape (3m, 3m)
            Square metres.
        """
        points = np.array([self.name.index(name) for name in names], dtype=np.int64)
        rows = (3 * points[:, None] + np.arange(3)).ravel()
        covariance = self.cofactor if a_priori else self.covariance
        return self.xyz[points], covariance[np.ix_(rows, rows)]


def adjust_network(
    control: ControlPoints,
    polar: PolarObservations | None = None,
    images: ImageObservations | None = None,
    *,
    where: str = "network",
) -> Network:
    """Adjust points, instruments and cameras, from approximate values that are computed first.

    Parameters
    ----------
    control : ControlPoints
        They define the datum; with a covariance they are observations as well.
    polar : PolarObservations, optional
    images : ImageObservations, optional
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If a point is observed from one set-up only or is not connected to the others, a set-up
        has no approximate place, or the iteration does not converge.
    """
    network = Structure(
        control,
        PolarObservations.joined([]) if polar is None else polar,
        ImageObservations.joined([]) if images is None else images,
        where,
    )
    weight, datum = control_weight(control), inner_constraints(control, network.unknowns)
    unknowns = approximate_unknowns(network)
    for iterations in range(1, MAX_ITERATIONS + 1):
        misclosure, design = network.linearise(unknowns)
        difference = (control.xyz - unknowns.points[: len(control.name)]).ravel()
        system = BorderedNormalEquations(design, weight, datum, where=where)
        if iterations == 1:
            system.check_determined(network.points)
        step = system.step(misclosure, difference)
        unknowns = unknowns.moved(step)
        if np.max(np.abs(step)) < TOLERANCE:
            break
    else:
        raise SurveyError(
            f"the adjustment does not converge in {MAX_ITERATIONS} iterations",
            where=where,
            hint="Look for exchanged point names, wrong units, or a gross error.",
        )
    residual, design = network.linearise(unknowns)
    difference = (control.xyz - unknowns.points[: len(control.name)]).ravel()
    known = len(weight) - DEFECT if control.covariance is not None else 0
    redundancy = len(residual) + known + DEFECT - network.unknowns
    cofactor = BorderedNormalEquations(design, weight, datum, where=where).inverse()
    squares = float(residual @ residual + difference @ weight @ difference)
    factor = squares / redundancy if redundancy else float("nan")
    # Rows are divided by their standard deviations: redundancy numbers are 1 - diag(A Q A').
    share = 1.0 - (design.multiply(design @ cofactor)).sum(axis=1)
    normalised = np.abs(residual) / np.sqrt(np.maximum(share, 1e-6))
    worst = int(np.argmax(normalised))
    size = unknowns.points.size
    places = [*unknowns.instruments[:, :3], *unknowns.cameras]
    return Network(
        name=network.points,
        xyz=unknowns.points,
        cofactor=cofactor[:size, :size],
        variance_factor=factor,
        probability=variance_factor_test(factor, redundancy) if redundancy else float("nan"),
        redundancy=redundancy,
        largest_residual=float(normalised[worst]),
        largest_residual_of=network.label(worst),
        setups=dict(zip(network.instruments + network.cameras, places, strict=True)),
        iterations=iterations,
    )
