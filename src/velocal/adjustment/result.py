"""Typed result of the adjustment of one laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Adjustment:
    """Corrections of one laser with what tells how sure they are.

    Attributes
    ----------
    names : tuple of str
        Adjusted parameters, in the order of the vectors and matrices below.
    corrections : ndarray, shape (u,)
        To be added to the initial parameters; metres and radians.
    covariance : ndarray, shape (u, u)
        Of the corrections; of the estimable part only where the rank is deficient.
    rank : int
        Number of combinations of parameters that the data determine.
    held : tuple of str
        Parameters that the data do not determine: their share outside the estimable space
        exceeds one half.
    singular_values : ndarray, shape (u,)
        Of the design matrix scaled by the prior standard deviations.
    residuals : ndarray, shape (n,)
        Misclosures after the adjustment, metres.
    variance : float
        Sum of squared residuals over the redundancy, square metres; NaN without redundancy.
    redundancy : int
        n minus rank.
    iterations : int
        Linearisations used.
    converged : bool
    message : str
        What happened, in words.
    """

    names: tuple[str, ...]
    corrections: Array
    covariance: Array
    rank: int
    held: tuple[str, ...]
    singular_values: Array
    residuals: Array
    variance: float
    redundancy: int
    iterations: int
    converged: bool
    message: str

    @property
    def std(self) -> Array:
        """Standard deviations of the corrections, NaN for held parameters, shape (u,)."""
        held = np.array([name in self.held for name in self.names])
        return np.where(held, np.nan, np.sqrt(np.diag(self.covariance)))
