"""Noise of a unit: restricted likelihood, and what is found where there is little."""

import numpy as np

from velocal.adjustment.unit.noise import (
    Group,
    correlation,
    estimate,
    minus_2_log,
    reduced,
)


def group(seed, n=80, tau=0.006, omega=0.004, length=0.02):
    """Bins of 0.9 deg with a pattern, white noise, and three columns that are projected out."""
    rng = np.random.default_rng(seed)
    phi = np.deg2rad(0.9) * np.arange(n)
    count = rng.integers(1, 10, n).astype(float)
    design = np.column_stack([np.ones(n), np.tan(phi / 2.0), np.cos(phi)])
    covariance = tau**2 * correlation(phi, length) + np.diag(omega**2 / count)
    z = np.linalg.cholesky(covariance) @ rng.standard_normal(n)
    return Group(phi, count, z + design @ rng.normal(size=3), design)


def test_likelihood_is_the_restricted_one():
    """Against its formula with the whole covariance; constants cancel in differences."""
    of, length = group(1), 0.03
    found = reduced([of], length)

    def direct(tau, omega):
        v = tau**2 * correlation(of.phi, length) + np.diag(omega**2 / of.count)
        inverse = np.linalg.inv(v)
        normal = of.design.T @ inverse @ of.design
        rest = inverse - inverse @ of.design @ np.linalg.solve(normal, of.design.T @ inverse)
        return np.linalg.slogdet(v)[1] + np.linalg.slogdet(normal)[1] + of.z @ rest @ of.z

    points = [(0.003, 0.002), (0.01, 0.004), (0.002, 0.02)]
    ours = [minus_2_log(found, np.log([[a]]), np.log([[b]])).item() for a, b in points]
    theirs = [direct(a, b) for a, b in points]
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=1e-8)


def test_a_column_that_is_a_sum_of_others_changes_nothing():
    of = group(2)
    more = Group(of.phi, of.count, of.z, np.column_stack([of.design, of.design.sum(axis=1)]))
    log = np.full((2, 1), np.log(0.005))
    values = minus_2_log(reduced([of, more], 0.02), log, log)
    np.testing.assert_allclose(values[0], values[1], rtol=1e-9)


def test_sizes_and_length_are_found():
    """The median of 12 groups: each is good to some 20 %."""
    found = estimate([group(seed, n=150) for seed in range(12)])
    assert abs(np.log(np.median(found.tau) / 0.006)) < 0.25
    assert abs(np.log(np.median(found.omega) / 0.004)) < 0.5
    assert 0.007 < found.length < 0.06
    assert found.estimated.all()


def test_small_groups_have_the_median_of_the_others():
    small = group(3, n=10)
    found = estimate([group(0), None, small, group(1)])
    np.testing.assert_array_equal(found.estimated, [True, False, False, True])
    assert np.isfinite(found.tau).all()
    np.testing.assert_allclose(found.tau[2], np.exp(np.log(found.tau[[0, 3]]).mean()), rtol=0.3)


def test_without_large_groups_the_noise_is_the_spread_of_all():
    found = estimate([group(4, n=6), None])
    assert not found.estimated.any()
    assert (found.tau > 0.0).all()
