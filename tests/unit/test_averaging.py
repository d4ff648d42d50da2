"""Parameter sets: mean of windows, then of samples."""

import numpy as np
import pytest

from velocal.adjustment.average import average, average_covariance, scatter_table
from velocal.adjustment.tabulate import Corrections


def part(value, noise, common=0.0, seen=True):
    return Corrections(
        {"dl": np.array([value])},
        {"dl": np.array([np.hypot(noise, common)])},
        {"dl": np.array([noise])},
        np.array([seen]),
    )


def test_mean_of_means():
    samples = [[part(1.0, 0.1), part(3.0, 0.1)], [part(6.0, 0.2), part(10.0, 0.2)]]
    dl = average(samples, positions=["P1", "P2"])["dl"]
    assert dl.mean[0] == (2.0 + 8.0) / 2
    np.testing.assert_allclose(dl.std[0], np.hypot(0.1, 0.2) / 2)
    # At one position both have the same errors.
    np.testing.assert_allclose(average(samples)["dl"].std[0], (0.1 + 0.2) / 2)
    np.testing.assert_allclose(dl.scatter[0], np.std([2.0, 8.0], ddof=1))


def test_what_is_common_does_not_average_out():
    dl = average([[part(1.0, 0.3, 0.4)]] * 100, positions=[f"P{i}" for i in range(100)])["dl"]
    np.testing.assert_allclose(dl.std[0], np.hypot(0.3 / 10, 0.4))
    np.testing.assert_allclose(dl.stated[0], 0.5)
    np.testing.assert_allclose(average([[part(1.0, 0.3, 0.4)] * 100])["dl"].std[0], 0.5)


def test_weighted_mean_is_the_literal_one():
    samples = [[part(1.0, 0.1), part(3.0, 0.2)], [part(6.0, 0.4)] * 2]
    weight = 1 / np.array([0.1, 0.2, 0.4, 0.4]) ** 2
    expected = weight @ [1.0, 3.0, 6.0, 6.0] / weight.sum()
    dl = average(samples, "covariance")["dl"]
    np.testing.assert_allclose(dl.mean[0], expected)
    np.testing.assert_allclose(dl.std[0], weight @ weight**-0.5 / weight.sum())


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_adjustments_that_did_not_see_the_laser_have_no_say(weighting):
    unseen = part(0.0, 0.0, 0.2, seen=False)
    dl = average([[part(1.0, 0.1), unseen], [unseen, unseen]], weighting)["dl"]
    assert dl.mean[0] == 1.0
    np.testing.assert_allclose(dl.std[0], 0.1)
    nothing = average([[unseen]], weighting)["dl"]
    assert nothing.mean[0] == 0.0
    assert np.isnan(nothing.std[0])
    assert np.isnan(nothing.scatter[0])


PAIR = ("dl", "v")


def pair_of(noise, common, seen=True):
    """An adjustment of dl and v with these 2 x 2 covariance matrices."""
    total = noise + common
    std, noise_std = (
        dict(zip(PAIR, np.sqrt(np.diag(m))[:, None], strict=True)) for m in (total, noise)
    )
    return Corrections(
        dict.fromkeys(PAIR, np.zeros(1)), std, noise_std, np.array([seen]),
        {PAIR: total[0, 1:]}, {PAIR: noise[0, 1:]},
    )  # fmt: skip


def matrix(rng):
    root = rng.normal(size=(2, 2))
    return root @ root.T


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_covariance_of_a_mean(weighting):
    rng = np.random.default_rng(4)
    noise, common = matrix(rng), matrix(rng)
    # Noise goes down with the number of positions, what they have in common does not.
    alike = [[pair_of(noise, common)] * 3] * 2
    two, one = (average_covariance(alike, weighting, at)[PAIR][0] for at in (["A", "B"], ["A"] * 2))
    np.testing.assert_allclose(two, noise[0, 1] / 2 + common[0, 1])
    np.testing.assert_allclose(one, noise[0, 1] + common[0, 1])
    # Of a single one the mean is no news, and one that saw nothing changes nothing.
    unseen = pair_of(common, noise, seen=False)
    single = average_covariance([[pair_of(noise, common), unseen], [unseen, unseen]], weighting)
    np.testing.assert_allclose(single[PAIR][0], noise[0, 1] + common[0, 1])
    assert np.isnan(average_covariance([[unseen]], weighting)[PAIR][0])


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_covariances_belong_to_the_standard_deviations(weighting):
    rng = np.random.default_rng(5)
    for _ in range(200):
        samples = [[pair_of(matrix(rng), matrix(rng)) for _ in range(3)] for _ in range(2)]
        at = ["A", rng.choice(["A", "B"])]
        std = average(samples, weighting, at)
        covariance = average_covariance(samples, weighting, at)[PAIR]
        correlation = covariance / (std["dl"].std * std["v"].std)
        assert abs(correlation[0]) <= 1.0 + 1e-12


def test_covariance_against_a_simulated_mean():
    rng = np.random.default_rng(6)
    noise, common = [matrix(rng) for _ in range(2)], matrix(rng)
    samples = [[pair_of(noise[0], common)], [pair_of(noise[1], common)]]
    drawn = rng.multivariate_normal([0, 0], common, 400_000)
    for one in noise:
        drawn += rng.multivariate_normal([0, 0], one, 400_000) / 2
    found = average_covariance(samples, positions=["A", "B"])[PAIR][0]
    np.testing.assert_allclose(found, np.cov(drawn.T)[0, 1], rtol=0.03)


def test_table():
    samples = [[part(1.0, 0.1)], [part(3.0, 0.1)]]
    table = scatter_table(average(samples), average(samples, "covariance"), {"dl": "m"})
    assert table["parameter"] == ["dl"]
    assert table["plain_mean"] == [2.0]
    assert table["scatter"][0] == pytest.approx(np.sqrt(2))
