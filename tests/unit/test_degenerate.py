"""Degenerate geometry ends in a named finding, not in a number."""

import warnings

import numpy as np
import pytest

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.solvers import (
    GaussHelmert,
    OrdinaryLeastSquares,
    PaperModel,
    WithPrior,
)
from velocal.adjustment.stochastic import Stochastic
from velocal.scanner.parameters import LaserParameters

NAMES = ("dl", "alpha", "v")
PRIOR = {"dl": 0.02, "alpha": np.deg2rad(0.2), "v": np.deg2rad(0.2), "voff": 0.01, "hoff": 0.01}
NOISE_M = 2e-3
#: Those that know what a parameter may be, and so what it is not worth to estimate.
KNOWING = {
    "paper": PaperModel(truncate_at=1.0),
    "prior": WithPrior(),
    "helmert_1": GaussHelmert(truncate_at=1.0),
}
#: Those that are stopped by machine precision only.
PLAIN = {"helmert": GaussHelmert(), "least_squares": OrdinaryLeastSquares()}
SOLVERS = {**KNOWING, **PLAIN}

FLOOR, NORTH, SOUTH, EAST = (
    ([0.0, 0.0, -1.0], -0.8),
    ([0.0, 1.0, 0.0], -3.0),
    ([0.0, -1.0, 0.0], -2.0),
    ([1.0, 0.0, 0.0], -2.5),
)


def laser(v_deg: float) -> LaserParameters:
    return LaserParameters(*(np.array([x]) for x in (0.05, 0.02, np.deg2rad(v_deg), 0.2, 0.026)))


def observed(true: LaserParameters, parts, noise=NOISE_M) -> Observations:
    """Beams at angles (degrees) on planes, one pair for each plane."""
    rng = np.random.default_rng(5)
    phi = np.concatenate([np.deg2rad(angles) for _, angles in parts])
    sizes = [len(angles) for _, angles in parts]
    plane = np.repeat(np.arange(len(parts)), sizes)
    normal = np.array([normal for (normal, _), _ in parts])[plane]
    offset = np.array([offset for (_, offset), _ in parts])[plane]
    which = np.zeros(len(phi), dtype=int)
    data = Observations(np.zeros(len(phi)), phi, which, normal, offset, plane)
    distance = -data.misclosure(true) + rng.normal(0.0, noise, len(phi))
    return Observations(distance, phi, which, normal, offset, plane)


def ahead(n=200, width=40.0):
    return np.linspace(-width, width, n)


CASES = {
    # name: vertical angle, planes with angles, what those that know must leave to the prior
    "floor only": (-20.0, [(FLOOR, np.linspace(0.0, 359.0, 200))], ("alpha",)),
    "horizontal beam, vertical walls": (
        0.0,
        [(NORTH, ahead()), (EAST, 90.0 + ahead())],
        ("v",),
    ),
    "one plane": (-2.0, [(NORTH, ahead())], ("v",)),
    "two parallel planes": (-2.0, [(NORTH, ahead()), (SOUTH, 180.0 + ahead())], ("v",)),
    "all points equal": (-10.0, [(NORTH, np.full(50, 10.0))], ("alpha", "v")),
}


