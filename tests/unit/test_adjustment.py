"""Solver of the paper's model: fast form against the literal one, rank, prior."""

from dataclasses import replace

import numpy as np
import pytest

from velocal.adjustment import tabulate
from velocal.adjustment.lasers import Observations, adjust_all, adjust_laser, joined
from velocal.adjustment.solvers import PaperLiteral, PaperModel, System, WithPrior
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.errors import ConfigError
from velocal.scanner.parameters import PARAMETERS, LaserParameters
from velocal.study.config import Adjustment
from velocal.study.model import validated

RNG = np.random.default_rng(1)
PRIOR = {"dl": 0.02, "alpha": 0.0035, "v": 0.0035, "voff": 0.01, "hoff": 0.01}


def system(a, w, prior, noise=1.0):
    return System(
        a, w, np.full(len(w), noise), np.asarray(prior, dtype=float), np.zeros(len(prior))
    )


@pytest.mark.parametrize("n", [10, 100, 400])
@pytest.mark.parametrize("deficient", [False, True])
def test_fast_form_is_the_literal_form(n, deficient):
    a = RNG.normal(size=(n, 3))
    if deficient:
        a[:, 2] = 2.0 * a[:, 0] - a[:, 1]
    w, prior = RNG.normal(size=n), np.array([1.0, 0.5, 2.0])
    fast = PaperModel(truncate_at=None).step(system(a, w, prior))
    # The paper's n x n form, written out once more.
    p_inverse = np.diag(prior**2)
    n_matrix = a @ p_inverse @ a.T
    expected = p_inverse @ a.T @ (-np.linalg.pinv(n_matrix, rcond=1e-12, hermitian=True) @ w)
    np.testing.assert_allclose(fast.delta, expected, rtol=1e-10, atol=1e-12)
    literal = PaperLiteral().step(system(a, w, prior))
    np.testing.assert_allclose(fast.delta, literal.delta, rtol=1e-10, atol=1e-12)
    assert fast.rank == literal.rank == (2 if deficient else 3)
    if deficient:
        # Least P-norm: any other least-squares solution is longer in units of the prior.
        null = np.array([2.0, -1.0, -1.0])
        for t in (-0.1, 0.1):
            other = fast.delta + t * null
            assert np.allclose(a @ other, a @ fast.delta)
            assert np.linalg.norm(other / prior) > np.linalg.norm(fast.delta / prior)


def test_full_rank_is_least_squares_whatever_the_prior():
    a, w = RNG.normal(size=(50, 3)), RNG.normal(size=50)
    expected = -np.linalg.lstsq(a, w)[0]
    for _ in range(20):
        prior = RNG.uniform(0.01, 100.0, 3)
        step = PaperModel(truncate_at=None).step(system(a, w, prior))
        np.testing.assert_allclose(step.delta, expected, rtol=1e-9)


def test_truncation_holds_what_the_prior_knows_better():
    a = np.column_stack([np.ones(100), np.linspace(-1e-3, 1e-3, 100)])
    w = RNG.normal(0.0, 1.0, 100)
    step = PaperModel(truncate_at=1.0).step(system(a, w, [1.0, 1.0]))
    assert step.rank == 1
    np.testing.assert_allclose(np.diag(step.estimable), [1.0, 0.0], atol=1e-12)
    assert abs(step.delta[1]) < 1e-12


def walls(n=400, noise=0.0):
    """Observations of one laser on two vertical walls, with known parameters."""
    true = LaserParameters(*(np.array([x]) for x in (0.05, 0.02, -0.2, 0.2, 0.026)))
    phi = RNG.uniform(-0.8, 0.8, n)
    laser = np.zeros(n, dtype=int)
    normal = np.where((phi > 0)[:, None], [0.6, 0.8, 0.0], [-0.6, 0.8, 0.0])
    offset = np.full(n, -3.0)
    data = Observations(np.zeros(n), phi, laser, normal, offset)
    distance = -data.misclosure(true) + RNG.normal(0.0, noise, n)
    return Observations(distance, phi, laser, normal, offset), true


def test_known_parameters_return_and_voff_is_held():
    data, true = walls()
    start = true.corrected({"dl": np.array([-0.03]), "alpha": np.array([0.004])})
    found = adjust_laser(
        data, 0, start, ("dl", "alpha", "voff"), PaperModel(1.0), Stochastic(1e-3, PRIOR)
    )
    assert found.converged
    assert found.held == ("voff",)
    np.testing.assert_allclose(found.corrections, [0.03, -0.004, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.std[2], PRIOR["voff"])
    assert found.open_combinations == ("voff",)
    assert "left to the prior: voff" in found.message


def test_standard_deviation_is_that_of_repeated_noise():
    errors, stated = [], []
    for _ in range(200):
        data, true = walls(60, noise=0.01)
        found = adjust_laser(
            data, 0, true, ("dl", "alpha"), PaperModel(1.0), Stochastic(0.01, PRIOR)
        )
        errors.append(found.corrections)
        stated.append(found.std)
    ratio = np.std(errors, axis=0) / np.sqrt(np.mean(np.square(stated), axis=0))
    # 200 runs know a standard deviation to 5 %.
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


def test_table_of_corrections_reads_back():
    data, true = walls()
    results = adjust_all(data, true, ("dl", "v"), PaperModel(), Stochastic(0.02, PRIOR))
    columns = tabulate.corrections(results)
    back = tabulate.read_corrections({name: np.asarray(column) for name, column in columns.items()})
    assert list(back.value) == list(back.std) == list(back.noise_std) == ["dl", "v"]
    assert back.observed.all()
    assert back.value["dl"][0] == results[0].corrections[0]


def test_table_of_covariances_sums_its_sources():
    data, true = walls()
    results = adjust_all(data, true, ("dl", "alpha"), WithPrior(), Stochastic(0.02, PRIOR))
    table = tabulate.covariances(results)
    total = sum(np.array(table[source]) for source in results[0].parts)
    np.testing.assert_allclose(total, table["covariance"])
    assert table["correlation"][0] == pytest.approx(1.0)


def test_settings():
    config = {"method": "paper", "truncate_at": None, "noise_cm": 2, "prior": {"v_deg": 90}}
    chosen = validated(Adjustment, config | {"parameters": ["v"]}, "config")
    assert chosen.solver() == PaperModel(None)
    assert chosen.stochastic() == Stochastic(0.02, {"v": np.pi / 2})
    with pytest.raises(ConfigError, match=r"method: 'magic' \(allowed: prior, paper"):
        validated(Adjustment, config | {"parameters": ["v"], "method": "magic"}, "config")


def test_parameters_have_their_order():
    assert PARAMETERS == ("dl", "alpha", "v", "voff", "hoff")


def test_what_two_stations_have_of_uneven_walls():
    """Half the variance of one, wherever the angles of the two lie between each other."""
    data, true = walls(noise=0.001)
    survey = SurveyUncertainty(
        np.zeros(3), np.zeros((6, 6)), np.zeros((2, 4, 4)), np.full(2, 0.004)
    )
    data = replace(data, plane=(data.phi > 0).astype(int))
    again = replace(data, phi=data.phi + 1e-6)
    parts = []
    for stations in ([data], [data, again]):
        model = Stochastic(0.01, PRIOR, survey=(survey,) * len(stations))
        found = adjust_laser(joined(stations), 0, true, ("dl", "alpha"), WithPrior(), model)
        parts.append(found.parts["flatness"])
    # Where cells begin is not the same for the second.
    np.testing.assert_allclose(np.diag(parts[1]), np.diag(parts[0]) / 2, rtol=0.05)
