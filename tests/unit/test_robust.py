"""Robust solvers: a fifth of the distances wrong, all to one side."""

from dataclasses import replace

import numpy as np
import pytest
from support.adjustment import adjust_laser

from velocal.adjustment.observations import Observations
from velocal.adjustment.robust import Robust, huber, igg, snooping
from velocal.adjustment.solvers import WithPrior
from velocal.adjustment.stochastic import Stochastic
from velocal.scanner.parameters import LaserParameters

NAMES = ("dl", "alpha")
TRUE = LaserParameters(*(np.array([x]) for x in (0.05, 0.02, -0.2, 0.2, 0.026)))
START = TRUE.corrected({"dl": np.array([-0.06]), "alpha": np.array([0.002])})
STOCHASTIC = Stochastic(noise_std_m=0.01, prior_std={"dl": 0.05, "alpha": 0.0035})


def data(share, size, noise=0.01, n=500):
    """Two walls; a share of the distances is too long by `size`."""
    rng = np.random.default_rng(12)
    phi = np.sort(rng.uniform(-0.8, 0.8, n))
    normal = np.where((phi > 0)[:, None], [0.6, 0.8, 0.0], [-0.6, 0.8, 0.0])
    flat = Observations(
        np.zeros(n), phi, np.zeros(n, dtype=int), normal, np.full(n, -3.0),
        (phi > 0).astype(int),
    )  # fmt: skip
    bad = rng.random(n) < share
    distance = -flat.misclosure(TRUE) + rng.normal(0.0, noise, n) + np.where(bad, size, 0.0)
    return replace(flat, distance_m=distance), bad


def test_weights():
    sizes = np.array([0.0, 1.0, 2.0, 5.0])
    np.testing.assert_allclose(huber(sizes), [1.0, 1.0, 1.345 / 2, 1.345 / 5])
    np.testing.assert_allclose(igg(sizes), [1.0, 1.0, 0.75 * (1 / 1.5) ** 2, 0.0])
    np.testing.assert_allclose(snooping(sizes), [1.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("kind", "size", "bound"),
    [(kind, size, 2e-3) for kind in ("igg", "snooping") for size in (0.2, 1.0, 10.0)]
    # Huber's weights bound the influence of an outlier and never end it.
    + [("huber", size, 0.012) for size in (0.2, 1.0, 10.0)],
)
def test_outliers_of_one_side(kind, size, bound):
    seen, _ = data(0.2, size)
    plain = adjust_laser(seen, 0, START, NAMES, WithPrior(), STOCHASTIC)
    found = adjust_laser(seen, 0, START, NAMES, Robust(base=WithPrior(), kind=kind), STOCHASTIC)
    assert found.converged
    assert abs(plain.corrections[0] - 0.06) > 0.03
    assert abs(found.corrections[0] - 0.06) < bound


def test_sums_are_those_of_the_weighted_rows():
    """What was rejected neither counts nor shows in the variance."""
    for block_rad in (None, 0.1):
        model = replace(STOCHASTIC, block_rad=block_rad)
        seen, bad = data(0.2, 1.0)
        found = adjust_laser(
            seen, 0, START, NAMES, Robust(base=WithPrior(), kind="snooping"), model
        )
        clean = adjust_laser(seen.take(~bad), 0, START, NAMES, WithPrior(), model)
        assert found.redundancy == pytest.approx(clean.redundancy, abs=5)
        assert found.variance_factor == pytest.approx(clean.variance_factor, rel=0.05)
        np.testing.assert_allclose(found.noise_std, clean.noise_std, rtol=0.1)


def test_good_data_lose_little():
    seen, _ = data(0.0, 0.0)
    plain = adjust_laser(seen, 0, START, NAMES, WithPrior(), STOCHASTIC)
    for kind in ("huber", "igg", "snooping"):
        found = adjust_laser(seen, 0, START, NAMES, Robust(base=WithPrior(), kind=kind), STOCHASTIC)
        np.testing.assert_allclose(found.corrections, plain.corrections, atol=1e-3)


def test_exact_data_have_no_spread():
    seen, _ = data(0.0, 0.0, noise=0.0)
    found = adjust_laser(seen, 0, TRUE, NAMES, Robust(base=WithPrior(), kind="igg"), STOCHASTIC)
    np.testing.assert_allclose(found.corrections, 0.0, atol=1e-12)
