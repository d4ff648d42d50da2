"""Means of calibrations: over the windows of a sample, then over the samples."""

from dataclasses import replace

import numpy as np
import pytest

from velocal.adjustment.average import Member, average, scatter_columns
from velocal.adjustment.result import CalibrationSet
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

FACTORY = LaserParameters(*np.zeros((5, 1)))


def calibration(names, value, noise, common, seen=True):
    """One laser with these matrices of covariance."""
    sources = {"noise": np.atleast_3d(noise).T, "prior": np.atleast_3d(common).T}
    return CalibrationSet(
        names, FACTORY, np.full((1, len(names)), value), np.array([seen]), sources
    )


def part(value, noise, common=0.0, seen=True):
    """An adjustment of dl with these standard deviations."""
    return calibration(("dl",), value, [[noise**2]], [[common**2]], seen)


def members(samples, positions=None):
    """Members of nested lists of windows, all at one position unless positions are given."""
    return [
        Member(f"sa{number}", positions[number] if positions else "P1", window)
        for number, windows in enumerate(samples)
        for window in windows
    ]


def dl(samples, weighting="equal", positions=None):
    """Mean and standard deviation of dl, and what is stated and seen beside them."""
    listed = members(samples, positions)
    found, beside = average(listed, weighting), scatter_columns(listed)
    return found.corrections[0, 0], found.std[0, 0], beside["scatter"][0], beside["stated_std"][0]


def test_mean_of_means():
    samples = [[part(1.0, 0.1), part(3.0, 0.1)], [part(6.0, 0.2), part(10.0, 0.2)]]
    mean, std, scatter, _ = dl(samples, positions=["P1", "P2"])
    assert mean == (2.0 + 8.0) / 2
    np.testing.assert_allclose(std, np.hypot(0.1, 0.2) / 2)
    # At one position both have the same errors.
    np.testing.assert_allclose(dl(samples)[1], (0.1 + 0.2) / 2)
    np.testing.assert_allclose(scatter, np.std([2.0, 8.0], ddof=1))


def test_samples_of_unequal_numbers_of_windows_count_once_each():
    samples = [[part(1.0, 0.1)], [part(2.0, 0.2), part(3.0, 0.2), part(7.0, 0.2)]]
    mean, std, scatter, stated = dl(samples, positions=["P1", "P2"])
    np.testing.assert_allclose(mean, (1.0 + 4.0) / 2)
    np.testing.assert_allclose(std, np.hypot(0.1, 0.2) / 2)
    np.testing.assert_allclose(scatter, np.std([1.0, 4.0], ddof=1))
    np.testing.assert_allclose(stated, np.sqrt((0.1**2 + 3 * 0.2**2) / 4))
    # The order of the members does not matter.
    listed = members(samples, ["P1", "P2"])
    np.testing.assert_allclose(average(listed[::-1]).corrections, mean)


def test_what_is_common_does_not_average_out():
    alike = [[part(1.0, 0.3, 0.4)]] * 100
    _, std, _, stated = dl(alike, positions=[f"P{i}" for i in range(100)])
    np.testing.assert_allclose(std, np.hypot(0.3 / 10, 0.4))
    np.testing.assert_allclose(stated, 0.5)
    np.testing.assert_allclose(dl([[part(1.0, 0.3, 0.4)] * 100])[1], 0.5)


def test_weighted_mean_is_the_literal_one():
    samples = [[part(1.0, 0.1), part(3.0, 0.2)], [part(6.0, 0.4)] * 2]
    weight = 1 / np.array([0.1, 0.2, 0.4, 0.4]) ** 2
    expected = weight @ [1.0, 3.0, 6.0, 6.0] / weight.sum()
    mean, std, *_ = dl(samples, "covariance")
    np.testing.assert_allclose(mean, expected)
    np.testing.assert_allclose(std, weight @ weight**-0.5 / weight.sum())


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_adjustments_that_did_not_see_the_laser_have_no_say(weighting):
    unseen = part(0.0, 0.0, 0.2, seen=False)
    mean, std, *_ = dl([[part(1.0, 0.1), unseen], [unseen, unseen]], weighting)
    assert mean == 1.0
    np.testing.assert_allclose(std, 0.1)
    mean, std, scatter, _ = dl([[unseen]], weighting)
    assert mean == 0.0
    assert np.isnan(std)
    assert np.isnan(scatter)
    assert not average(members([[unseen]])).observed.any()


