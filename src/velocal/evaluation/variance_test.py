"""Test whether the variance of a laser is below the datasheet's, for correlated residuals.

The usual chi-square test takes residuals as independent. Residuals that are near each other in
azimuth are nearly equal, so that there are far fewer independent ones, and lasers whose variance
is not below that of the datasheet pass much more often than in 5 % of cases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array

#: Azimuth bins of a turn: the resolution of the correlation, 0.1 degree.
_BINS = 3600
#: Bins up to which residuals may be correlated: 20 degrees.
_LAGS = 200
#: The correlation is zero from the first lag on at which it is estimated below this: of all lasers
#: together, and of a single laser, which is known less well.
_LEAST_POOLED, _LEAST_OWN = 0.05, 0.1
#: Lags with more correlation than this tell independent noise from what is correlated.
_NEAR = 0.5
#: A laser with less correlated variance than this share has no correlation of its own.
_LEAST_SHARE = 0.05


@dataclass(frozen=True)
class CorrelatedTest:
    """Result of the variance test for correlated residuals, one element per laser.

    Attributes
    ----------
    effective_count : ndarray
        Number of independent residuals whose mean square scatters as much (Satterthwaite's degrees
        of freedom); NaN for a laser without residuals.
    p : ndarray
        Probability of a mean square as small as this if the true one is sigma^2; NaN for a laser
        without residuals.
    """

    effective_count: Array
    p: Array


def correlated_variance_test(
    s: Array, phi: Array, laser_id: NDArray[np.integer], n_lasers: int, sigma_m: float
) -> CorrelatedTest:
    """Test H0: the mean square of s about zero is at least sigma^2, for every laser.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Residuals, metres.
    phi : ndarray, shape (n,)
        Their rotational angles, radians.
    laser_id : ndarray of int, shape (n,)
        Laser of each.
    n_lasers : int
        Number of lasers of the scanner.
    sigma_m : float
        Standard deviation of the datasheet, metres.

    Returns
    -------
    CorrelatedTest

    Notes
    -----
    A laser has the model s = mu + e with a fixed shift mu and V = cov(e) = a R + w I: a pattern
    of variance a, whose correlation R depends on the difference in azimuth, and independent noise
    of variance w. Then sum(s^2) has the mean n mu^2 + tr V and the variance 2 tr V^2 + 4 mu^2 1'V1,
    and is taken as a scaled chi-square variable with the same two moments (Satterthwaite), of
    f = 2 mean^2 / variance degrees of freedom. They are those under H0: of sigma^2, the noise w
    (which many pairs of neighbours show) and the shift are taken from the data, and a is the rest.
    With the data's own a, a laser that by chance shows little of its pattern would have too many
    degrees of freedom. For a large shift the one is taken that gives the largest variance.

    R comes from the residuals of all lasers, each in units of its own variance, about its mean;
    what the subtraction of the mean takes away from the correlation is given back. A laser that is
    correlated over more azimuth than the others has its own R if that gives fewer degrees of
    freedom.

    The test speaks about this position and recording. It does not say whether the shift of a laser
    is the same elsewhere.
    """
    s, phi = s.astype(np.float64), phi.astype(np.float64)
    count = np.bincount(laser_id, minlength=n_lasers)
    n = np.maximum(count, 1).astype(np.float64)
    mean = np.bincount(laser_id, s, n_lasers) / n
    pairs, correlated, variance = _pairs(s - mean[laser_id], phi, laser_id, n_lasers)
    pooled, lost = _pooled(pairs, correlated, n)
    given_back = correlated * (1.0 - lost)[:, None] + pairs * lost[:, None]
    near = pooled > _NEAR
    squares = pairs[:, near] @ pooled[near] ** 2
    share = _ratio(given_back[:, near] @ pooled[near], squares).clip(0.0, 1.0)
    own = _own(_ratio(given_back, pairs), pairs, share)
    # Sums of all elements of R, and of their squares. The least favourable of the two R.
    sums = n + 2.0 * np.maximum(pairs @ pooled, (pairs * own).sum(axis=1))
    squares = n + 2.0 * np.maximum(pairs @ pooled**2, (pairs * own**2).sum(axis=1))

    limit = sigma_m**2
    white = np.minimum((1.0 - share) * variance / (1.0 - lost), limit)
    rest = limit - white
    worst = rest * _ratio(sums - squares, 2.0 * sums - squares)
    shift = np.minimum(mean**2, worst)
    pattern = rest - shift
    half_variance = (
        pattern**2 * squares
        + (2.0 * pattern + white) * white * n
        + 2.0 * shift * (pattern * sums + white * n)
    )
    dof = np.clip((n * limit) ** 2 / half_variance, 1.0, n)
    mean_square = np.bincount(laser_id, s**2, n_lasers) / n
    from scipy.special import gammainc  # here: many jobs import this module, few need it

    p = gammainc(dof / 2.0, dof * mean_square / limit / 2.0)
    seen = count > 0
    return CorrelatedTest(np.where(seen, dof, np.nan), np.where(seen, p, np.nan))


def holm_p(p: Array) -> Array:
    """P-values of several tests, adjusted after Holm.

    Parameters
    ----------
    p : ndarray, shape (k,)
        P-values of the hypotheses; NaN where there is none to test.

    Returns
    -------
    ndarray, shape (k,)
        NaN stays NaN.
    """
    order = np.argsort(p, kind="stable")  # NaN comes last
    tested = order[: int(np.isfinite(p).sum())]
    raw = p[tested] * np.arange(len(tested), 0, -1)
    adjusted = np.full(len(p), np.nan)
    adjusted[tested] = np.minimum(np.maximum.accumulate(raw), 1.0)
    return adjusted


def holm(p: Array, alpha: float) -> NDArray[np.bool_]:
    """Reject hypotheses so that the probability of any wrong rejection is at most alpha (Holm).

    Parameters
    ----------
    p : ndarray, shape (k,)
        P-values of the hypotheses; NaN where there is none to test.
    alpha : float

    Returns
    -------
    ndarray of bool, shape (k,)
        Which hypotheses are rejected.
    """
    return np.asarray(holm_p(p) <= alpha)


def _pairs(
    x: Array, phi: Array, laser_id: NDArray[np.integer], n_lasers: int
) -> tuple[Array, Array, Array]:
    """Pairs of residuals of a laser by their difference in azimuth.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Residuals about the mean of their laser.
    phi, laser_id, n_lasers
        As for `correlated_variance_test`.

    Returns
    -------
    pairs : ndarray, shape (lasers, lags)
        Number of pairs of two different residuals.
    correlated : ndarray, shape (lasers, lags)
        Sum of their products, in units of the variance of the laser.
    variance : ndarray, shape (lasers,)
        Mean of x^2.
    """
    azimuth_bin = np.floor(np.mod(phi, 2.0 * np.pi) * (_BINS / (2.0 * np.pi))).astype(np.int64)
    cell = laser_id.astype(np.int64) * _BINS + azimuth_bin % _BINS

    def products(weights: Array | None, squares: NDArray[np.number]) -> Array:
        table = np.bincount(cell, weights, n_lasers * _BINS).reshape(n_lasers, _BINS)
        spectrum = np.abs(np.fft.rfft(table, axis=1)) ** 2
        found = np.fft.irfft(spectrum, _BINS, axis=1)[:, :_LAGS]
        # Two residuals in one bin are one pair; a residual is no pair with itself.
        found[:, 0] = (found[:, 0] - squares) / 2.0
        return np.asarray(found)

    count = np.bincount(laser_id, minlength=n_lasers)
    squares = np.bincount(laser_id, x**2, n_lasers)
    variance = squares / np.maximum(count, 1)
    pairs = np.rint(products(None, count))
    return pairs, _ratio(products(x, squares).T, variance).T, variance


def _pooled(pairs: Array, correlated: Array, n: Array) -> tuple[Array, Array]:
    """Correlation of the pattern by lag, and share of the variance that the means take away.

    Returns
    -------
    correlation : ndarray, shape (lags,)
        Of all lasers together, without independent noise.
    lost : ndarray, shape (lasers,)
        Variance of the mean of a laser, in units of its variance: its residuals about the mean
        lack that much variance, and that much covariance at every lag.
    """
    total, lost = pairs.sum(axis=0), np.zeros(len(n))
    for _ in range(30):
        given_back = correlated * (1.0 - lost)[:, None] + pairs * lost[:, None]
        found = _ratio(given_back.sum(axis=0), total)
        low = np.flatnonzero((found < _LEAST_POOLED) & (total > 0))
        found[low[0] if len(low) else _LAGS :] = 0.0
        before, lost = lost, np.clip((n + 2.0 * pairs @ found) / n**2, 0.0, 0.9)
        if np.abs(lost - before).max(initial=0.0) < 1e-6:
            break
    # Independent noise lowers the correlation at all lags but zero; a line through the first two
    # lags tells what it would be without. (In the bin of lag zero there may be no pairs.)
    top = max(found[1], 2.0 * found[1] - found[2])
    correlation = np.clip(found / top, 0.0, 1.0) if top > 0.0 else np.zeros(_LAGS)
    correlation[0] = float(top > 0.0)
    return correlation, lost


def _own(correlation: Array, pairs: Array, share: Array) -> Array:
    """Correlation of the pattern of every laser up to the first lag at which it is low."""
    found = correlation / np.maximum(share, _LEAST_SHARE)[:, None]
    low = (found < _LEAST_OWN) & (pairs > 0)
    low[:, 0] = False
    ended = np.logical_or.accumulate(low, axis=1) | (pairs == 0)
    return np.where(ended, 0.0, np.clip(found, 0.0, 1.0))


def _ratio(numerator: Array, denominator: Array) -> Array:
    """Quotient; zero where the denominator is."""
    known = denominator > 0.0
    return np.where(known, numerator / np.where(known, denominator, 1.0), 0.0)
