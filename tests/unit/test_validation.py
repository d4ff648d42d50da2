"""Statistics per laser and per window against literal formulas."""

import numpy as np
import pytest
from scipy.stats import chi2

from velocal.evaluation.statistics import laser_statistics, statistics_table, summary_row

S = np.array([0.01, -0.03, 0.02, 0.05, 0.07, 0.001, -0.002])
LASER = np.array([0, 0, 0, 2, 2, 2, 2])


def test_against_literal_formulas():
    found = laser_statistics(S, LASER, 4, 0.02)
    for laser in (0, 2):
        own = S[laser == LASER]
        assert found.count[laser] == len(own)
        np.testing.assert_allclose(found.rms_m[laser], np.sqrt(np.mean(own**2)))
        np.testing.assert_allclose(found.std_m[laser], np.std(own, ddof=1))
        np.testing.assert_allclose(found.within_1sigma[laser], np.mean(np.abs(own) < 0.02))
        np.testing.assert_allclose(found.within_3sigma[laser], np.mean(np.abs(own) < 0.06))
    assert found.count[1] == found.count[3] == 0
    assert np.isnan(found.rms_m[[1, 3]]).all()
    assert not found.complies_zero[[1, 3]].any()


@pytest.mark.parametrize("spread", [0.012, 0.019, 0.021])
def test_variance_test(spread):
    s = np.random.default_rng(2).normal(0.003, spread, 200)
    found = laser_statistics(s, np.zeros(200, int), 1, 0.02)
    assert found.complies_zero[0] == (np.sum(s**2) / 0.02**2 < chi2.ppf(0.05, 200))
    assert found.complies_mean[0] == (199 * np.var(s, ddof=1) / 0.02**2 < chi2.ppf(0.05, 199))


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_laser_at_the_limit_of_the_variance_test(share):
    """Twenty residuals have twenty degrees of freedom about zero, and nineteen about their mean."""
    n, sigma_m = 20, 0.02
    noise = np.random.default_rng(5).normal(size=n)
    about_zero = noise * sigma_m * np.sqrt(share * chi2.ppf(0.05, n) / np.sum(noise**2))
    centred = noise - noise.mean()
    centred *= sigma_m * np.sqrt(share * chi2.ppf(0.05, n - 1) / np.sum(centred**2))
    laser = np.zeros(n, int)
    zero = laser_statistics(about_zero, laser, 1, sigma_m)
    mean = laser_statistics(centred + 0.004, laser, 1, sigma_m)
    assert zero.complies_zero[0] == (share < 1.0)
    assert mean.complies_mean[0] == (share < 1.0)


def test_size_of_the_variance_test():
    """At the limit of the hypothesis, 5 % of lasers with independent noise pass by chance."""
    s = np.random.default_rng(3).normal(0.0, 0.02, (2000, 100))
    laser = np.repeat(np.arange(2000), 100)
    share = laser_statistics(s.ravel(), laser, 2000, 0.02).complies_zero.mean()
    assert 0.035 < share < 0.065


def test_summary_reads_the_table():
    table = statistics_table({"sample": "a"}, {"before": S}, LASER, 4, 0.02)
    assert set(table["calibration"]) == {"before"}
    row = summary_row(table)
    rms = [np.sqrt(np.mean(S[laser == LASER] ** 2)) * 100 for laser in (0, 2)]
    np.testing.assert_allclose(row["std_cm"], np.mean(rms))
    np.testing.assert_allclose(row["pooled_rms_cm"], np.sqrt(np.mean(S**2)) * 100)
    np.testing.assert_allclose(row["within_1sigma_pct"], np.mean(np.abs(S) < 0.02) * 100)
    assert (row["lasers"], row["count"]) == (2, 7)


def test_nothing_assigned_is_not_a_number():
    nothing = np.zeros(0)
    table = statistics_table({}, {"before": nothing}, nothing.astype(int), 3, 0.02)
    row = summary_row(table)
    assert np.isnan(row["std_cm"])
    assert row["lasers"] == 0
