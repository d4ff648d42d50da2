"""Quality of an adjustment: noise of the parameters, rank, what is not estimable, tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.linear import Step
from velocal.arrays import Array

#: A parameter is weakly determined where the data determine less than this share of it.
DETERMINED = 0.5
#: Blocks show a variance if their residuals keep more than this share of it.
LEAST_SHOWN = 0.1
#: Factor for what sums over blocks miss: errors on both sides of the edge between two blocks are
#: correlated. For a correlation of exp(-d^2 / 4 k^2) and blocks of width 10 k it is
#: 1 / (1 - 1 / (5 sqrt(pi))).
NEIGHBOURS = 1.0 / (1.0 - 0.2 / np.sqrt(np.pi))


def independent_covariance(step: Step, sigma_misclosure: Array, variance_factor: float) -> Array:
    """Covariance of the parameters for independent misclosures, shape (u, u)."""
    scaled = step.influence * sigma_misclosure
    return np.asarray(variance_factor * scaled @ scaled.T)


def block_covariance(
    influence: Array,
    residuals: Array,
    block: NDArray[np.int64],
    matrix: Array,
    sigma_misclosure: Array,
    laser_id: NDArray[np.integer],
    rank: NDArray[np.integer],
    weight: Array | None = None,
) -> tuple[Array, Array]:
    """Covariance for misclosures that are correlated within blocks, for every laser.

    A cluster-robust ("sandwich") estimate: the sum over blocks of the outer product of the
    block's score, which is the change of the parameters by the residuals of the block. Residuals
    underestimate errors, most of all in blocks of high leverage. Therefore each parameter is
    scaled by the share of its variance that is lost in this way when the misclosures are
    independent (bias-reduced, CR2); the same assumption gives its degrees of freedom (Bell and
    McCaffrey). `NEIGHBOURS` accounts for the correlation between neighbouring blocks.

    Parameters
    ----------
    influence : ndarray, shape (u, n)
        Change of the parameters of its laser by every misclosure (`Step.influence`).
    residuals : ndarray, shape (n,)
        Misclosures after the adjustment.
    block : ndarray of int, shape (n,)
        Block of every row, numbered 0, 1, ... laser after laser.
    matrix : ndarray, shape (n, u)
        Design matrix.
    sigma_misclosure : ndarray, shape (n,)
        A-priori standard deviations of the misclosures.
    laser_id : ndarray of int, shape (n,)
        Laser of every row.
    rank : ndarray of int, shape (lasers,)
        Of every laser.
    weight : ndarray, shape (n,), optional
        Of the rows, by a robust solver.

    Returns
    -------
    covariance : ndarray, shape (lasers, u, u)
    dof : ndarray, shape (lasers, u)
        Degrees of freedom of the variance of each parameter, at least 1.

    Notes
    -----
    G_g and A_g are influence and design of block g, D_g the a-priori variances of its rows, e the
    errors. With all parameters either determined or fixed, the residuals are ``e - A G e``, the
    score of g is ``G_g e_g - K_g G e`` with K_g = G_g A_g, and E[score_g score_h'] = delta_gh S_g
    - K_g S_h - S_g K_h' + K_g S K_h' with S_g = G_g D_g G_g', and S the sum of all S_g. Where the
    blocks are too few to show a variance, the variance factor is used, as if the rows of a block
    were one.
    """
    u, lasers = len(influence), len(rank)
    blocks = int(block.max()) + 1
    scaled = influence * sigma_misclosure

    def sums(values: Array) -> Array:
        return np.bincount(block, values, blocks).astype(np.float64, copy=False)

    score = np.array([sums(row * residuals) for row in influence])
    k = np.array([[sums(row * column) for column in matrix.T] for row in influence])
    s = np.empty((u, u, blocks))
    for i in range(u):
        for j in range(i + 1):
            s[i, j] = s[j, i] = sums(scaled[i] * scaled[j])
    owner = np.empty(blocks, dtype=np.int64)
    owner[block] = laser_id
    ends = np.cumsum(np.bincount(owner, minlength=lasers))
    rows = np.bincount(block)
    weight = np.ones(len(residuals)) if weight is None else weight
    squares = np.bincount(laser_id, weight * (residuals / sigma_misclosure) ** 2, lasers)
    redundancy = np.bincount(laser_id, weight > 0.0, lasers) - rank
    covariance, dof = np.zeros((lasers, u, u)), np.ones((lasers, u))
    for laser in np.unique(owner):
        own = slice(ends[laser - 1] if laser else 0, ends[laser])
        factor = squares[laser] / max(redundancy[laser], 1)
        covariance[laser], dof[laser] = _of_blocks(
            score[:, own], k[..., own], s[..., own], factor * rows[own].max()
        )
    return covariance, dof


def _of_blocks(score: Array, k: Array, s: Array, instead: float) -> tuple[Array, Array]:
    """Covariance and degrees of freedom of one laser.

    Parameters
    ----------
    score : ndarray, shape (u, blocks)
    k, s : ndarray, shape (u, u, blocks)
        K_g and S_g; see `block_covariance`.
    instead : float
        Share of the formal variance that a parameter gets whose blocks show no variance.

    Returns
    -------
    covariance : ndarray, shape (u, u)
    dof : ndarray, shape (u,)
    """
    u = len(score)
    whole = s.sum(axis=2)
    # E[score_g score_h'] of parameter j is, except for S_g, the element (g, h) of F' M F. That has
    # a low rank, so that no matrix of all pairs of blocks is needed.
    f = np.concatenate([k, s], axis=1)
    middle = np.zeros((2 * u, 2 * u))
    middle[:u, :u], middle[:u, u:], middle[u:, :u] = whole, -np.eye(u), -np.eye(u)
    turned = middle @ f
    alone = np.einsum("jag,jag->jg", turned, f)
    pairs = turned @ f.transpose(0, 2, 1)
    expected = np.einsum("jjg->jg", s) + alone
    spread = np.einsum("jab,jba->j", pairs, pairs) + np.sum(expected**2 - alone**2, axis=1)
    total, variance = expected.sum(axis=1), np.diag(whole)
    shown = total > LEAST_SHOWN * variance
    safe = np.where(shown, total, 1.0)
    scale = np.sqrt(np.where(shown, variance / safe, 0.0))
    covariance = scale[:, None] * (score @ score.T) * scale
    covariance += np.diag(np.where(shown, 0.0, instead * variance))
    dof = np.where(shown, safe**2 / np.maximum(spread, 1e-300), 1.0)
    return NEIGHBOURS * covariance, np.maximum(dof, 1.0)


def weakly_determined(names: Sequence[str], step: Step) -> tuple[str, ...]:
    """Parameters of which the data determine less than the share `DETERMINED`."""
    shares = np.diag(step.estimable)
    return tuple(name for name, share in zip(names, shares, strict=True) if share < DETERMINED)


def above(names: Sequence[str], std: Array, prior_std: Array) -> tuple[str, ...]:
    """Parameters whose standard deviation exceeds the prior one by more than rounding."""
    larger = std > prior_std * (1.0 + 1e-9)
    return tuple(name for name, chosen in zip(names, larger, strict=True) if chosen)


def non_estimable(names: Sequence[str], step: Step) -> tuple[str, ...]:
    """Combinations of parameters, in units of their prior, that the data do not determine.

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
    used = step.singular_values[step.singular_values > 0.0]
    return float(used.max() / used.min()) if len(used) else float("inf")


def variance_factor_test(variance_factor: float, redundancy: int) -> float:
    """Two-sided p-value of H0: the variance factor is 1 (chi-square); NaN without redundancy."""
    if redundancy <= 0:
        return float("nan")
    from scipy.special import chdtr  # here: many jobs import this module, few need it

    below = float(chdtr(redundancy, variance_factor * redundancy))
    return 2.0 * min(below, 1.0 - below)
