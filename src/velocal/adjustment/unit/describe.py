"""The posterior in the form of a result: corrections, covariances and their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from velocal.adjustment.unit.common_mean import DATUM, CommonMean, GivenMean, common_mean
from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.model import UNKNOWNS, WITH_MEAN, symmetric_root
from velocal.arrays import Array

#: Places of the means that an error of the survey can imitate, among the common unknowns.
_DATUM = np.array([UNKNOWNS.index(name) for name in DATUM])


@dataclass(frozen=True)
class Description:
    """Posterior for given standard deviations of the unit.

    Attributes
    ----------
    values : ndarray
        The standard deviations of the unit, in the order of `Population.sizes`.
    unknowns : ndarray, shape (lasers, 6)
        Posterior mean of x, relative to the factory.
    corrections : ndarray, shape (lasers, 3)
        Of dl at the mean range, alpha and v.
    together : ndarray, shape (3 lasers, 3 lasers)
        Covariance of the corrections that comes from the common unknowns.
    covariance : ndarray, shape (lasers, 3, 3)
        Of the corrections of every laser, all sources.
    sources : mapping of str to ndarray, shape (lasers, 3, 3)
        Parts of `covariance`.
    prior : ndarray, shape (lasers, 3)
        Variances of the corrections before the adjustment, for given means.
    means : ndarray, shape (lasers, 3)
        Corrections that the means of the unit alone would give.
    common : ndarray, shape (m,)
        Mean of the common unknowns.
    common_covariance : ndarray, shape (m, m)
    datum : CommonMean
    scale_std : ndarray, shape (lasers,)
        Standard deviation of the second parameter of the distance.
    """

    values: Array
    unknowns: Array
    corrections: Array
    together: Array
    covariance: Array
    sources: Mapping[str, Array]
    prior: Array
    means: Array
    common: Array
    common_covariance: Array
    datum: CommonMean
    scale_std: Array


def describe(
    posterior: Posterior,
    values: Array,
    output: Array,
    survey: Mapping[str, NDArray[np.int64]],
    *,
    least_std: Mapping[str, float] | None = None,
    least_spread: Mapping[str, float] | None = None,
    given: Mapping[str, GivenMean] | None = None,
) -> Description:
    """Describe a posterior.

    Parameters
    ----------
    posterior : Posterior
    values : ndarray
        All standard deviations of the unit, in the order of `Population.sizes`.
    output : ndarray, shape (lasers, 3, 6)
        Derivatives of the corrections by the unknowns of a laser.
    survey : mapping of str to ndarray of int
        Places of the errors of the survey among the common unknowns, by source.
    least_std, least_spread : mapping of str to float, optional
        See `UnitSettings`.
    given : mapping of str to GivenMean, optional
        `UnitSettings.means`.

    Notes
    -----
    The estimate of the common unknowns has the error of a sum: a part from the noise, from the
    random unknowns of all lasers, and from the prior of each common unknown. Its covariance
    ``M^-1`` is ``M^-1 (H + P) M^-1``, with H the sum over noise and random unknowns and P the
    diagonal weights of the prior, so that every source has its share.
    """
    layout = posterior.sums.layout
    lasers, u, m = len(output), len(UNKNOWNS), layout.common
    std = posterior.std
    inverse = cho_solve((posterior.common_root, True), np.eye(m))
    inverse = 0.5 * (inverse + inverse.T)
    # Choose the datum: replace the distribution of the means, and what depends on them.
    block = inverse[np.ix_(_DATUM, _DATUM)]
    usual = [(least_spread or {}).get(name, 0.0) for name in DATUM]
    spread = np.maximum(std[_DATUM], usual)
    datum = common_mean(
        posterior.common[_DATUM], block, posterior.common_std[_DATUM], spread, given
    )
    gain = np.linalg.solve(block, inverse[_DATUM]).T
    common = posterior.common + gain @ (datum.mean - posterior.common[_DATUM])
    block_root = symmetric_root(block)
    ratio = symmetric_root(datum.covariance) @ np.linalg.inv(block_root)
    turn = np.eye(m)
    turn[:, _DATUM] += gain @ (ratio - np.eye(len(_DATUM)))
    # Derivatives of the corrections by the common unknowns, T.
    slope = posterior.slope
    by_common = -np.einsum("kua,a,kam->kum", output, std[:u], slope[:, :u])
    by_common[..., :WITH_MEAN] += output[..., :WITH_MEAN]
    by_common = by_common @ turn
    half = solve_triangular(
        posterior.common_root, by_common.reshape(-1, m).T, lower=True, check_finite=False
    )
    together = half.T @ half
    own_mean = posterior.scaled + slope @ (posterior.common - common)
    unknowns = std[:u] * own_mean[:, :u]
    unknowns[:, :WITH_MEAN] += common[:WITH_MEAN]
    means = np.zeros((lasers, u))
    means[:, :WITH_MEAN] = common[:WITH_MEAN]

    # Covariance by source: first for given common unknowns, then from those.
    kinds = {
        "prior": np.arange(WITH_MEAN),
        "offsets": np.arange(WITH_MEAN, u),
        "shift": np.arange(u, layout.own),
    }
    to_output = np.einsum("kua,a->kua", output, std[:u])
    own = to_output @ posterior.own_covariance[:, :u]
    moved = cho_solve((posterior.common_root, True), by_common.reshape(-1, m).T)

    def influence(places: NDArray[np.int64]) -> Array:
        """Of random unknowns (every laser's, one after the other) on all corrections."""
        through = slope[:, places].reshape(-1, m) @ moved
        found = -through.reshape(lasers, len(places), lasers, 3)
        every = np.arange(lasers)
        found[every, :, every] += np.swapaxes(own[..., places], 1, 2)
        return found.reshape(-1, lasers, 3)

    sources = {name: _squares(influence(places)) for name, places in kinds.items()}
    weighted = (moved / posterior.common_std[:, None]).reshape(m, lasers, 3)
    priors = {"prior": np.arange(WITH_MEAN), "shift": np.r_[layout.common_shift]}
    for name, places in [*priors.items(), *survey.items()]:
        sources[name] = sources.get(name, 0.0) + _squares(weighted[places])
    inner = to_output @ posterior.own_covariance[:, :u, :u] @ np.swapaxes(to_output, 1, 2)
    blocks = together.reshape(lasers, 3, lasers, 3)
    covariance = inner + np.einsum("kukv->kuv", blocks)
    sources = {"noise": covariance - sum(sources.values())} | sources
    # State at least what is usual, however little was assumed.
    for name, least in (least_std or {}).items():
        place = UNKNOWNS.index(name)
        more = max((least / std[place]) ** 2 - 1.0, 0.0)
        extra = more * _squares(influence(np.array([place])))
        kind = "prior" if place < WITH_MEAN else "offsets"
        sources[kind], covariance = sources[kind] + extra, covariance + extra
    prior = np.einsum("kua,a,kua->ku", output, std[:u] ** 2, output)
    place = UNKNOWNS.index("scale")
    by_scale = -std[place] * slope[:, place]
    by_scale[:, place] += 1.0
    from_common = solve_triangular(posterior.common_root, (by_scale @ turn).T, lower=True)
    scale_variance = std[place] ** 2 * posterior.own_covariance[:, place, place]
    return Description(
        values=values,
        unknowns=unknowns,
        corrections=np.einsum("kua,ka->ku", output, unknowns),
        together=together,
        covariance=covariance,
        sources=sources,
        prior=prior,
        means=np.einsum("kua,ka->ku", output, means),
        common=common,
        common_covariance=turn @ inverse @ turn.T,
        datum=datum,
        scale_std=np.sqrt(scale_variance + (from_common**2).sum(axis=0)),
    )


def _squares(influence: Array) -> Array:
    """Covariance of every laser's corrections from independent errors of unit variance."""
    return np.asarray(np.einsum("nku,nkv->kuv", influence, influence, optimize=True))
