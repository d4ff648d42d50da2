"""Solvers of one linearised system ``A delta + w = 0`` behind one interface.

Every solver scales rows and columns in its own way and then does the same: a thin singular value
decomposition. `Step` holds what later parts need of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.linear import Step, System, across, decomposed, rotated

Array = NDArray[np.float64]


class Solver(Protocol):
    """One method of adjustment."""

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system.

        Parameters
        ----------
        system : System
        basis : ndarray, shape (u, k), or None
            Space of the corrections that an earlier linearisation decided on; None to decide.
        damping : float
            Levenberg-Marquardt damping in units of the largest singular value; 0 for none.
        """
        ...

    def objective(self, system: System) -> float:
        """What the solver minimises, at the current parameters."""
        ...

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return a system of u + 1 rows of the same solution and objective; itself if none is.

        Parameters
        ----------
        system : System
        keep : bool
            Whether to keep what `Step.unreduced` needs.
        """
        ...


def steps(solver: Solver, systems: Sequence[System], bases: Sequence[Array | None]) -> list[Step]:
    """Solve several linearised systems, at once if they are reduced.

    Parameters
    ----------
    solver : Solver
    systems : sequence of System
    bases : sequence
        Of each; see `Solver.step`. None is for all of them.
    """
    if not systems or systems[0].size is None:
        return [solver.step(*each) for each in zip(systems, bases, strict=True)]
    stack = System(
        np.stack([system.matrix for system in systems]),
        np.stack([system.w for system in systems]),
        np.stack([system.row_std for system in systems]),
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


def _alike(row_std: Array) -> Array:
    """One standard deviation that stands for all, where rows are weighted alike."""
    squares = np.einsum("...n,...n->...", row_std, row_std)
    return np.asarray(np.sqrt(squares / row_std.shape[-1]))


def _squares(system: System) -> float:
    weighted = system.w / system.row_std
    return float(weighted @ weighted)


def _refined(step: Step, system: System) -> Array:
    """Correct an unweighted solution by what its normal equations leave, in extended precision.

    Residuals far larger than what the columns reach otherwise cost digits: three of NIST's set
    Wampler5. (Where the platform has no extended precision nothing is gained or lost.)
    """
    matrix, w = system.matrix.astype(np.longdouble), system.w.astype(np.longdouble)
    delta = step.delta
    for _ in range(2):
        left_over = matrix.T @ (w + matrix @ delta.astype(np.longdouble))
        delta = delta - step.cofactor @ left_over.astype(np.float64)
    return delta


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """All misclosures alike, no prior; truncation at machine precision."""

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        ones = np.ones(len(system.w))
        step = decomposed(system, ones, _column_scale(system.matrix), 0.0, basis, damping)
        return step if damping > 0.0 else replace(step, delta=_refined(step, system))

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return the system: corrections are refined with all its rows."""
        return system


