"""Solvers of one linearised step ``A delta + w = 0`` behind one interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """Solution of a linearised system.

    Attributes
    ----------
    delta : ndarray, shape (u,)
        Corrections.
    cofactor : ndarray, shape (u, u)
        Covariance of `delta` for misclosures of unit variance.
    rank : int
        Dimension of the estimable space.
    estimable : ndarray, shape (u, u)
        Projector on the estimable space, in units of the prior standard deviations.
    singular_values : ndarray, shape (u,)
        Of the scaled design matrix.
    """

    delta: Array
    cofactor: Array
    rank: int
    estimable: Array
    singular_values: Array


class Solver(Protocol):
    """One method of adjustment."""

    def step(
        self, matrix: Array, w: Array, prior_std: Array, noise_std: float, rank: int | None
    ) -> Step:
        """Solve one linearised system.

        Parameters
        ----------
        matrix : ndarray, shape (n, u)
            Design matrix A.
        w : ndarray, shape (n,)
            Misclosures.
        prior_std : ndarray, shape (u,)
            A-priori standard deviations of the corrections.
        noise_std : float
            Standard deviation of a misclosure, for decisions on rank.
        rank : int or None
            Rank that an earlier linearisation decided on; None to decide.
        """
        ...


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

    def step(
        self, matrix: Array, w: Array, prior_std: Array, noise_std: float, rank: int | None
    ) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        left, singular, right = np.linalg.svd(matrix * prior_std, full_matrices=False)
        if rank is None:
            floor = singular.max(initial=0.0) * max(matrix.shape) * np.finfo(float).eps
            if self.truncate_at is not None:
                floor = max(floor, noise_std / self.truncate_at)
            rank = int((singular > floor).sum())
        kept = np.arange(len(singular)) < rank
        inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
        basis = right[kept]
        root = prior_std[:, None] * (right.T * inverse)
        return Step(
            delta=-prior_std * (right.T @ (inverse * (left.T @ w))),
            cofactor=root @ root.T,
            rank=rank,
            estimable=basis.T @ basis,
            singular_values=singular,
        )
