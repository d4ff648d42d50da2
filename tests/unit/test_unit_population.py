"""The integration over the sizes of a unit, against distributions whose moments are known."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import digamma, polygamma
from scipy.stats import gamma, ortho_group

from velocal.adjustment.unit.population import Population, Size, integrate, quantiles

NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Given(Population):
    """A population of which the density of the logarithms is known in closed form."""

    minus_2_log_of: object
    slope_of: object

    @classmethod
    def of(cls, d, minus_2_log, slope):
        sizes = (Size("dl", "m", 1.0, False, NONE, NONE),) * d
        return cls(None, sizes, False, minus_2_log, slope)

    def posterior(self, sums, log):
        return At(self.minus_2_log_of(log), self.slope_of(log))

    def minus_2_log_prior(self, log):
        return 0.0, np.zeros(len(log))


@dataclass
class At:
    minus_2_log: float
    slope: np.ndarray

    def gradient(self, members, common_members):
        return self.slope


def normal(mean, covariance):
    weight = np.linalg.inv(covariance)
    return Given.of(
        len(mean),
        lambda log: (log - mean) @ weight @ (log - mean),
        lambda log: 2.0 * weight @ (log - mean),
    )


def log_gamma(shape, turn):
    """Coordinates ``turn' log`` whose exponentials have independent gamma distributions."""
    return Given.of(
        len(shape),
        lambda log: 2.0 * (np.exp(turn.T @ log) - shape * (turn.T @ log)).sum(),
        lambda log: 2.0 * turn @ (np.exp(turn.T @ log) - shape),
    )


def found(population, mode, points=32):
    integrated = integrate(population, None, mode, points, lambda _, values: np.log(values))
    return integrated.weight, np.stack(integrated.found)


@given(st.integers(3, 9), st.integers(2, 60), st.integers(0, 99))
def test_a_normal_distribution_has_its_mean_and_covariance(d, points, seed):
    """They are polynomials of second degree, which the points integrate without any error."""
    rng = np.random.default_rng(seed)
    turn, mean = ortho_group.rvs(d, random_state=seed), rng.normal(size=d)
    covariance = (turn * rng.uniform(0.05, 1.5, d)) @ turn.T
    weight, logs = found(normal(mean, covariance), mean, points)
    assert len(weight) >= points
    np.testing.assert_allclose(weight, 1.0 / len(weight), rtol=1e-6)
    np.testing.assert_allclose(weight @ logs, mean, atol=1e-9)
    about = logs - mean
    np.testing.assert_allclose((weight[:, None] * about).T @ about, covariance, atol=1e-6)


@pytest.mark.parametrize("d", [1, 2, 3, 5, 8])
def test_a_skew_distribution_is_nearly_right(d):
    """Sizes that few observations decide: the left tail of the logarithm is the longer one."""
    shape = np.linspace(1.0, 6.0, d)
    turn = ortho_group.rvs(d, random_state=d) if d > 1 else np.eye(1)
    weight, logs = found(log_gamma(shape, turn), turn @ np.log(shape))
    logs = logs @ turn
    mean, std = digamma(shape), np.sqrt(polygamma(1, shape))
    error = (weight @ logs - mean) / std
    assert np.abs(error).max() < 0.2
    spread = np.sqrt(weight @ (logs - weight @ logs) ** 2)
    np.testing.assert_allclose(spread, std, rtol=0.25)
    # At the mode alone, the mean of the least known would be wrong by more.
    assert np.abs((np.log(shape) - mean) / std).max() > 0.3
    for number in range(d):
        low, high = quantiles(logs[:, number], weight, (0.05, 0.95))
        true_low, true_high = np.log(gamma.ppf((0.05, 0.95), shape[number]))
        # No point is farther out than the sphere: the end of the long tail is not reached.
        assert abs(low - true_low) < 0.9 * std[number]
        assert abs(high - true_high) < 0.25 * std[number]


def test_one_point_is_the_mode():
    mode = np.log([2.0, 3.0])
    weight, logs = found(log_gamma(np.array([2.0, 3.0]), np.eye(2)), mode, points=1)
    assert weight.tolist() == [1.0]
    np.testing.assert_allclose(logs, mode[None])


def test_the_result_is_the_same_each_time():
    population, mode = log_gamma(np.arange(1.0, 6.0), np.eye(5)), np.log(np.arange(1.0, 6.0))
    first, second = found(population, mode), found(population, mode)
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
