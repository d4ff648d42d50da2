"""The variance test for correlated residuals: its size, its power, and Holm's method."""

import numpy as np
import pytest
from scipy.stats import chi2

from velocal.evaluation.statistics import laser_statistics, statistics_columns, summary_row
from velocal.evaluation.variance_test import correlated_variance_test, holm
from velocal.simulation.patterns import Residuals

#: Lasers, and their azimuths: about those of the medians of the HDL-64E at P2.
LASERS, SIGMA_M = 64, 0.02
ANGLES = np.deg2rad(np.concatenate([np.arange(0.0, 70.0, 0.09), np.arange(325.0, 360.0, 0.09)]))
PHI = np.tile(ANGLES, LASERS)
LASER = np.repeat(np.arange(LASERS), len(ANGLES))


def share_of_lasers(population, rms_m, runs, seed):
    """Shares of lasers that pass the paper's test, and the test for correlated residuals."""
    rng = np.random.default_rng(seed)
    passed = []
    for _ in range(runs):
        s = rms_m * population.draw(rng, PHI, LASER, LASERS)
        paper = laser_statistics(s, LASER, LASERS, SIGMA_M).complies_zero
        p = correlated_variance_test(s, PHI, LASER, LASERS, SIGMA_M).p
        passed.append([paper, p < 0.05])
    return np.mean(passed, axis=(0, 2))


@pytest.mark.parametrize(
    "population",
    [
        Residuals(kind="smooth", length_deg=0.5),
        Residuals(kind="smooth", length_deg=2.0),
        Residuals(kind="rough", length_deg=1.75),
        Residuals(kind="smooth", length_deg=0.5, white=0.6),
        Residuals(kind="smooth", length_deg=0.5, shift=0.5),
    ],
)
def test_size(population):
    """At a true rms of sigma, 3 to 7 % of lasers pass; of the paper's test, far more.

    15 runs of 64 lasers know a share of 5 % to 0.7 %. The bounds are 3 and 7 %, with twice that.
    """
    paper, correlated = share_of_lasers(population, SIGMA_M, 15, seed=1)
    assert 0.016 < correlated < 0.084
    assert paper > 0.15


def test_independent_residuals_keep_their_number():
    white = Residuals(kind="smooth", length_deg=0.5, white=1.0)
    s = SIGMA_M * white.draw(np.random.default_rng(2), PHI, LASER, LASERS)
    found = correlated_variance_test(s, PHI, LASER, LASERS, SIGMA_M)
    n = len(ANGLES)
    assert np.median(found.effective_count) > 0.95 * n
    expected = chi2.cdf(np.bincount(LASER, s**2) / SIGMA_M**2, n)
    assert np.median(np.abs(found.p - expected)) < 0.01


def test_effective_number_of_a_known_correlation():
    """Satterthwaite's n^2 / sum R^2 of the true correlation; it is estimated to a tenth."""
    length = 1.0
    population = Residuals(kind="smooth", length_deg=length, white=0.0)
    s = 0.5 * SIGMA_M * population.draw(np.random.default_rng(3), PHI, LASER, LASERS)
    found = correlated_variance_test(s, PHI, LASER, LASERS, SIGMA_M).effective_count
    apart = np.rad2deg(ANGLES[:, None] - ANGLES)
    apart = np.mod(apart + 180.0, 360.0) - 180.0
    true = len(ANGLES) ** 2 / np.sum(np.exp(-(apart**2) / (2.0 * length**2)))
    assert np.median(found) == pytest.approx(true, rel=0.1)


def test_power():
    """A laser of 1.2 cm is found below 2 cm, also where there are few independent residuals."""
    paper, correlated = share_of_lasers(Residuals(kind="smooth", length_deg=0.5), 0.012, 2, seed=4)
    assert correlated > 0.95
    assert paper > 0.95


def test_all_lasers_together():
    """Any laser passes with Holm's method in at most 5 % of runs; 30 runs know that to 4 %."""
    population = Residuals(kind="smooth", length_deg=0.5)
    rng = np.random.default_rng(5)
    wrong = 0
    for _ in range(30):
        s = SIGMA_M * population.draw(rng, PHI, LASER, LASERS)
        table = statistics_columns({}, s, LASER, LASERS, SIGMA_M, PHI)
        wrong += summary_row(table)["complies_holm"] > 0
    assert wrong <= (0.05 + 2 * 0.04) * 30


def test_holm_against_its_definition():
    p = np.array([0.011, 0.2, np.nan, 0.001, 0.0125, 0.03])
    # 0.001 <= 0.05 / 5, 0.011 <= 0.05 / 4, 0.0125 <= 0.05 / 3, 0.03 > 0.05 / 2: stop there.
    assert holm(p, 0.05).tolist() == [True, False, False, True, True, False]
    assert not holm(np.array([0.02, 0.02, 0.02]), 0.05).any()
    assert not holm(np.array([np.nan]), 0.05).any()
    assert len(holm(np.zeros(0), 0.05)) == 0


def test_lasers_with_few_or_no_residuals():
    s, phi = np.array([0.001, 0.002, 0.001]), np.array([0.1, 0.2, 0.3])
    found = correlated_variance_test(s, phi, np.array([0, 2, 2]), 4, SIGMA_M)
    assert np.isnan(found.p[[1, 3]]).all()
    assert np.isnan(found.effective_count[[1, 3]]).all()
    assert (found.effective_count[[0, 2]] <= [1, 2]).all()
    assert np.isfinite(found.p[[0, 2]]).all()
    nothing = np.zeros(0)
    empty = correlated_variance_test(nothing, nothing, nothing.astype(int), 2, SIGMA_M)
    assert np.isnan(empty.p).all()
    table = statistics_columns({}, nothing, nothing.astype(int), 2, SIGMA_M, nothing)
    assert summary_row(table)["complies_holm"] == 0


def test_azimuth_has_no_beginning():
    """The same residuals, turned by any angle, give nearly the same result."""
    s = SIGMA_M * Residuals(kind="smooth", length_deg=1.0).draw(
        np.random.default_rng(6), PHI, LASER, LASERS
    )
    here = correlated_variance_test(s, PHI, LASER, LASERS, SIGMA_M)
    there = correlated_variance_test(s, PHI + np.deg2rad(100.0), LASER, LASERS, SIGMA_M)
    np.testing.assert_allclose(there.effective_count, here.effective_count, rtol=0.02)
