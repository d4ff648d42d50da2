"""Stated quality of an adjustment against values that are known beforehand."""

import numpy as np
import pytest
from scipy.stats import norm, t

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.solvers import GaussHelmert, PaperModel, WithPrior
from velocal.adjustment.stochastic import Stochastic
from velocal.scanner.parameters import LaserParameters

PRIOR = {"dl": 0.02, "hoff": 0.01}


def on_plane(phi, v, normal, offset, errors):
    """Distances of lasers without corrections to one plane, with errors of shape (lasers, n)."""
    lasers, n = errors.shape
    zero = np.zeros(lasers)
    parameters = LaserParameters(zero, zero, np.full(lasers, v), zero, zero)
    laser = np.repeat(np.arange(lasers), n)
    phi, normal = np.tile(phi, lasers), np.tile(np.array(normal), (lasers * n, 1))
    offset = np.full(lasers * n, offset)
    exact = -Observations(np.zeros(lasers * n), phi, laser, normal, offset).misclosure(parameters)
    return Observations(exact + errors.ravel(), phi, laser, normal, offset), parameters


def on_floor(phi, errors):
    return on_plane(phi, np.deg2rad(-20.0), [0.0, 0.0, -1.0], -0.8, errors)


def on_wall(phi, errors):
    return on_plane(phi, 0.0, [0.0, 1.0, 0.0], -3.0, errors)


def test_noise_of_blocks_that_are_correlated_with_their_neighbours():
    """The stated variance of a mean is the true one when neighbouring blocks are correlated.

    The stated variance is a quadratic form of the errors. Therefore its expectation is the sum of
    the variances that are stated for the columns of a root of the covariance matrix. Each column
    is the error vector of one laser here, so that nothing is random in this test.
    """
    blocks, rows = 24, 20
    n = blocks * rows
    difference = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    difference = np.minimum(difference, n - difference)
    covariance = 0.01**2 * np.exp(-((difference / (rows / 10)) ** 2) / 4.0)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))

    block = np.arange(n) // rows
    true = covariance.sum() / n**2
    within = covariance[block[:, None] == block].sum() / n**2
    # Share of the variance that sums of single blocks show. Their residuals are deviations from the
    # common mean, for which the library corrects as if the rows were independent.
    shown = (within - true / blocks) / (1.0 - 1.0 / blocks)
    assert 0.10 < 1.0 - shown / true < 0.13

    data, zero = on_floor(2.0 * np.pi * (np.arange(n) + 0.5) / n, root.T)
    model = Stochastic(noise_std_m=0.01, prior_std=PRIOR, block_rad=2.0 * np.pi / blocks)
    found = adjust_all(data, zero, ("dl",), GaussHelmert(), model)
    corrections = np.array([laser.corrections[0] for laser in found])
    assert corrections @ corrections == pytest.approx(true, rel=1e-6)
    stated = sum(laser.parts["noise"][0, 0] for laser in found)
    assert stated == pytest.approx(true, rel=0.01)


def adjusted_mean(n, **known):
    """The mean of `n` independent distances as the correction of one laser."""
    errors = np.random.default_rng(n).normal(0.0, 0.01, (1, n))
    data, zero = on_floor(np.linspace(0.0, 6.0, n), errors)
    model = Stochastic(noise_std_m=0.01, prior_std=PRIOR, **known)
    return adjust_all(data, zero, ("dl",), GaussHelmert(), model)[0]


@pytest.mark.parametrize("level", [0.5, 0.95])
@pytest.mark.parametrize("n", [2, 5, 20])
def test_interval_of_few_observations_is_students(n, level):
    found = adjusted_mean(n)
    assert found.redundancy == n - 1
    # One half of the remaining probability lies on either side of the interval.
    expected = t.ppf(0.5 + level / 2.0, n - 1) * found.std
    np.testing.assert_allclose(found.interval(level), expected, rtol=1e-9)


def test_interval_of_many_observations_is_the_normal_one():
    found = adjusted_mean(5000)
    np.testing.assert_allclose(found.interval(), 1.96 * found.std, rtol=1e-3)
    np.testing.assert_allclose(found.interval(0.6827), found.std, rtol=1e-3)