@dataclass(frozen=True)
class GaussHelmert:
    """Adjustment A: conditional with unknowns, ``A delta + B r + w = 0``.

    The observations of a misclosure are its distance and its angle, and no other misclosure has
    them: ``M = (B P^-1 B')^-1`` is diagonal, its elements are the inverse variances of the
    misclosures (`System.row_std`), and ``delta = -(A' M A)^-1 A' M w`` is a weighted adjustment.

    Attributes
    ----------
    truncate_at : float or None
        As for `PaperModel`.
    """

    truncate_at: float | None = None

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        if self.truncate_at is None:
            scale, floor = _column_scale(system.matrix / system.row_std[..., None]), 0.0
        else:
            scale, floor = system.prior_std, 1.0 / self.truncate_at
        return decomposed(system, 1.0 / system.row_std, scale, floor, basis, damping)

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures."""
        return _squares(system)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """See `Solver.reduced`."""
        return rotated(system, 1.0 / system.row_std, 1.0, keep=keep)


@dataclass(frozen=True)
class PaperModel:
    """Adjustment B, the paper's new model, in its fast form.

    The paper solves ``N = A P^-1 A'`` (n x n), ``k = -N^+ w``, ``delta = P^-1 A' k``. With
    ``P = R'R`` and ``Q = A R^-1`` this is ``delta = -R^-1 Q^+ w``: a singular value
    decomposition of an n x u matrix. Full rank gives ordinary least squares whatever P is;
    otherwise the least-squares solution of least P-norm.

    Attributes
    ----------
    truncate_at : float or None
        A direction is left at zero where its posterior standard deviation exceeds this many
        prior ones. None truncates at machine precision only, as a pseudo-inverse does.
    """

    truncate_at: float | None = 1.0

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        floor = 0.0 if self.truncate_at is None else _alike(system.row_std) / self.truncate_at
        ones = np.ones(system.w.shape)
        return decomposed(system, ones, system.prior_std, floor, basis, damping)

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """See `Solver.reduced`."""
        return rotated(system, np.ones(len(system.w)), float(_alike(system.row_std)), keep=keep)


@dataclass(frozen=True)
class PaperLiteral:
    """Adjustment B as printed, with the n x n pseudo-inverse: a reference for small n.

    Attributes
    ----------
    cutoff : float
        Eigenvalues of N below this share of the largest are taken as zero; N squares the
        singular values, so that they are known to half the digits only.
    """

    cutoff: float = 1e-12

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`. Damping is not supported."""
        a = system.matrix
        p_inverse = np.diag(system.prior_std**2)
        n = a @ p_inverse @ a.T
        gain = p_inverse @ a.T @ np.linalg.pinv(n, rcond=self.cutoff, hermitian=True)
        values = np.linalg.eigvalsh(n)[::-1][: a.shape[1]]
        kept = values > self.cutoff * values[0]
        # What the literal form does not give is taken from the fast one.
        scaled = np.linalg.svd(a * system.prior_std, full_matrices=False)[2][kept]
        fast = PaperModel(None).step(system, system.prior_std[:, None] * scaled.T)
        # From the initial parameters: least P-norm means of all corrections, not of the last.
        rest = system.w - a @ system.shift
        return replace(
            fast,
            delta=-(gain @ rest) - system.shift,
            gain=gain,
            cofactor=gain @ gain.T,
            singular_values=np.sqrt(np.maximum(values, 0.0)),
        )

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return the system: this is the form with all its rows."""
        return system


@dataclass(frozen=True)
class WithPrior:
    """Adjustment C: weighted, with the prior as observations of the corrections.

    ``delta = -(A' M A + P)^-1 A' M w`` with P the inverse prior variances: always of full rank; a
    parameter that the data say nothing about keeps its prior value and standard deviation.
    """

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        n, u = system.matrix.shape[-2:]
        alike = np.broadcast_to(np.eye(u), (*system.shift.shape, u))
        augmented = System(
            np.concatenate([system.matrix, alike], axis=-2),
            np.concatenate([system.w, system.shift], axis=-1),
            np.concatenate(
                [system.row_std, np.broadcast_to(system.prior_std, system.shift.shape)], axis=-1
            ),
            system.prior_std,
            system.shift,
        )
        everything = np.broadcast_to(np.diag(system.prior_std), alike.shape)
        step = decomposed(
            augmented, 1.0 / augmented.row_std, system.prior_std, 0.0, everything, damping
        )
        gain, prior_gain = step.gain[..., :n], step.gain[..., n:]
        of_prior = prior_gain * system.prior_std
        prior_part = of_prior @ across(of_prior)
        # Shares of the information: identity where the data say all, zero where the prior does.
        estimable = alike - of_prior / system.prior_std[:, None]
        return replace(
            step,
            gain=gain,
            cofactor=step.cofactor - prior_part,
            prior_part=prior_part,
            estimable=estimable,
            left=step.left[..., :n, :],
        )

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures and corrections."""
        return _squares(system) + float(np.sum((system.shift / system.prior_std) ** 2))

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """See `Solver.reduced`."""
        return rotated(system, 1.0 / system.row_std, 1.0, keep=keep)
