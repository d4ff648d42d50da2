"""Parameter sets: mean of windows, then of samples."""

import numpy as np
import pytest

from velocal.adjustment.tabulate import Corrections
from velocal.averaging import average, scatter_table


def part(value, noise, common=0.0, seen=True):
    return Corrections(
        {"dl": np.array([value])},
        {"dl": np.array([np.hypot(noise, common)])},
        {"dl": np.array([noise])},
        np.array([seen]),
    )


def test_mean_of_means():
    samples = [[part(1.0, 0.1), part(3.0, 0.1)], [part(6.0, 0.2), part(10.0, 0.2)]]
    dl = average(samples)["dl"]
    assert dl.mean[0] == (2.0 + 8.0) / 2
    np.testing.assert_allclose(dl.std[0], np.sqrt(2 * 0.1**2 + 2 * 0.2**2) / 4)
    np.testing.assert_allclose(dl.scatter[0], np.std([2.0, 8.0], ddof=1))


def test_what_is_common_does_not_average_out():
    dl = average([[part(1.0, 0.3, 0.4)] * 100])["dl"]
    np.testing.assert_allclose(dl.std[0], np.hypot(0.3 / 10, 0.4))
    np.testing.assert_allclose(dl.stated[0], 0.5)


def test_weighted_mean_is_the_literal_one():
    samples = [[part(1.0, 0.1), part(3.0, 0.2)], [part(6.0, 0.4)] * 2]
    weight = 1 / np.array([0.1, 0.2, 0.4, 0.4]) ** 2
    expected = weight @ [1.0, 3.0, 6.0, 6.0] / weight.sum()
    dl = average(samples, "covariance")["dl"]
    np.testing.assert_allclose(dl.mean[0], expected)
    np.testing.assert_allclose(dl.std[0], np.sqrt(1 / weight.sum()))


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


def test_table():
    samples = [[part(1.0, 0.1)], [part(3.0, 0.1)]]
    table = scatter_table(average(samples), average(samples, "covariance"), {"dl": "m"})
    assert table["parameter"] == ["dl"]
    assert table["plain_mean"] == [2.0]
    assert table["scatter"][0] == pytest.approx(np.sqrt(2))
