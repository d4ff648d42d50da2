"""The means of alpha and v over the lasers: how much of them the survey may decide.

A mean of alpha is a turn of the scanner about its axis, and a mean of v over a sector is nearly a
tilt: both are errors of the pose in another form. This module is the choice of datum.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array

#: Prior standard deviation of a mean, in units of the spread over the lasers: the components of
#: a mixture with equal weights. The first is the factory's mean; the others are possible only as
#: far as the survey decides.
RATIOS = (0.05, 0.3, 1.0, 3.0, 10.0)
#: A survey whose standard deviation of the mean is below the first number times the spread over
#: the lasers decides; above the second, the factory's mean stays; in between, in proportion.
DECIDES, LEAVES = 0.5, 1.0


@dataclass(frozen=True)
class CommonMean:
    """Distribution of the two means.

    Attributes
    ----------
    mean : ndarray, shape (2,)
        Of alpha and v, radians.
    covariance : ndarray, shape (2, 2)
    by_survey, by_survey_std : ndarray, shape (2,)
        What the data and the survey alone say.
    decided : ndarray, shape (2,)
        Weight with which the survey may decide: 0 where the factory's mean stays, 1 at most.
    """

    mean: Array
    covariance: Array
    by_survey: Array
    by_survey_std: Array
    decided: Array


def common_mean(mean: Array, covariance: Array, prior_std: Array, spread: Array) -> CommonMean:
    """Decide on the means.

    Parameters
    ----------
    mean, covariance : ndarray, shape (2,) and (2, 2)
        Posterior under a wide normal prior.
    prior_std : ndarray, shape (2,)
        Standard deviations of this prior, which is taken out again.
    spread : ndarray, shape (2,)
        Standard deviations of alpha and v over the lasers.
    """
    # Take the wide prior out: what is left is the likelihood of the two means.
    precision = np.linalg.inv(covariance)
    values, vectors = np.linalg.eigh(precision - np.diag(prior_std**-2.0))
    values = np.maximum(values, 1e-6 * float(np.min(prior_std**-2.0)))
    survey = (vectors / values) @ vectors.T
    by_survey = survey @ precision @ mean
    by_survey_std = np.sqrt(np.diag(survey))
    decided = np.clip((LEAVES - by_survey_std / spread) / (LEAVES - DECIDES), 0.0, 1.0)
    moments, logs = [], []
    for ratios in itertools.product(range(len(RATIOS)), repeat=2):
        weight = 1.0
        for number, share in zip(ratios, decided, strict=True):
            weight *= (
                1.0 - share * (1.0 - 1.0 / len(RATIOS)) if number == 0 else share / len(RATIOS)
            )
        if weight == 0.0:
            continue
        prior = np.diag((np.array([RATIOS[i] for i in ratios]) * spread) ** 2)
        total = survey + prior
        gain = np.linalg.solve(total, prior).T
        logs.append(
            np.log(weight)
            - 0.5 * by_survey @ np.linalg.solve(total, by_survey)
            - 0.5 * np.linalg.slogdet(total)[1]
        )
        moments.append((gain @ by_survey, prior - gain @ prior))
    share = np.exp(np.array(logs) - max(logs))
    share /= share.sum()
    centre = sum(w * m for w, (m, _) in zip(share, moments, strict=True))
    spread_of_mixture = sum(
        w * (c + np.outer(m - centre, m - centre)) for w, (m, c) in zip(share, moments, strict=True)
    )
    return CommonMean(
        np.asarray(centre), np.asarray(spread_of_mixture), by_survey, by_survey_std, decided
    )
