"""Solvers of one linearised system ``A delta + w = 0`` behind one interface.

Every solver scales rows and columns in its own way and then does the same: a thin singular value
decomposition. `Step` holds what later parts need of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class System:
    """A functional model linearised at the current parameters.

    Attributes
    ----------
    matrix : ndarray, shape (n, u)
        Design matrix A.
    w : ndarray, shape (n,)
        Misclosures.
    row_std : ndarray, shape (n,)
        A-priori standard deviation of every misclosure.
    prior_std : ndarray, shape (u,)
        A-priori standard deviation of the corrections; infinite for none.
    shift : ndarray, shape (u,)
        Current minus initial parameters.
    """

    matrix: Array
    w: Array
    row_std: Array
    prior_std: Array
    shift: Array


@dataclass(frozen=True)
class Step:
    """Solution of a linearised system.

    Attributes
    ----------
    delta : ndarray, shape (u,)
        Corrections of the current parameters.
    gain : ndarray, shape (u, n)
        How the parameters answer to the misclosures: errors e of w move them by ``-gain @ e``.
    cofactor : ndarray, shape (u, u)
        Covariance of the parameters for misclosures of covariance diag(row_std^2), or of unit
        variance for solvers that weight all rows alike.
    prior_part : ndarray, shape (u, u)
        Covariance that the prior, and what is held, leave; zero without.
    estimable : ndarray, shape (u, u)
        Projector on the estimable space, in units of the column scale.
    basis : ndarray, shape (u, rank)
        Space of the corrections, in their units.
    singular_values : ndarray
        Of the scaled matrix.
    leverage : ndarray, shape (n,)
        Diagonal of the hat matrix; one minus it are the redundancy numbers.
    """

    delta: Array
    gain: Array
    cofactor: Array
    prior_part: Array
    estimable: Array
    basis: Array
    singular_values: Array
    leverage: Array

    @property
    def rank(self) -> int:
        """Number of combinations of parameters that the data determine."""
        return int(np.rint(np.trace(self.estimable)))


class Solver(Protocol):
    """One method of adjustment."""

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system.

        Parameters
        ----------
        system : System
        basis : ndarray, shape (u, rank), or None
            Space of the corrections that an earlier linearisation decided on; None to decide.
        damping : float
            Levenberg-Marquardt damping in units of the largest singular value; 0 for none.
        """
        ...

    def objective(self, system: System) -> float:
        """What the solver minimises, at the current parameters."""
        ...


def _decomposed(
    system: System,
    row_weight: Array,
    scale: Array,
    floor: float,
    basis: Array | None,
    damping: float,
) -> Step:
    """Least-squares solution by singular values, in the space of `basis` where that is given.

    Without a basis the directions are found whose singular values exceed `floor` (and machine
    precision); these are the basis.
    """
    weighted = system.matrix * row_weight[:, None]
    if basis is None:
        _, singular, right = np.linalg.svd(weighted * scale, full_matrices=False)
        eps = singular.max(initial=0.0) * max(weighted.shape) * np.finfo(float).eps
        basis = scale[:, None] * right[singular > max(eps, floor)].T
    left, singular, right = np.linalg.svd(weighted @ basis, full_matrices=False)
    # A direction of a given basis may have become empty.
    kept = singular > singular.max(initial=0.0) * np.finfo(float).eps ** 2
    left, singular, right = left[:, kept], singular[kept], right[kept]
    root = basis @ (right.T / singular)
    gain = (root @ left.T) * row_weight
    if damping > 0.0:
        filtered = singular**2 / (singular**2 + (damping * singular.max(initial=0.0)) ** 2)
        delta = -(root * filtered) @ (left.T @ (row_weight * system.w))
    else:
        delta = -(gain @ system.w)
    u = len(scale)
    prior_part, estimable = np.zeros((u, u)), np.eye(u)
    if basis.shape[1] < u:
        # What is not determined keeps its prior error, and what is shares it: (I - G A) of it.
        known = np.where(np.isfinite(system.prior_std), system.prior_std, 0.0)
        left_over = (estimable - gain @ system.matrix) * known
        prior_part = left_over @ left_over.T
        orthonormal = np.linalg.qr(basis / scale[:, None])[0]
        estimable = orthonormal @ orthonormal.T
    return Step(
        delta=delta,
        gain=gain,
        cofactor=root @ root.T,
        prior_part=prior_part,
        estimable=estimable,
        basis=basis,
        singular_values=singular,
        leverage=np.asarray((left**2).sum(axis=1)),
    )


def _column_scale(matrix: Array) -> Array:
    norm = np.sqrt((matrix**2).sum(axis=0))
    return np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 1.0)


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
        step = _decomposed(system, ones, _column_scale(system.matrix), 0.0, basis, damping)
        return step if damping > 0.0 else replace(step, delta=_refined(step, system))

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)


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
            scale, floor = _column_scale(system.matrix / system.row_std[:, None]), 0.0
        else:
            scale, floor = system.prior_std, 1.0 / self.truncate_at
        return _decomposed(system, 1.0 / system.row_std, scale, floor, basis, damping)

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures."""
        return float(np.sum((system.w / system.row_std) ** 2))


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
        floor = 0.0
        if self.truncate_at is not None:
            # Rows are alike here: one standard deviation stands for all.
            floor = float(np.sqrt(np.mean(system.row_std**2))) / self.truncate_at
        ones = np.ones(len(system.w))
        return _decomposed(system, ones, system.prior_std, floor, basis, damping)

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)


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


@dataclass(frozen=True)
class WithPrior:
    """Adjustment C: weighted, with the prior as observations of the corrections.

    ``delta = -(A' M A + P)^-1 A' M w`` with P the inverse prior variances: always of full rank; a
    parameter that the data say nothing about keeps its prior value and standard deviation.
    """

    def step(self, system: System, basis: Array | None = None, damping: float = 0.0) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        n, u = system.matrix.shape
        augmented = System(
            np.vstack([system.matrix, np.eye(u)]),
            np.concatenate([system.w, system.shift]),
            np.concatenate([system.row_std, system.prior_std]),
            system.prior_std,
            system.shift,
        )
        everything = np.diag(system.prior_std)
        step = _decomposed(
            augmented, 1.0 / augmented.row_std, system.prior_std, 0.0, everything, damping
        )
        gain, prior_gain = step.gain[:, :n], step.gain[:, n:]
        prior_part = (prior_gain * system.prior_std) @ (prior_gain * system.prior_std).T
        # Shares of the information: identity where the data say all, zero where the prior does.
        estimable = np.eye(u) - prior_gain * system.prior_std / system.prior_std[:, None]
        return replace(
            step,
            gain=gain,
            cofactor=step.cofactor - prior_part,
            prior_part=prior_part,
            estimable=estimable,
            leverage=step.leverage[:n],
        )

    def objective(self, system: System) -> float:
        """Weighted sum of squared misclosures and corrections."""
        rows = np.sum((system.w / system.row_std) ** 2)
        return float(rows + np.sum((system.shift / system.prior_std) ** 2))
