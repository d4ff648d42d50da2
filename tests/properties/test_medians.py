"""Medians per laser and bin, against a loop over the bins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from velocal.errors import VelocalError
from velocal.reduction.medians import binned_medians

DIVISORS = [width for width in range(1, 36_001) if 36_000 % width == 0]


def bin_by_bin(azimuth, laser_id, distance, lasers_per_firing, bin_ticks, min_count):
    """One row a bin: laser, mean azimuth of the firings, median, spread, count."""
    rows = []
    for laser in sorted(set(laser_id)):
        for one_bin in sorted(set(azimuth // bin_ticks)):
            there = (laser_id == laser) & (azimuth // bin_ticks == one_bin)
            returned = distance[there & (distance > 0)].astype(float)
            if len(returned) < min_count or len(returned) == 0:
                continue
            low, high = np.quantile(returned, [0.25, 0.75])
            mean = azimuth[there].astype(float).mean()
            rows.append((laser, mean, np.median(returned), (high - low) / 1.3489795, len(returned)))
    return rows


@st.composite
def returns(draw: st.DrawFn):
    """Firings in any order, of the blocks of an HDL-64E, an HDL-32E or a VLP-16."""
    width, firsts = draw(st.sampled_from([(32, [0, 32]), (32, [0]), (16, [0]), (32, [32])]))
    n = draw(st.integers(1, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bin_ticks = draw(st.sampled_from(DIVISORS))
    # Few bins, so that some are hit often; the last of the turn is among them.
    bins = rng.integers(0, 36_000 // bin_ticks, 3)
    bins[0] = 36_000 // bin_ticks - 1
    azimuth = rng.choice(bins, n) * bin_ticks + rng.integers(0, bin_ticks, n)
    first = rng.choice(firsts, n)
    distance = rng.integers(0, draw(st.sampled_from([3, 50, 65_536])), (n, width))
    distance[rng.random((n, width)) < draw(st.sampled_from([0.0, 0.3, 0.95]))] = 0
    return {
        "azimuth": np.repeat(azimuth, width).astype(np.uint16),
        "laser_id": (first[:, None] + np.arange(width)).reshape(-1).astype(np.uint8),
        "distance": distance.reshape(-1).astype(np.uint16),
        "lasers_per_firing": width,
        "bin_ticks": bin_ticks,
        "min_count": draw(st.sampled_from([0, 1, 2, 5])),
    }


@given(returns())
def test_against_a_loop(given_returns):
    found = binned_medians(**given_returns)
    rows = bin_by_bin(**given_returns)
    assert len(found.laser_id) == len(rows)
    if not rows:
        return
    laser, mean, median, spread, count = (np.array(column) for column in zip(*rows, strict=True))
    np.testing.assert_array_equal(found.laser_id, laser)
    np.testing.assert_array_equal(found.count, count)
    np.testing.assert_array_equal(found.distance, median.astype(np.float32))
    np.testing.assert_allclose(found.azimuth, mean, rtol=2e-7)
    np.testing.assert_allclose(found.spread, spread, rtol=1e-6)


@given(returns(), st.randoms(use_true_random=False))
def test_the_order_of_the_firings_does_not_matter(given_returns, random):
    width = given_returns["lasers_per_firing"]
    order = list(range(len(given_returns["azimuth"]) // width))
    random.shuffle(order)
    shuffled = dict(given_returns)
    for name in ("azimuth", "laser_id", "distance"):
        shuffled[name] = given_returns[name].reshape(-1, width)[order].reshape(-1)
    first, second = binned_medians(**given_returns), binned_medians(**shuffled)
    for name in ("laser_id", "distance", "spread", "count"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_allclose(first.azimuth, second.azimuth, rtol=2e-7)


def one_laser(distances, **options):
    """Returns of laser 3 of a VLP-16 in one bin; the others see nothing."""
    rows = np.zeros((len(distances), 16), np.uint16)
    rows[:, 3] = distances
    return binned_medians(
        np.full(rows.size, 1234, np.uint16),
        np.tile(np.arange(16, dtype=np.uint8), len(distances)),
        rows.reshape(-1),
        **{"lasers_per_firing": 16, "bin_ticks": 20, "min_count": 1, **options},
    )


def test_by_hand():
    found = one_laser([0, 500, 502, 0, 500, 510])
    assert list(found.laser_id) == [3]
    assert list(found.count) == [4]
    assert list(found.distance) == [501.0]
    assert list(found.azimuth) == [1234.0]
    assert found.spread[0] == pytest.approx((504 - 500) / 1.3489795)


def test_the_longest_distance_is_a_distance():
    """65535 ticks also mark what is missing inside."""
    found = one_laser([65_535, 65_535, 0, 7])
    assert list(found.count) == [3]
    assert list(found.distance) == [65_535.0]


def test_too_few_returns():
    assert len(one_laser([500, 501, 0], min_count=3).laser_id) == 0
    assert len(one_laser([500, 501, 9], min_count=3).laser_id) == 1
    assert len(one_laser([0, 0], min_count=0).laser_id) == 0


def test_the_spread_of_noise_is_its_standard_deviation():
    rng = np.random.default_rng(7)
    found = one_laser(np.rint(5000 + 400 * rng.standard_normal(20_000)).astype(np.uint16))
    assert found.spread[0] == pytest.approx(400, rel=0.03)


@pytest.mark.parametrize("bin_ticks", [7, 11, 35_999])
def test_a_bin_must_divide_the_turn(bin_ticks):
    with pytest.raises(VelocalError, match="does not divide the turn"):
        one_laser([1, 2], bin_ticks=bin_ticks)


def test_rows_must_be_whole_firings():
    with pytest.raises(VelocalError, match="48 returns are not whole firings of 32"):
        one_laser([1, 2, 3], lasers_per_firing=32)


def test_no_returns():
    assert len(one_laser([]).laser_id) == 0