def test_plain_mean_needs_no_covariance():
    bare = [[replace(part(value, 0.1), sources={})] for value in (1.0, 3.0)]
    found = average(members(bare))
    assert found.corrections[0, 0] == 2.0
    assert not found.sources
    assert np.isnan(found.std).all()
    with pytest.raises(VelocalError, match="no covariance to weight it by"):
        average(members(bare), "covariance")


def test_members_that_do_not_belong_together_are_refused():
    other = replace(part(1.0, 0.1), initial=FACTORY.corrected({"v": np.array([0.1])}))
    for sample in (other, pair_of(np.eye(2), np.eye(2))):
        with pytest.raises(VelocalError, match="sa1 has other parameters or initial values"):
            average(members([[part(1.0, 0.1)], [sample]]))
    with pytest.raises(VelocalError, match="no calibration to average"):
        average([])


PAIR = ("dl", "v")


def pair_of(noise, common, seen=True):
    """An adjustment of dl and v with these 2 x 2 covariance matrices."""
    return calibration(PAIR, 0.0, noise, common, seen)


def covariance(samples, weighting="equal", positions=None):
    """Covariance of the means of dl and v."""
    return average(members(samples, positions), weighting).covariance_by_pair()[PAIR][0]


def matrix(rng):
    root = rng.normal(size=(2, 2))
    return root @ root.T


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_covariance_of_a_mean(weighting):
    rng = np.random.default_rng(4)
    noise, common = matrix(rng), matrix(rng)
    # Noise goes down with the number of positions, what they have in common does not.
    alike = [[pair_of(noise, common)] * 3] * 2
    two, one = (covariance(alike, weighting, at) for at in (["A", "B"], ["A"] * 2))
    np.testing.assert_allclose(two, noise[0, 1] / 2 + common[0, 1])
    np.testing.assert_allclose(one, noise[0, 1] + common[0, 1])
    # Of a single one the mean is no news, and one that saw nothing changes nothing.
    unseen = pair_of(common, noise, seen=False)
    single = covariance([[pair_of(noise, common), unseen], [unseen, unseen]], weighting)
    np.testing.assert_allclose(single, noise[0, 1] + common[0, 1])
    assert np.isnan(covariance([[unseen]], weighting))


@pytest.mark.parametrize("weighting", ["equal", "covariance"])
def test_covariances_belong_to_the_standard_deviations(weighting):
    rng = np.random.default_rng(5)
    for _ in range(200):
        samples = [[pair_of(matrix(rng), matrix(rng)) for _ in range(3)] for _ in range(2)]
        at = ["A", rng.choice(["A", "B"])]
        found = average(members(samples, at), weighting)
        correlation = found.covariance[0, 0, 1] / np.prod(found.std[0])
        assert abs(correlation) <= 1.0 + 1e-12


def test_covariance_against_a_simulated_mean():
    rng = np.random.default_rng(6)
    noise, common = [matrix(rng) for _ in range(2)], matrix(rng)
    samples = [[pair_of(noise[0], common)], [pair_of(noise[1], common)]]
    drawn = rng.multivariate_normal([0, 0], common, 400_000)
    for one in noise:
        drawn += rng.multivariate_normal([0, 0], one, 400_000) / 2
    found = covariance(samples, positions=["A", "B"])
    np.testing.assert_allclose(found, np.cov(drawn.T)[0, 1], rtol=0.03)


def test_table():
    samples = [[part(1.0, 0.1)], [part(3.0, 0.1)]]
    table = scatter_columns(members(samples))
    assert table["parameter"] == ["dl"]
    assert table["unit"] == ["m"]
    assert table["plain_mean"] == [2.0]
    assert table["scatter"][0] == pytest.approx(np.sqrt(2))
