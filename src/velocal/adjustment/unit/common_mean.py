"""The means of dl, alpha and v over the lasers: how much of them the survey may decide.

A mean of alpha is a turn of the scanner about its axis, and a mean of v over a sector is nearly a
tilt: both are errors of the pose in another form. A mean of dl is hardly different from a shift
that all lasers have at a station. This module is the choice of datum.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array

#: Parameters with such a mean, and their units.
DATUM = {"dl": "m", "alpha": "rad", "v": "rad"}
#: Prior standard deviation of a mean, in units of the spread over the lasers: the components of
#: a mixture. The first is the factory's mean; the others are possible only as far as the survey
#: decides.
RATIOS = (0.05, 0.3, 1.0, 3.0, 10.0)
#: A survey whose standard deviation of the mean is below the first number times the spread over
#: the lasers decides; above the second, the factory's mean stays; in between, in proportion. For
#: dl, alpha and v: an error of the pose moves all angles, the distances hardly.
DECIDES, LEAVES = np.array([0.5, 0.3, 0.3]), np.array([1.0, 0.6, 0.6])
#: A mean that differs from the factory's by more than the second number times its standard
#: deviation is believed though the survey does not decide by itself; by less than the first, not
#: for this reason.
UNLIKELY, CERTAIN = 3.0, 4.5
#: This needs a standard deviation below the first number times the spread over the lasers; above
#: the second it is never believed: small faults of the model look like large means where the data
#: say little (walls alone, one station).
SHARP, DULL = 1.5, 2.5


@dataclass(frozen=True)
class GivenMean:
    """Mean of a parameter over the lasers that another adjustment has found.

    Attributes
    ----------
    value, std : float
        Metres or radians.
    """

    value: float
    std: float


@dataclass(frozen=True)
class CommonMean:
    """Distribution of the means of dl, alpha and v.

    Attributes
    ----------
    mean : ndarray, shape (3,)
        In the order of `DATUM`.
    covariance : ndarray, shape (3, 3)
    by_survey, by_survey_std : ndarray, shape (3,)
        What the data and the survey alone say.
    decided : ndarray, shape (3,)
        Weight with which the survey may decide: 0 where the factory's mean stays, 1 at most.
    """

    mean: Array
    covariance: Array
    by_survey: Array
    by_survey_std: Array
    decided: Array


def common_mean(
    mean: Array,
    covariance: Array,
    prior_std: Array,
    spread: Array,
    given: Mapping[str, GivenMean] | None = None,
) -> CommonMean:
    """Decide on the means.

    Parameters
    ----------
    mean, covariance : ndarray, shape (3,) and (3, 3)
        Posterior under a wide normal prior.
    prior_std : ndarray, shape (3,)
        Standard deviations of this prior, which is taken out again.
    spread : ndarray, shape (3,)
        Standard deviations of dl, alpha and v over the lasers.
    given : mapping of str to GivenMean, optional
        Means that are not decided on here. The others are decided for these.

    Notes
    -----
    A mean of alpha or v that stays at the factory's value is a matter of the frame, and is stated
    apart. That of dl is not: its variance is that of the error that leaving it may cause.
    """
    # Take the wide prior out: what is left is the likelihood of the means.
    precision = np.linalg.inv(covariance)
    size = np.diag(prior_std)
    values, vectors = np.linalg.eigh(size @ precision @ size - np.eye(len(mean)))
    vectors = size @ vectors
    survey = (vectors / np.maximum(values, 1e-6)) @ vectors.T
    by_survey = survey @ precision @ mean
    by_survey_std = np.sqrt(np.diag(survey))
    better = (LEAVES - by_survey_std / spread) / (LEAVES - DECIDES)
    clear = (np.abs(by_survey) / by_survey_std - UNLIKELY) / (CERTAIN - UNLIKELY)
    sharp = np.clip((DULL - by_survey_std / spread) / (DULL - SHARP), 0.0, 1.0)
    decided = np.clip(np.maximum(better, sharp * np.minimum(clear, 1.0)), 0.0, 1.0)
    centre, matrix = np.zeros(len(mean)), np.zeros((len(mean), len(mean)))
    left, left_survey = by_survey, survey
    for place, name in enumerate(DATUM):
        if given and name in given:
            centre[place], matrix[place, place] = given[name].value, given[name].std ** 2
            left, left_survey = _for_given(left, left_survey, place, given[name])
    free = np.array([not given or name not in given for name in DATUM])
    block = np.ix_(free, free)
    mixture = _Mixture.of(left[free], left_survey[block], spread[free])
    centre[free], matrix[block] = mixture.moments(decided[free])
    if free[0]:
        # The same with equal weights, about the mean that was chosen.
        all_open, spread_open = mixture.moments(np.ones(int(free.sum())))
        risk = spread_open[0, 0] + (all_open[0] - centre[0]) ** 2
        matrix[0, 0] += max(risk - matrix[0, 0], 0.0)
    return CommonMean(centre, matrix, by_survey, by_survey_std, decided)


def _for_given(
    by_survey: Array, survey: Array, place: int, given: GivenMean
) -> tuple[Array, Array]:
    """What the survey says of the other means, for one that is given."""
    by_one = survey[:, place] / survey[place, place]
    said = by_survey - by_one * (by_survey[place] - given.value)
    about = survey - np.outer(by_one, survey[place]) + np.outer(by_one, by_one) * given.std**2
    return said, about


@dataclass(frozen=True)
class _Mixture:
    """All combinations of `RATIOS` for the three means.

    Attributes
    ----------
    first : ndarray of bool, shape (combinations, 3)
        Whether a mean is that of the factory.
    log : ndarray, shape (combinations,)
        Logarithm of the evidence.
    mean : ndarray, shape (combinations, 3)
    covariance : ndarray, shape (combinations, 3, 3)
    """

    first: Array
    log: Array
    mean: Array
    covariance: Array

    @classmethod
    def of(cls, by_survey: Array, survey: Array, spread: Array) -> _Mixture:
        """Posterior and evidence of every combination."""
        number = np.array(list(itertools.product(range(len(RATIOS)), repeat=len(spread))))
        prior = (np.array(RATIOS)[number] * spread)[:, :, None] ** 2 * np.eye(len(spread))
        total = survey + prior
        gain = np.swapaxes(np.linalg.solve(total, prior), 1, 2)
        weighted = np.linalg.solve(total, np.broadcast_to(by_survey[:, None], (*number.shape, 1)))
        log = -0.5 * (by_survey @ weighted[..., 0].T + np.linalg.slogdet(total)[1])
        return cls(number == 0, log, gain @ by_survey, prior - gain @ prior)

    def moments(self, decided: Array) -> tuple[Array, Array]:
        """Mean and covariance, where each survey has a weight from 0 to 1."""
        n = len(RATIOS)
        prior = np.where(self.first, 1.0 - decided * (1.0 - 1.0 / n), decided / n).prod(axis=1)
        with np.errstate(divide="ignore"):
            log = self.log + np.log(prior)
        share = np.exp(log - log.max())
        share /= share.sum()
        centre = share @ self.mean
        about = self.mean - centre
        matrix = np.einsum("c,cij->ij", share, self.covariance)
        return centre, matrix + np.einsum("c,ci,cj->ij", share, about, about)
