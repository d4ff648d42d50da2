"""Solvers of one linearised system ``A delta + w = 0`` behind one interface.

Solvers differ in how they scale rows and columns. Then all use the same thin singular value
decomposition, `linear.decomposed`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from velocal.adjustment.linear import Step, System, across, decomposed, rotated
from velocal.arrays import Array


class Solver(Protocol):
    """One method of adjustment."""

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system.

        Parameters
        ----------
        system : System
            Or a stack of systems, where they are reduced.
        basis : ndarray, shape (u, k), or None
            Space of the corrections that an earlier linearisation decided on; None to decide.

        Returns
        -------
        Step
        """
        ...

    def objective(self, system: System) -> float:
        """What the solver minimises, at the current parameters."""
        ...

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return a system of u + 1 rows with the same solution and objective.

        A solver that needs all rows returns the system itself.

        Parameters
        ----------
        system : System
        keep : bool
            Whether to keep the rotation that `Step.unreduced` needs.

        Returns
        -------
        System
        """
        ...


def solve(solver: Solver, systems: Sequence[System], bases: Sequence[Array | None]) -> list[Step]:
    """Solve several linearised systems, at once if they are reduced.

    Parameters
    ----------
    solver : Solver
    systems : sequence of System
    bases : sequence of ndarray or None
        Basis of each system, see `Solver.step`; either all are None or none is.

    Returns
    -------
    list of Step
    """
    if not systems or systems[0].size is None:
        return [solver.step(*each) for each in zip(systems, bases, strict=True)]
    stack = System(
        np.stack([system.matrix for system in systems]),
        np.stack([system.w for system in systems]),
        np.stack([system.sigma_misclosure for system in systems]),
        systems[0].prior_std,
        np.stack([system.shift for system in systems]),
        np.array([system.size for system in systems]),
    )
    given = [basis for basis in bases if basis is not None]
    found = solver.step(stack, np.stack(given) if given else None)
    names = [field.name for field in fields(Step) if field.name != "row_weight"]
    return [Step(*parts) for parts in zip(*(getattr(found, name) for name in names), strict=True)]


def _column_scale(matrix: Array) -> Array:
    norm = np.sqrt((matrix**2).sum(axis=-2))
    return np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 1.0)


def _alike(sigma_misclosure: Array) -> Array:
    """Root mean square of the standard deviations, for solvers that weight all rows the same."""
    squares = np.einsum("...n,...n->...", sigma_misclosure, sigma_misclosure)
    return np.asarray(np.sqrt(squares / sigma_misclosure.shape[-1]))


class _EqualWeights:
    """Objective and reduction of a solver that gives all misclosures the same weight."""

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """See `Solver.reduced`."""
        return rotated(
            system, np.ones(len(system.w)), float(_alike(system.sigma_misclosure)), keep=keep
        )


class _Weighted:
    """Objective and reduction of a solver with the a-priori weights of the misclosures."""

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures."""
        weighted = system.w / system.sigma_misclosure
        return float(weighted @ weighted)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """See `Solver.reduced`."""
        return rotated(system, 1.0 / system.sigma_misclosure, 1.0, keep=keep)


@dataclass(frozen=True)
class OrdinaryLeastSquares(_EqualWeights):
    """All misclosures have the same weight; no prior; truncation at machine precision."""

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        ones = np.ones(system.w.shape)
        return decomposed(system, ones, _column_scale(system.matrix), 0.0, basis)


@dataclass(frozen=True, kw_only=True)
class GaussHelmert(_Weighted):
    """Adjustment A: conditional with unknowns, ``A delta + B r + w = 0``.

    The observations of a misclosure are its distance and its angle, and no other misclosure has
    them: ``M = (B P^-1 B')^-1`` is diagonal, its elements are the inverse variances of the
    misclosures (`System.sigma_misclosure`), and the solution is that of a weighted adjustment,
    ``delta = -(A' M A)^-1 A' M w``.

    Attributes
    ----------
    truncate_at : float or None
        As for `PaperModel`.
    """

    truncate_at: float | None = None

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        if self.truncate_at is None:
            scale, floor = _column_scale(system.matrix / system.sigma_misclosure[..., None]), 0.0
        else:
            scale, floor = system.prior_std, 1.0 / self.truncate_at
        return decomposed(system, 1.0 / system.sigma_misclosure, scale, floor, basis)


@dataclass(frozen=True, kw_only=True)
class PaperModel(_EqualWeights):
    """Adjustment B, the paper's new model, in its fast form.

    The paper solves ``N = A P^-1 A'`` (n x n), ``k = -N^+ w``, ``delta = P^-1 A' k``. With
    ``P = R'R`` and ``Q = A R^-1`` this is ``delta = -R^-1 Q^+ w``: a singular value
    decomposition of an n x u matrix. Full rank gives ordinary least squares whatever P is;
    otherwise the least-squares solution of least P-norm.

    Attributes
    ----------
    truncate_at : float or None
        A direction is left at zero where its posterior standard deviation for independent noise of
        the stated size exceeds this many prior ones. The stated covariance, which knows that noise
        is correlated, is not used: it follows from the residuals of the adjustment. None truncates
        at machine precision only, as a pseudo-inverse does.
    """

    truncate_at: float | None = 1.0

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        floor = (
            0.0 if self.truncate_at is None else _alike(system.sigma_misclosure) / self.truncate_at
        )
        ones = np.ones(system.w.shape)
        return decomposed(system, ones, system.prior_std, floor, basis)


@dataclass(frozen=True)
class WithPrior(_Weighted):
    """Adjustment C: weighted, with the prior as observations of the corrections.

    ``delta = -(A' M A + P)^-1 A' M w`` with P the inverse prior variances. The rank is always
    full; a parameter that the data do not determine keeps its prior value and standard deviation.
    """

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        n, u = system.matrix.shape[-2:]
        alike = np.broadcast_to(np.eye(u), (*system.shift.shape, u))
        augmented = System(
            np.concatenate([system.matrix, alike], axis=-2),
            np.concatenate([system.w, system.shift], axis=-1),
            np.concatenate(
                [system.sigma_misclosure, np.broadcast_to(system.prior_std, system.shift.shape)],
                axis=-1,
            ),
            system.prior_std,
            system.shift,
        )
        everything = np.broadcast_to(np.diag(system.prior_std), alike.shape)
        weight = 1.0 / augmented.sigma_misclosure
        step = decomposed(augmented, weight, system.prior_std, 0.0, everything)
        influence, prior_influence = step.influence[..., :n], step.influence[..., n:]
        of_prior = prior_influence * system.prior_std
        prior_part = of_prior @ across(of_prior)
        # Share of the data in the information: identity where the prior adds nothing, zero where
        # the data add nothing.
        estimable = alike - of_prior / system.prior_std[:, None]
        return replace(
            step,
            influence=influence,
            cofactor=step.cofactor - prior_part,
            prior_part=prior_part,
            estimable=estimable,
            left=step.left[..., :n, :],
        )

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures and corrections."""
        return super().objective(system) + float(np.sum((system.shift / system.prior_std) ** 2))
