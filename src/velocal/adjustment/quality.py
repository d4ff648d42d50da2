"""Quality of an adjustment: noise of the parameters, rank and what it leaves open, tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr

from velocal.adjustment.solvers import Step

Array = NDArray[np.float64]

#: A parameter is held where less than this share of it is determined by the data.
DETERMINED = 0.5


def independent_covariance(step: Step, row_std: Array, variance_factor: float) -> Array:
    """Covariance of the parameters for independent misclosures, shape (u, u)."""
    scaled = step.gain * row_std
    return np.asarray(variance_factor * scaled @ scaled.T)


def block_covariance(step: Step, residuals: Array, block: NDArray[np.int64]) -> tuple[Array, int]:
    """Covariance for misclosures that are correlated within blocks.

    The sum over blocks of the outer product of what the residuals of a block do to the
    parameters, with the small-sample factor of clustered covariances (CR1).

    Parameters
    ----------
    step : Step
    residuals : ndarray, shape (n,)
    block : ndarray of int, shape (n,)
        Block of every row.

    Returns
    -------
    covariance : ndarray, shape (u, u)
    freedom : int
        Degrees of freedom of the estimate: blocks minus rank, at least 1.
    """
    blocks = int(block.max()) + 1
    score = np.stack([np.bincount(block, row * residuals, blocks) for row in step.gain])
    freedom = max(blocks - step.rank, 1)
    n = len(residuals)
    factor = blocks / freedom * (n - 1) / max(n - step.rank, 1)
    return np.asarray(factor * score @ score.T), freedom


def held(names: Sequence[str], step: Step) -> tuple[str, ...]:
    """Parameters that the data do not determine."""
    shares = np.diag(step.estimable)
    return tuple(name for name, share in zip(names, shares, strict=True) if share < DETERMINED)


def open_combinations(names: Sequence[str], step: Step) -> tuple[str, ...]:
    """Combinations of parameters, in units of their prior, that the data leave open.

    Each is written with its largest coefficient as 1; coefficients below 0.05 are left out.
    """
    values, vectors = np.linalg.eigh((step.estimable + step.estimable.T) / 2.0)
    texts = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value < DETERMINED:
            order = np.argsort(-np.abs(vector), kind="stable")
            scaled = vector / vector[order[0]]
            terms = [names[order[0]]]
            terms += [f"{scaled[i]:+.2f} {names[i]}" for i in order[1:] if abs(scaled[i]) >= 0.05]
            texts.append(" ".join(terms))
    return tuple(texts)


def condition(step: Step) -> float:
    """Ratio of the largest to the smallest singular value of the scaled design matrix."""
    largest, smallest = step.singular_values.max(), step.singular_values.min()
    return float(largest / smallest) if smallest > 0 else float("inf")


def variance_factor_test(variance_factor: float, redundancy: int) -> float:
    """Two-sided p-value of H0: the variance factor is 1 (chi-square); NaN without redundancy."""
    if redundancy <= 0:
        return float("nan")
    below = float(chdtr(redundancy, variance_factor * redundancy))
    return 2.0 * min(below, 1.0 - below)
