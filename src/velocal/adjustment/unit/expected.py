"""The posterior of a unit for data to be measured: squares have their expected values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve

from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.population import Population
from velocal.adjustment.unit.sums import Sums
from velocal.arrays import Array


@dataclass(frozen=True)
class ExpectedPosterior(Posterior):
    """Posterior of the unknowns, with the likelihood that is expected of data to be measured.

    The sums have the expected values of ``x`` and ``b``. What a standard deviation is learnt from,
    the squares of the sums, contain in addition what follows from the standard deviations of
    `truth`.

    Attributes
    ----------
    truth : Posterior
        Its standard deviations are those of the unknowns about their expected values.

    Notes
    -----
    S, C and D are `Sums.xx`, `Sums.xb` and `Sums.bb`; R0^2 and P0 the true variances of the random
    and of the common unknowns; ``L = R (I + R S R)^-1 R``, ``H = D - sum C' L C`` and
    ``J = C' - C' L S``. With x and b the sums of a laser and of all lasers, and
    ``r = b - sum C' L x``, the right side of the common unknowns, less their expected values::

        E[x x'] = S R0^2 S + C P0 C' + S
        E[x r'] = C P0 H + S R0^2 J' + J'
        E[r r'] = H P0 H + sum J R0^2 J' + D - sum (C' L C + (C' L C)' - C' L S L C)
    """

    truth: Posterior

    @cached_property
    def _step(self) -> Array:
        """L of every laser, shape (lasers, q, q)."""
        return self.std[:, None] * self.own_covariance * self.std

    @cached_property
    def _gain(self) -> Array:
        """``L C`` of every laser, shape (lasers, q, m)."""
        return self._step @ self.sums.xb

    @cached_property
    def _left(self) -> Array:
        """``J'`` of every laser: what is left of C, shape (lasers, q, m)."""
        return self.sums.xb - self.sums.xx @ self._gain

    @cached_property
    def _through(self) -> Array:
        """H, shape (m, m): the normal matrix of the common unknowns without their prior."""
        flat = self.sums.xb.reshape(-1, self.sums.xb.shape[2])
        return np.asarray(self.sums.bb - flat.T @ self._gain.reshape(flat.shape))

    @cached_property
    def _own_squares(self) -> Array:
        """``E[x x']`` of every laser, shape (lasers, q, q)."""
        sums, truth = self.sums, self.truth
        common = sums.xb * truth.common_std
        return sums.xx * truth.std**2 @ sums.xx + common @ np.swapaxes(common, 1, 2) + sums.xx

    @cached_property
    def _common_squares(self) -> Array:
        """``E[r r']``, shape (m, m)."""
        sums, truth, through = self.sums, self.truth, self._through
        m = len(through)
        scaled = through * truth.common_std
        left = (truth.std[:, None] * self._left).reshape(-1, m)
        flat, gain = sums.xb.reshape(-1, m), self._gain.reshape(-1, m)
        twice = flat.T @ gain
        noise = sums.bb - twice - twice.T + gain.T @ (sums.xx @ self._gain).reshape(-1, m)
        return np.asarray(scaled @ scaled.T + left.T @ left + noise)

    @cached_property
    def _both_squares(self) -> Array:
        """``E[x r']`` of every laser, shape (lasers, q, m)."""
        sums, truth = self.sums, self.truth
        common = sums.xb * truth.common_std**2 @ self._through
        return common + sums.xx * truth.std**2 @ self._left + self._left

    def _solve(self, right: Array) -> Array:
        return np.asarray(cho_solve((self.common_root, True), right))

    @cached_property
    def minus_2_log(self) -> float:
        """Minus twice the expected marginal log-likelihood, up to a constant."""
        value = super().minus_2_log
        value -= float(np.einsum("kij,kij->", self._step, self._own_squares))
        return value - float(np.trace(self._solve(self._common_squares)))

    @cached_property
    def second_moments(self) -> tuple[Array, Array]:
        """Expected posterior means of v^2 (lasers, q), and of (b / common_std)^2 (m,)."""
        own, common = super().second_moments
        squares = self._solve(self._solve(self._common_squares).T)
        common = common + np.diag(squares) / self.common_std**2
        lasers, q, m = self.sums.xb.shape
        by_common = self._solve(self.sums.xb.reshape(-1, m).T).T.reshape(lasers, q, m)
        mixed = by_common @ np.swapaxes(self._both_squares, 1, 2)
        left = self._own_squares - mixed - np.swapaxes(mixed, 1, 2)
        left = left + self.sums.xb @ squares @ np.swapaxes(self.sums.xb, 1, 2)
        through = self.own_covariance * self.std
        return own + np.einsum("kia,kab,kib->ki", through, left, through), common


@dataclass(frozen=True)
class ExpectedPopulation(Population):
    """The standard deviations of a unit, of which the data will tell what is expected.

    Attributes
    ----------
    true_log : ndarray
        Logarithms of the true values of those that are learnt.
    """

    true_log: Array

    def posterior(self, sums: Sums, log: Array) -> ExpectedPosterior:
        """Posterior for the logarithms of the learnt standard deviations."""
        of, truth = super().posterior(sums, log), super().posterior(sums, self.true_log)
        return ExpectedPosterior(of.sums, of.std, of.common_std, truth)