def adjusted(case, solver, *, names=NAMES, stochastic=None):
    v_deg, parts, _ = CASES[case]
    true = laser(v_deg)
    start = true.corrected({"dl": np.array([-0.01]), "alpha": np.array([0.001])})
    model = stochastic or Stochastic(
        noise_std_m=NOISE_M, prior_std=PRIOR, block_rad=np.deg2rad(5.0)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = adjust_all(observed(true, parts), start, names, SOLVERS[solver], model)[0]
        half = found.interval()
        assert found.correlation.shape == (len(names), len(names))
    assert np.isfinite(found.corrections).all()
    assert np.isfinite(found.covariance).all()
    assert np.isfinite(half).all()
    return found


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("case", CASES)
def test_numbers_are_finite_and_the_finding_has_a_name(case, solver):
    found = adjusted(case, solver)
    assert found.message
    # What is left open is said, or else its uncertainty is: both for nobody's surprise.
    if found.rank < len(NAMES):
        assert found.non_estimable
        assert "left to the prior" in found.message
    else:
        assert found.converged


@pytest.mark.parametrize("solver", KNOWING)
@pytest.mark.parametrize("case", CASES)
def test_what_the_data_do_not_show_stays_with_its_prior(case, solver):
    found = adjusted(case, solver)
    assert found.converged
    assert found.rank < len(NAMES)
    for name in CASES[case][2]:
        assert any(name in text for text in found.non_estimable), found.non_estimable
    for name in found.weakly_determined:
        number = NAMES.index(name)
        assert abs(found.corrections[number]) < PRIOR[name]
        # The prior's, but for its share in what is estimable.
        assert 0.5 * PRIOR[name] < found.std[number] < 1.5 * PRIOR[name]
    for number, name in enumerate(NAMES):
        assert found.std[number] < 1.5 * PRIOR[name]


@pytest.mark.parametrize("solver", SOLVERS)
def test_zero_columns_are_left_out_at_machine_precision_too(solver):
    """The rotational angle does not matter on a level floor, nor a height on vertical walls."""
    found = adjusted("floor only", solver)
    assert "alpha" in found.weakly_determined
    assert found.corrections[1] == pytest.approx(0.0, abs=1e-9)
    assert found.std[1] == pytest.approx(PRIOR["alpha"], rel=1e-6)
    # Rank 1: the length of the beam, of which dl and v have their parts.
    assert found.rank == 1
    walls = adjusted("horizontal beam, vertical walls", solver, names=("dl", "alpha", "voff"))
    assert walls.weakly_determined == ("voff",)
    assert walls.non_estimable == ("voff",)
    assert walls.std[2] == pytest.approx(PRIOR["voff"])


@pytest.mark.parametrize("solver", SOLVERS)
def test_equal_points_determine_one_combination(solver):
    found = adjusted("all points equal", solver)
    assert found.rank == 1
    assert len(found.non_estimable) == 2


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("block_deg", [None, 5.0])
def test_a_laser_without_points(solver, block_deg):
    true = laser(-10.0)
    empty = observed(true, [(NORTH, ahead())]).take(np.zeros(0, dtype=int))
    block = None if block_deg is None else np.deg2rad(block_deg)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = adjust_all(
            empty,
            true,
            NAMES,
            SOLVERS[solver],
            Stochastic(noise_std_m=0.02, prior_std=PRIOR, block_rad=block),
        )
        half = found[0].interval()
    assert found[0].message == "no observations"
    assert found[0].weakly_determined == NAMES
    assert found[0].rank == 0
    assert not found[0].corrections.any()
    np.testing.assert_allclose(found[0].std, [PRIOR[name] for name in NAMES])
    assert np.isfinite(half).all()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_hardly_any_points(solver, n):
    """As few points as parameters, or fewer: no variance to estimate, none of zero stated."""
    true = laser(-10.0)
    few = observed(true, [(NORTH, ahead())]).take(np.arange(n) * 40)
    model = Stochastic(noise_std_m=NOISE_M, prior_std=PRIOR, block_rad=np.deg2rad(5.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = adjust_all(few, true, NAMES, SOLVERS[solver], model)[0]
        half = found.interval()
    assert found.message
    assert np.isfinite(found.corrections).all()
    assert np.isfinite(half).all()
    assert (found.std > 0).all()


def test_blocks_too_few_to_show_a_variance_do_not_state_none():
    """All points in one block: the sum of its residuals is zero, the noise is not."""
    true = laser(-10.0)
    data = observed(true, [(NORTH, np.linspace(10.2, 14.8, 50))])
    model = Stochastic(noise_std_m=NOISE_M, prior_std=PRIOR, block_rad=np.deg2rad(5.0))
    found = adjust_all(data, true, ("dl",), OrdinaryLeastSquares(), model)[0]
    # At most as if the rows of the block were one.
    assert 0.5 * NOISE_M < found.std[0] < 2.0 * NOISE_M
    assert found.dof[0] == 1.0
