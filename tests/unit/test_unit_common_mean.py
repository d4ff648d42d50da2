"""The means of dl, alpha and v: the survey decides where it knows them better than the unit."""

import numpy as np

from velocal.adjustment.unit.common_mean import RATIOS, GivenMean, common_mean

DEG = np.pi / 180.0
#: Units of dl, alpha and v.
UNIT = np.array([1.0, DEG, DEG])
WIDE = np.array([0.05, DEG, DEG])
SPREAD = np.array([0.02, 0.05, 0.05]) * UNIT


def posterior(by_survey, std):
    """Posterior under the wide prior, for independent means; metres and degrees."""
    survey = (np.array(std) * UNIT) ** 2
    covariance = 1.0 / (1.0 / survey + WIDE**-2.0)
    return covariance / survey * np.array(by_survey) * UNIT, np.diag(covariance)


def test_a_poor_survey_leaves_the_factorys_mean():
    mean, covariance = posterior([0.03, 0.3, -0.3], [0.03, 0.2, 0.2])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    np.testing.assert_array_equal(found.decided, np.zeros(3))
    assert np.abs(found.mean / UNIT).max() < 0.001
    np.testing.assert_allclose(found.by_survey / UNIT, [0.03, 0.3, -0.3], rtol=1e-6)
    np.testing.assert_allclose(found.by_survey_std / UNIT, [0.03, 0.2, 0.2], rtol=1e-6)


def test_the_interval_of_a_mean_of_dl_contains_what_the_survey_says():
    """It is no matter of the frame: 0 with a standard deviation that admits 3 cm +- 3 cm."""
    mean, covariance = posterior([0.03, 0.0, 0.0], [0.03, 0.01, 0.01])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    assert 0.01 < np.sqrt(found.covariance[0, 0]) < 0.05
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_an_accurate_survey_moves_a_mean_that_it_sees():
    mean, covariance = posterior([0.02, 0.3, 0.0], [0.002, 0.01, 0.01])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    np.testing.assert_allclose(found.mean / UNIT, [0.02, 0.3, 0.0], atol=0.003)
    assert np.sqrt(found.covariance[1, 1]) < 0.011 * DEG


def test_moments_are_those_of_the_mixture():
    """By numerical integration over one mean; the others are known and zero."""
    mean, covariance = posterior([0.0, 0.02, 0.0], [1e-6, 0.012, 1e-5])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    x = np.linspace(-0.6, 0.6, 40001) * DEG

    def normal(at, std):
        return np.exp(-0.5 * (at / std) ** 2) / std

    # Given that the other means are zero, their components scale the evidence of all of these.
    density = sum(normal(x, ratio * SPREAD[1]) for ratio in RATIOS)
    density *= normal(x - 0.02 * DEG, 0.012 * DEG)
    density /= density.sum()
    expected = (density * x).sum()
    variance = (density * (x - expected) ** 2).sum()
    np.testing.assert_allclose(found.mean[1], expected, rtol=1e-3)
    np.testing.assert_allclose(found.covariance[1, 1], variance, rtol=1e-3)


def test_a_mean_that_is_far_from_the_factorys_is_believed_if_it_is_known():
    """Five standard deviations, though the survey knows the mean no better than the unit."""
    sharp = float(SPREAD[1] / DEG)
    mean, covariance = posterior([0.0, 5.0 * sharp, 0.0], [0.03, sharp, 0.2])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    assert found.decided[1] == 1.0
    assert found.mean[1] > 2.5 * SPREAD[1]
    # The same of a mean that is hardly known may be a fault of the model.
    mean, covariance = posterior([0.0, 15.0 * sharp, 0.0], [0.03, 3.0 * sharp, 0.2])
    found = common_mean(mean, covariance, WIDE, SPREAD)
    assert found.decided[1] == 0.0
    assert abs(found.mean[1]) < 0.5 * SPREAD[1]


def test_a_given_mean_is_kept_and_the_others_are_those_for_it():
    """The survey sees dl + 2 m * v sharply: dl is what v leaves of it, as if that were zero."""
    by_survey = np.array([0.02, 0.0, 0.2 * DEG])
    sees = np.diag([0.002, 0.01 * DEG, 0.1 * DEG]) ** 2
    sees[0, 0] += (2.0 * 0.1 * DEG) ** 2
    sees[0, 2] = sees[2, 0] = -2.0 * (0.1 * DEG) ** 2
    covariance = np.linalg.inv(np.linalg.inv(sees) + np.diag(WIDE**-2.0))
    mean = covariance @ np.linalg.solve(sees, by_survey)
    for value in (0.2 * DEG, 0.5 * DEG):
        given = {"v": GivenMean(value, 0.01 * DEG)}
        found = common_mean(mean, covariance, WIDE, SPREAD, given)
        assert found.mean[2] == value
        np.testing.assert_allclose(found.covariance[2], [0.0, 0.0, (0.01 * DEG) ** 2])
        # Shrunk by a few per cent, and by nothing that is known of v.
        left = 0.02 - 2.0 * (value - 0.2 * DEG)
        np.testing.assert_allclose(found.mean[0], left, atol=0.05 * abs(left) + 1e-3)
        np.testing.assert_allclose(found.by_survey, by_survey, rtol=1e-6, atol=1e-12)
