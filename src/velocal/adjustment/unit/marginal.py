"""Marginal likelihood of the standard deviations of a unit, and the posterior of its unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from velocal.adjustment.unit.sums import Sums
from velocal.arrays import Array


@dataclass(frozen=True)
class Posterior:
    """Posterior for given standard deviations of the random unknowns and of the common ones.

    Random unknowns are ``R v`` with R the diagonal matrix of their standard deviations.

    Attributes
    ----------
    sums : Sums
    std : ndarray, shape (q,)
        Prior standard deviations of the random unknowns, R.
    common_std : ndarray, shape (m,)
        Those of the common unknowns.
    """

    sums: Sums
    std: Array
    common_std: Array

    @cached_property
    def root(self) -> Array:
        """Lower root of ``I + R X'V^-1X R`` of every laser, shape (lasers, q, q)."""
        scaled = self.std[:, None] * self.sums.xx * self.std
        return np.asarray(np.linalg.cholesky(np.eye(len(self.std)) + scaled))

    @cached_property
    def _inverse(self) -> Array:
        """Inverse of `root`. It is used so often that solving each time would cost more."""
        return np.asarray(np.linalg.inv(self.root))

    @cached_property
    def _reduced(self) -> tuple[Array, Array]:
        """``root^-1 R X'V^-1`` times the common columns (lasers, q, m), and times z (lasers, q)."""
        right = np.concatenate([self.sums.xb, self.sums.x[..., None]], axis=2)
        solved = self._inverse @ (self.std[:, None] * right)
        return np.ascontiguousarray(solved[..., :-1]), solved[..., -1]

    @cached_property
    def common_root(self) -> Array:
        """Lower root of M, the normal matrix of the common unknowns, shape (m, m)."""
        reduced = self._reduced[0].reshape(-1, len(self.common_std))
        normal = self.sums.bb - reduced.T @ reduced
        normal[np.diag_indices(len(normal))] += self.common_std**-2.0
        # Where the survey leaves a direction free, rounding must not make M indefinite.
        normal[np.diag_indices(len(normal))] *= 1.0 + 1e-13
        return np.asarray(np.linalg.cholesky(normal))

    @cached_property
    def _right(self) -> Array:
        reduced, own = self._reduced
        m = reduced.shape[2]
        return np.asarray(self.sums.b - reduced.reshape(-1, m).T @ own.ravel())

    @cached_property
    def common(self) -> Array:
        """Mean of the common unknowns, shape (m,)."""
        half = solve_triangular(self.common_root, self._right, lower=True)
        return np.asarray(solve_triangular(self.common_root, half, lower=True, trans="T"))

    @cached_property
    def minus_2_log(self) -> float:
        """Minus twice the marginal log-likelihood, up to a constant."""
        own = self._reduced[1]
        value = self.sums.square - float((own**2).sum()) + self.sums.log_determinant
        value += 2.0 * float(np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum())
        value -= float(self.common @ self._right)
        value += 2.0 * float(np.log(np.diag(self.common_root)).sum())
        return value + 2.0 * float(np.log(self.common_std).sum())

    @cached_property
    def slope(self) -> Array:
        """Derivative of v by the common unknowns, with the sign changed, (lasers, q, m)."""
        return np.asarray(np.swapaxes(self._inverse, 1, 2) @ self._reduced[0])

    @cached_property
    def scaled(self) -> Array:
        """Mean of the random unknowns in units of their standard deviation, (lasers, q)."""
        own = np.einsum("kij,ki->kj", self._inverse, self._reduced[1])
        return np.asarray(own - self.slope @ self.common)

    @cached_property
    def own_covariance(self) -> Array:
        """Covariance of v for given common unknowns, (lasers, q, q)."""
        return np.asarray(np.swapaxes(self._inverse, 1, 2) @ self._inverse)

    @cached_property
    def second_moments(self) -> tuple[Array, Array]:
        """Posterior means of v^2 (lasers, q), and of (b / common_std)^2 (m,)."""
        flat = self.slope.reshape(-1, len(self.common_std))
        spread = solve_triangular(self.common_root, flat.T, lower=True, check_finite=False)
        variance = (spread**2).sum(axis=0).reshape(self.scaled.shape)
        variance += np.diagonal(self.own_covariance, axis1=1, axis2=2)
        inverse = solve_triangular(self.common_root, np.eye(len(self.common_std)), lower=True)
        common = (self.common**2 + (inverse**2).sum(axis=0)) / self.common_std**2
        return self.scaled**2 + variance, common

    def gradient(
        self, members: Sequence[NDArray[np.int64]], common_members: Sequence[NDArray[np.int64]]
    ) -> Array:
        """Derivative of `minus_2_log` by the logarithm of standard deviations.

        Parameters
        ----------
        members, common_members : sequence of ndarray of int
            Which random and which common unknowns each standard deviation belongs to.

        Notes
        -----
        Fisher's identity: the derivative of the log-likelihood is the posterior mean of that of
        the complete likelihood, whose terms are ``-log sigma - u^2 / (2 sigma^2)``.
        """
        own, common = self.second_moments
        return np.array(
            [
                2.0 * float((1.0 - own[:, a]).sum() + (1.0 - common[b]).sum())
                for a, b in zip(members, common_members, strict=True)
            ]
        )
