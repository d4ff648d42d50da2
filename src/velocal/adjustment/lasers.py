"""Adjustment of every laser of a scanner by iterated linearisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import design, misclosure
from velocal.adjustment.result import Adjustment
from velocal.adjustment.solvers import Solver
from velocal.parameters import PARAMETERS, ParameterSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observations:
    """Distances to planes whose lasers are adjusted.

    Attributes
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane of each, scanner frame.
    offset : ndarray, shape (n,)
        Its offset, metres.
    """

    distance_m: Array
    phi: Array
    laser_id: NDArray[np.integer]
    normal: Array
    offset: Array

    def of(self, laser: int) -> Observations:
        """Observations of one laser."""
        rows = self.laser_id == laser
        return Observations(
            self.distance_m[rows],
            self.phi[rows],
            self.laser_id[rows],
            self.normal[rows],
            self.offset[rows],
        )

    def misclosure(self, parameters: ParameterSet) -> Array:
        """Distance s along the beam of every observation, metres, shape (n,)."""
        return misclosure(
            self.distance_m, self.phi, self.laser_id, parameters, self.normal, self.offset
        )

    def design(self, parameters: ParameterSet) -> tuple[Array, Array]:
        """Misclosures and design matrix; see `functional.design`."""
        return design(
            self.distance_m, self.phi, self.laser_id, parameters, self.normal, self.offset
        )


@dataclass(frozen=True)
class Stochastic:
    """A-priori knowledge.

    Attributes
    ----------
    noise_std_m : float
        Standard deviation of a misclosure for decisions on rank, metres.
    prior_std : mapping of str to float
        Standard deviation of the corrections that the factory's accuracy allows, by parameter;
        metres and radians. It scales the parameters to each other.
    """

    noise_std_m: float
    prior_std: Mapping[str, float]


def adjust_laser(
    observations: Observations,
    laser: int,
    initial: ParameterSet,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
    *,
    max_iterations: int = 20,
    tolerance: float = 1e-9,
) -> Adjustment:
    """Adjust the parameters `names` of one laser.

    Parameters
    ----------
    observations : Observations
        Of any lasers; those of `laser` are used.
    laser : int
        `laser_id`.
    initial : ParameterSet
        Where to start.
    names : sequence of str
        Parameters to adjust, out of `parameters.PARAMETERS`.
    solver : Solver
        Method.
    stochastic : Stochastic
        A-priori knowledge.
    max_iterations : int
        Largest number of linearisations.
    tolerance : float
        The iteration ends when no correction changes by more than this (metres, radians).

    Returns
    -------
    Adjustment
        With rank 0 and all parameters held where the laser has no observations.
    """
    own = observations.of(laser)
    columns = [PARAMETERS.index(name) for name in names]
    prior_std = np.array([stochastic.prior_std[name] for name in names])
    u, n = len(names), len(own.phi)
    total = np.zeros(u)
    if n == 0:
        return Adjustment(
            tuple(names), total, np.zeros((u, u)), 0, tuple(names), np.zeros(u), np.zeros(0),
            float("nan"), 0, 0, False, "no observations",
        )  # fmt: skip

    def corrected() -> ParameterSet:
        change = {name: np.zeros(len(initial)) for name in names}
        for name, value in zip(names, total, strict=True):
            change[name][laser] = value
        return initial.corrected(change)

    # The first linearisation decides on the rank: were it to change on the way, a direction at
    # the limit could go back and forth for ever.
    rank: int | None = None
    converged, iterations = False, 0
    while not converged and iterations < max_iterations:
        iterations += 1
        s, matrix = own.design(corrected())
        a = matrix[:, columns]
        # Corrections from the start, so that what is not estimable stays at its initial value.
        step = solver.step(a, s - a @ total, prior_std, stochastic.noise_std_m, rank)
        rank = step.rank
        change = step.delta - total
        total = step.delta
        converged = bool(np.max(np.abs(change)) <= tolerance)

    residuals = own.misclosure(corrected())
    redundancy = n - step.rank
    variance = float(residuals @ residuals) / redundancy if redundancy > 0 else float("nan")
    shares = 1.0 - np.diag(step.estimable)
    held = tuple(name for name, share in zip(names, shares, strict=True) if share > 0.5)
    message = "converged" if converged else f"not converged after {iterations} linearisations"
    if step.rank < u:
        combination = ", ".join(held) or "a combination"
        message += f"; rank {step.rank} of {u}, held at the initial value: {combination}"
    return Adjustment(
        tuple(names),
        total,
        (variance if redundancy > 0 else 0.0) * step.cofactor,
        step.rank,
        held,
        step.singular_values,
        residuals,
        variance,
        redundancy,
        iterations,
        converged,
        message,
    )


def adjust_all(
    observations: Observations,
    initial: ParameterSet,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
) -> list[Adjustment]:
    """Adjust every laser on its own; see `adjust_laser`."""
    return [
        adjust_laser(observations, laser, initial, names, solver, stochastic)
        for laser in range(len(initial))
    ]
