"""The sums of a unit against one dense Gaussian computation with all unknowns in one matrix."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit import describe as describe_module
from velocal.adjustment.unit.common_mean import CommonMean
from velocal.adjustment.unit.describe import describe
from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.model import UNKNOWNS, WITH_MEAN, Effect, Linearised, Shared
from velocal.adjustment.unit.noise import Noise
from velocal.adjustment.unit.station import Bins
from velocal.adjustment.unit.sums import Layout, groups_of, sums

LASERS, PLANES, SURVEY, ROWS = 3, (2, 1), 4, 9
U = len(UNKNOWNS)


@dataclass
class Case:
    """A small unit with random columns, and the same as dense matrices."""

    sums: object
    std: np.ndarray
    common_std: np.ndarray
    design: np.ndarray
    noise: np.ndarray
    z: np.ndarray

    @property
    def prior(self):
        return np.concatenate([np.tile(self.std, LASERS), self.common_std]) ** 2

    @property
    def covariance(self):
        return self.noise + (self.design * self.prior) @ self.design.T

    def dense(self):
        """Posterior mean and covariance of all unknowns."""
        weight = np.linalg.inv(self.noise)
        normal = self.design.T @ weight @ self.design + np.diag(1.0 / self.prior)
        inverse = np.linalg.inv(normal)
        return inverse @ (self.design.T @ weight @ self.z), inverse


def case(seed=0):
    rng = np.random.default_rng(seed)
    stations = len(PLANES)
    layout = Layout(stations, PLANES, SURVEY)
    laser = np.repeat(np.arange(LASERS), stations * ROWS)
    station = np.tile(np.repeat(np.arange(stations), ROWS), LASERS)
    n = len(laser)
    plane = rng.integers(0, np.array(PLANES)[station])
    phi = np.sort(rng.uniform(0.0, 1.0, (LASERS * stations, ROWS)), axis=1).ravel()
    count = rng.integers(1, 9, n).astype(float)
    matrix, shared = rng.normal(size=(n, U)), rng.normal(size=(n, SURVEY))
    z = rng.normal(size=n)
    bins = Bins(Observations(z, phi, laser, np.zeros((n, 3)), z, plane, station), count)
    at = Linearised(z, matrix, np.zeros((n, 3)), np.ones(n), np.ones(n))
    groups = LASERS * stations
    noise = Noise(
        rng.uniform(0.3, 0.6, groups), rng.uniform(0.3, 0.6, groups), 0.1, np.ones(groups, bool)
    )
    effects = Shared(shared, (Effect("pose", 0, "", slice(0, SURVEY), np.eye(4)),))
    rows = groups_of(bins, LASERS, stations)
    found = sums(bins, at, effects, noise, layout, rows)
    # Dense: columns of the random unknowns of every laser, then those of the common ones.
    q, m = layout.own, layout.common
    design = np.zeros((n, LASERS * q + m))
    covariance = np.zeros((n, n))
    for number, own in enumerate(rows):
        covariance[np.ix_(own, own)] = noise.covariance(number, phi[own], count[own])
    for i in range(n):
        start = laser[i] * q
        design[i, start : start + U] = matrix[i]
        design[i, start + U + station[i]] = 1.0
        place = U + stations + sum(PLANES[: station[i]]) + plane[i]
        design[i, start + place] = 1.0
        design[i, LASERS * q : LASERS * q + WITH_MEAN] = matrix[i, :WITH_MEAN]
        design[i, LASERS * q + WITH_MEAN + station[i]] = 1.0
        design[i, LASERS * q + WITH_MEAN + stations :] = shared[i]
    return Case(found, rng.uniform(0.2, 1.5, q), rng.uniform(0.5, 2.0, m), design, covariance, z)


def test_posterior_is_that_of_the_dense_computation():
    of = case()
    posterior = Posterior(of.sums, of.std, of.common_std)
    mean, covariance = of.dense()
    q = len(of.std)
    own = mean[: LASERS * q].reshape(LASERS, q)
    np.testing.assert_allclose(posterior.scaled * of.std, own, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(posterior.common, mean[LASERS * q :], rtol=1e-8, atol=1e-10)
    common = np.linalg.inv(posterior.common_root @ posterior.common_root.T)
    expected = covariance[LASERS * q :, LASERS * q :]
    np.testing.assert_allclose(common, expected, rtol=1e-8, atol=1e-10)
    moments, common_moments = posterior.second_moments
    own = (mean**2 + np.diag(covariance)) / of.prior
    np.testing.assert_allclose(moments.ravel(), own[: LASERS * q], rtol=1e-8)
    np.testing.assert_allclose(common_moments, own[LASERS * q :], rtol=1e-8)


def test_likelihood_is_that_of_the_multivariate_normal():
    of = case()
    n = len(of.z)
    direct = -2.0 * multivariate_normal(np.zeros(n), of.covariance).logpdf(of.z)
    found = Posterior(of.sums, of.std, of.common_std).minus_2_log
    np.testing.assert_allclose(found + n * np.log(2.0 * np.pi), direct, rtol=1e-10)


def test_gradient_is_that_of_finite_differences():
    of = case()
    members = [np.array([0]), np.array([1, 2]), np.array([], dtype=int)]
    common = [np.array([], dtype=int), np.array([3]), np.array([5, 6])]

    def value(log):
        std, common_std = of.std.copy(), of.common_std.copy()
        for size, a, b in zip(np.exp(log), members, common, strict=True):
            std[a], common_std[b] = std[a] * size, common_std[b] * size
        return Posterior(of.sums, std, common_std)

    found, step = value(np.zeros(3)).gradient(members, common), 1e-5
    for number, each in enumerate(np.eye(3) * step):
        expected = (value(each).minus_2_log - value(-each).minus_2_log) / (2.0 * step)
        assert found[number] == pytest.approx(expected, rel=1e-6)


def _unchanged(mean, covariance, prior_std, spread, given):
    """A datum that leaves the posterior of the means as it is."""
    return CommonMean(mean, covariance, mean, np.sqrt(np.diag(covariance)), np.ones(3))


def described(of, monkeypatch, datum=_unchanged):
    monkeypatch.setattr(describe_module, "common_mean", datum)
    output = np.random.default_rng(1).normal(size=(LASERS, 3, U))
    survey = {"pose": of.sums.layout.survey.start + np.arange(SURVEY)}
    posterior = Posterior(of.sums, of.std, of.common_std)
    return describe(posterior, np.zeros(0), output, survey), output


def between(of, output):
    """Covariance of the corrections of all lasers with all unknowns, from the dense posterior."""
    q, m = len(of.std), len(of.common_std)
    turn = np.zeros((LASERS * 3, LASERS * q + m))
    for laser in range(LASERS):
        rows = slice(3 * laser, 3 * laser + 3)
        turn[rows, laser * q : laser * q + U] = output[laser]
        turn[rows, LASERS * q : LASERS * q + WITH_MEAN] = output[laser][:, :WITH_MEAN]
    return turn @ of.dense()[1]


def test_covariance_within_and_between_lasers_is_that_of_the_dense_computation(monkeypatch):
    of = case()
    found, output = described(of, monkeypatch)
    mean, covariance = of.dense()
    q, m = len(of.std), len(of.common_std)
    turn = np.zeros((LASERS * 3, LASERS * q + m))
    for laser in range(LASERS):
        rows = slice(3 * laser, 3 * laser + 3)
        turn[rows, laser * q : laser * q + U] = output[laser]
        turn[rows, LASERS * q : LASERS * q + WITH_MEAN] = output[laser][:, :WITH_MEAN]
    total = turn @ covariance @ turn.T
    np.testing.assert_allclose(found.corrections.ravel(), turn @ mean, rtol=1e-8, atol=1e-10)
    for k in range(LASERS):
        for j in range(LASERS):
            block = total[3 * k : 3 * k + 3, 3 * j : 3 * j + 3]
            own = found.together[3 * k : 3 * k + 3, 3 * j : 3 * j + 3]
            if k == j:
                own = found.covariance[k]
            np.testing.assert_allclose(own, block, rtol=1e-8, atol=1e-10)


def test_sources_are_covariances_and_sum_to_the_total(monkeypatch):
    of = case()
    found, _ = described(of, monkeypatch)
    np.testing.assert_allclose(sum(found.sources.values()), found.covariance, rtol=1e-10)
    for name, matrices in found.sources.items():
        least = np.linalg.eigvalsh(matrices).min()
        assert least > -1e-10, name
    assert set(found.sources) == {"noise", "prior", "offsets", "shift", "pose"}


def test_a_known_mean_takes_its_uncertainty_out(monkeypatch):
    """With the means of dl, alpha and v at zero, the posterior is that of a model without them."""
    of = case()

    def zero(mean, covariance, prior_std, spread, given):
        return CommonMean(np.zeros(3), np.zeros((3, 3)), mean, mean, np.zeros(3))

    found, _ = described(of, monkeypatch, zero)
    tight = of.common_std.copy()
    tight[[0, 1, 2]] = 1e-7
    without = Case(of.sums, of.std, tight, of.design, of.noise, of.z)
    expected, _ = described(without, monkeypatch)
    np.testing.assert_allclose(found.corrections, expected.corrections, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(("name", "kind"), [("voff", "offsets"), ("v", "prior")])
def test_an_error_is_stated_at_least(name, kind, monkeypatch):
    """Twice the standard deviation of the model gives four times the variance that it causes."""
    of = case()
    found, output = described(of, monkeypatch)
    survey = {"pose": of.sums.layout.survey.start + np.arange(SURVEY)}
    posterior, place = Posterior(of.sums, of.std, of.common_std), UNKNOWNS.index(name)
    more, less = (
        describe(posterior, np.zeros(0), output, survey, least_std={name: factor * of.std[place]})
        for factor in (2.0, 0.5)
    )
    np.testing.assert_array_equal(less.covariance, found.covariance)
    np.testing.assert_allclose(sum(more.sources.values()), more.covariance, rtol=1e-10)
    # By it alone: its influence on the corrections of all lasers, from the dense posterior.
    influence = between(of, output)[:, [place + k * len(of.std) for k in range(LASERS)]]
    influence = influence.reshape(LASERS, 3, LASERS) / of.std[place]
    expected = 3.0 * influence @ np.swapaxes(influence, 1, 2)
    np.testing.assert_allclose(more.covariance - found.covariance, expected, rtol=1e-7)
    np.testing.assert_allclose(more.sources[kind] - found.sources[kind], expected, rtol=1e-7)


def test_sources_are_those_of_the_dense_computation(monkeypatch):
    """The error from one unknown is its column of the posterior covariance over its prior one."""
    of = case()
    found, output = described(of, monkeypatch)
    q, m, stations = len(of.std), len(of.common_std), len(PLANES)
    random = {"prior": range(WITH_MEAN), "offsets": range(WITH_MEAN, U), "shift": range(U, q)}
    places = {name: [k * q + i for k in range(LASERS) for i in own] for name, own in random.items()}
    places["prior"] += range(LASERS * q, LASERS * q + WITH_MEAN)
    places["shift"] += range(LASERS * q + WITH_MEAN, LASERS * q + WITH_MEAN + stations)
    places["pose"] = list(range(LASERS * q + m - SURVEY, LASERS * q + m))
    for name, own in places.items():
        influence = between(of, output)[:, own] / np.sqrt(of.prior[own])
        influence = influence.reshape(LASERS, 3, -1)
        expected = influence @ np.swapaxes(influence, 1, 2)
        np.testing.assert_allclose(found.sources[name], expected, rtol=1e-7, atol=1e-12)
