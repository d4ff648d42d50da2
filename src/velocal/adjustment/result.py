"""Typed result of the adjustment of one laser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]
#: Degrees of freedom at which Student's distribution is the normal one.
_NORMAL = 1e9


@dataclass(frozen=True)
class Adjustment:
    """Corrections of one laser with what tells how sure they are.

    Attributes
    ----------
    names : tuple of str
        Adjusted parameters, in the order of the vectors and matrices below.
    corrections : ndarray, shape (u,)
        To be added to the initial parameters; metres and radians.
    parts : mapping of str to ndarray, shape (u, u)
        Covariance of the corrections by source: ``noise`` of the observations, ``prior`` (what
        the data leave to it), ``pose``, ``planes``, ``flatness``, ``range_scale``,
        ``repeatability``.
    freedom : ndarray, shape (u,)
        Degrees of freedom of the variance of each parameter in the noise part.
    rank : int
        Number of combinations of parameters that the data determine.
    held : tuple of str
        Parameters that the data determine by less than half. Where the solver truncates they
        stay at the initial value and the prior's standard deviation, but for what they share
        with others in a combination that is determined; `WithPrior` moves them as far as the
        data say.
    open_combinations : tuple of str
        What is not determined, as combinations in units of the prior.
    condition : float
        Of the scaled design matrix.
    singular_values : ndarray
        Of the scaled design matrix.
    residuals : ndarray, shape (n,)
        Misclosures after the adjustment, metres.
    redundancy_numbers : ndarray, shape (n,)
        Share of each misclosure that shows in its residual; they sum to n less the trace of the
        hat matrix, which is the redundancy but for a solver with a prior.
    variance : float
        Sum of squared residuals, with the weights of a robust solver, over the redundancy, square
        metres; NaN without redundancy.
    variance_factor : float
        The same with residuals in units of their prior standard deviation.
    variance_factor_p : float
        Two-sided p-value of the test of H0: variance factor is 1.
    redundancy : int
        n minus rank; n without the rows that a robust solver has rejected.
    iterations : int
        Linearisations used.
    converged : bool
    message : str
        What happened, in words.
    """

    names: tuple[str, ...]
    corrections: Array
    parts: Mapping[str, Array]
    freedom: Array
    rank: int
    held: tuple[str, ...]
    open_combinations: tuple[str, ...]
    condition: float
    singular_values: Array
    residuals: Array
    redundancy_numbers: Array
    variance: float
    variance_factor: float
    variance_factor_p: float
    redundancy: int
    iterations: int
    converged: bool
    message: str

    @property
    def covariance(self) -> Array:
        """Covariance of the corrections, all sources together, shape (u, u)."""
        return np.asarray(sum(self.parts.values()))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the corrections, shape (u, u)."""
        std = self.std
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.covariance / np.outer(std, std))

    @property
    def std(self) -> Array:
        """Standard deviations of the corrections, shape (u,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def noise_std(self) -> Array:
        """The part of `std` from noise, which data of other positions average out, shape (u,)."""
        return np.asarray(np.sqrt(np.diag(self.parts["noise"])))

    def interval(self, level: float = 0.95) -> Array:
        """Half widths of confidence intervals, shape (u,).

        Student's quantile where the noise is estimated from few blocks; by Welch and
        Satterthwaite it nears the normal one as the other, known parts grow.
        """
        noise = np.diag(self.parts["noise"])
        total = np.diag(self.covariance)
        with np.errstate(invalid="ignore", divide="ignore"):
            freedom = np.where(noise > 0, self.freedom * (total / noise) ** 2, _NORMAL)
        quantile = stdtrit(np.clip(freedom, 1.0, _NORMAL), 0.5 + level / 2.0)
        return np.asarray(quantile * self.std)