def test_interval_nears_the_normal_one_as_known_parts_grow():
    few, n = adjusted_mean(5), 5
    ratio = []
    for repeatability_m in (0.0, 0.005, 0.5):
        found = adjusted_mean(n, repeatability_m=repeatability_m)
        total = few.parts["noise"][0, 0] + repeatability_m**2
        np.testing.assert_allclose(found.std, np.sqrt(total))
        # Degrees of freedom after Welch and Satterthwaite; the repeatability is exactly known.
        dof = (n - 1) * (total / few.parts["noise"][0, 0]) ** 2
        np.testing.assert_allclose(found.interval(), t.ppf(0.975, dof) * found.std, rtol=1e-9)
        ratio.append(found.interval()[0] / found.std[0])
    assert ratio[0] > ratio[1] > ratio[2] == pytest.approx(norm.ppf(0.975), rel=1e-6)


@pytest.mark.parametrize(
    ("dl_share", "hoff_share", "weak"),
    [
        (0.7, 0.3, ("hoff",)),
        (0.3, 0.7, ("dl",)),
        (0.51, 0.7, ()),
        (0.49, 0.3, ("dl", "hoff")),
    ],
)
def test_a_parameter_is_weakly_determined_below_one_half(dl_share, hoff_share, weak):
    """The columns of the two parameters are orthogonal, so each has its own share from the data.

    On a wall ahead, the derivative of the misclosure by dl is 1, and that by hoff is tan(phi); the
    misclosure is linear in both. If the data have the information N on a parameter and its prior
    has 1 / p^2, the share of the data is N / (N + 1 / p^2).
    """
    noise_m, phi, error_m = 0.02, np.linspace(-0.7, 0.7, 41), 0.003
    share = np.array([dl_share, hoff_share])
    information = np.array([len(phi), np.sum(np.tan(phi) ** 2)]) / noise_m**2
    prior = np.sqrt(share / (1.0 - share) / information)
    data, zero = on_wall(phi, error_m * (1.0 + np.tan(phi))[None])
    model = Stochastic(noise_std_m=noise_m, prior_std=dict(zip(("dl", "hoff"), prior, strict=True)))
    found = adjust_all(data, zero, ("dl", "hoff"), WithPrior(), model)[0]
    # The data alone would correct both by -error_m, the prior alone by zero.
    np.testing.assert_allclose(found.corrections, -share * error_m, rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(found.parts["prior"])), (1.0 - share) * prior)
    assert found.weakly_determined == weak
    assert sorted(found.non_estimable) == sorted(weak)


@pytest.mark.parametrize(("block_deg", "above"), [(None, ()), (10.0, ("dl",))])
def test_a_stated_deviation_above_the_prior_is_named(block_deg, above):
    """A pattern of 2 cm that stays for 10 deg: 36 independent errors instead of 360.

    Independent errors of 2 cm would give the mean to 1.1 mm, and the blocks give it to 3.5 mm. The
    prior of 2 mm lies between the two.
    """
    n = 360
    phi = np.deg2rad(np.arange(n) + 0.5)
    pattern = np.repeat(np.where(np.arange(36) % 2 == 0, 0.02, -0.02), 10)
    data, zero = on_floor(phi, pattern[None])
    model = Stochastic(
        noise_std_m=0.02,
        prior_std={"dl": 0.002},
        block_rad=None if block_deg is None else np.deg2rad(block_deg),
    )
    found = adjust_all(data, zero, ("dl",), PaperModel(truncate_at=1.0), model)[0]
    assert found.rank == 1  # independent noise decides, whatever is stated
    assert found.std[0] == pytest.approx(0.02 / np.sqrt(n if block_deg is None else 36), rel=0.1)
    assert found.std_above_prior == above
    columns = CalibrationSet.from_adjustments([found], zero).to_columns()
    assert columns["std_above_prior"] == [" ".join(above)]
    read = {name: np.array(values) for name, values in columns.items()}
    assert CalibrationSet.from_columns(read, zero).quality[0].std_above_prior == above
