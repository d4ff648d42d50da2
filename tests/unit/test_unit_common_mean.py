"""The means of alpha and v: the survey decides only where it knows them better than the unit."""

import numpy as np

from velocal.adjustment.unit.common_mean import RATIOS, common_mean

WIDE = np.full(2, np.deg2rad(1.0))
SPREAD = np.deg2rad([0.05, 0.05])


def posterior(by_survey_deg, std_deg):
    """Posterior under the wide prior, for independent means."""
    survey = np.deg2rad(np.array(std_deg)) ** 2
    covariance = 1.0 / (1.0 / survey + WIDE**-2.0)
    return covariance / survey * np.deg2rad(np.array(by_survey_deg)), np.diag(covariance)


def test_a_poor_survey_leaves_the_factorys_mean():
    mean, covariance = posterior([0.3, -0.3], [0.2, 0.2])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    np.testing.assert_array_equal(found.decided, [0.0, 0.0])
    assert np.abs(found.mean).max() < np.deg2rad(0.001)
    np.testing.assert_allclose(np.rad2deg(found.by_survey), [0.3, -0.3], rtol=1e-6)
    np.testing.assert_allclose(np.rad2deg(found.by_survey_std), [0.2, 0.2], rtol=1e-6)


def test_an_accurate_survey_moves_a_mean_that_it_sees():
    mean, covariance = posterior([0.3, 0.0], [0.01, 0.01])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    np.testing.assert_allclose(np.rad2deg(found.mean), [0.3, 0.0], atol=0.003)
    assert np.rad2deg(np.sqrt(found.covariance[0, 0])) < 0.011


def test_moments_are_those_of_the_mixture():
    """By numerical integration over one mean; the other is known and zero."""
    mean, covariance = posterior([0.04, 0.0], [0.02, 1e-5])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    x = np.deg2rad(np.linspace(-0.6, 0.6, 40001))

    def normal(at, std):
        return np.exp(-0.5 * (at / std) ** 2) / std

    # Given that the other mean is zero, its components only scale the evidence of each of its own.
    density = sum(normal(x, ratio * SPREAD[0]) for ratio in RATIOS)
    density *= normal(x - np.deg2rad(0.04), np.deg2rad(0.02))
    density /= density.sum()
    expected = (density * x).sum()
    variance = (density * (x - expected) ** 2).sum()
    np.testing.assert_allclose(found.mean[0], expected, rtol=1e-4)
    np.testing.assert_allclose(found.covariance[0, 0], variance, rtol=1e-4)
