"""Solver of the paper's model: fast form against the literal one, rank, prior."""

from dataclasses import replace

import numpy as np
import pytest
from support.adjustment import adjust_laser

from velocal.adjustment.lasers import adjust_all, find_corrections
from velocal.adjustment.linear import System
from velocal.adjustment.observations import Observations, joined
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.solvers import PaperModel, WithPrior
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.errors import ConfigError, VelocalError
from velocal.paper.residual_form import PaperLiteral
from velocal.scanner.parameters import PARAMETERS, LaserParameters
from velocal.study.adjustment import Adjustment
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


def test_truncation_leaves_out_what_the_prior_knows_better():
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


def test_known_parameters_return_and_voff_is_weakly_determined():
    data, true = walls()
    start = true.corrected({"dl": np.array([-0.03]), "alpha": np.array([0.004])})
    found = adjust_laser(
        data,
        0,
        start,
        ("dl", "alpha", "voff"),
        PaperModel(truncate_at=1.0),
        Stochastic(noise_std_m=1e-3, prior_std=PRIOR),
    )
    assert found.converged
    assert found.weakly_determined == ("voff",)
    np.testing.assert_allclose(found.corrections, [0.03, -0.004, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.std[2], PRIOR["voff"])
    assert found.non_estimable == ("voff",)
    assert "left to the prior: voff" in found.message


def test_standard_deviation_is_that_of_repeated_noise():
    errors, stated = [], []
    for _ in range(200):
        data, true = walls(60, noise=0.01)
        found = adjust_laser(
            data,
            0,
            true,
            ("dl", "alpha"),
            PaperModel(truncate_at=1.0),
            Stochastic(noise_std_m=0.01, prior_std=PRIOR),
        )
        errors.append(found.corrections)
        stated.append(found.std)
    ratio = np.std(errors, axis=0) / np.sqrt(np.mean(np.square(stated), axis=0))
    # 200 runs know a standard deviation to 5 %.
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


def calibrated(names=("dl", "alpha"), noise=0.01):
    """Calibration of one laser on two walls."""
    data, true = walls(noise=noise)
    model = Stochastic(noise_std_m=0.02, prior_std={**PRIOR, "scale": 1e-3})
    return CalibrationSet.from_adjustments(adjust_all(data, true, names, WithPrior(), model), true)


def test_tables_of_a_calibration_read_back():
    written = calibrated()
    columns, covariance = (
        {name: np.asarray(column) for name, column in table.items()}
        for table in (written.to_columns(), written.covariance_columns())
    )
    back = CalibrationSet.from_columns(columns, written.initial, covariance)
    assert back.names == written.names
    assert back.quality == written.quality
    assert list(back.sources) == list(written.sources)
    for table in ("corrections", "observed", "covariance", "std", "noise_std"):
        np.testing.assert_array_equal(getattr(back, table), getattr(written, table))
    np.testing.assert_array_equal(back.adjusted.dl, written.adjusted.dl)
    # Without the second table the corrections are known and their uncertainty is not.
    alone = CalibrationSet.from_columns(columns, written.initial)
    np.testing.assert_array_equal(alone.corrections, written.corrections)
    assert np.isnan(alone.std).all()


def test_covariances_of_a_calibration_are_the_sum_of_their_sources():
    found = calibrated()
    table = found.covariance_columns()
    total = sum(np.array(table[source]) for source in found.sources)
    np.testing.assert_allclose(total, table["covariance"])
    assert list(zip(table["first"], table["second"], strict=True)) == [
        ("dl", "dl"), ("dl", "alpha"), ("alpha", "alpha"),
    ]  # fmt: skip
    assert table["correlation"][0] == pytest.approx(1.0)
    np.testing.assert_array_equal(found.covariance_by_pair()["dl", "alpha"], table["covariance"][1])
    np.testing.assert_array_equal(found.std_by_name()["alpha"], found.std[:, 1])


def test_adjusted_parameters_leave_a_range_scale_out():
    found = calibrated(("dl", "scale"))
    np.testing.assert_array_equal(found.adjusted.dl, found.initial.dl + found.corrections[:, 0])
    np.testing.assert_array_equal(found.range_scale, found.corrections[:, 1])
    assert calibrated().range_scale is None


def test_summary_of_a_calibration():
    found = calibrated(("dl", "v", "voff"))
    first, _, *rows = found.summary().splitlines()
    assert first == "1 lasers, 1 of them observed, 1 converged"
    assert [row.split()[:2] for row in rows] == [["dl", "cm"], ["v", "deg"], ["voff", "cm"]]
    assert float(rows[0].split()[2]) == pytest.approx(found.corrections[0, 0] * 100, abs=5e-4)
    # Vertical walls say nothing of a height.
    assert rows[2].split()[-1] == "1"


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"drop": "rank"}, "column 'rank' is missing"),
        ({"drop": "dl_correction_m"}, "no parameter for 0 lasers"),
        ({"lasers": 2}, "corrections of dl for 1 lasers"),
        ({"first": ["v"]}, "covariances of v"),
    ],
)
def test_a_table_that_does_not_belong_is_refused(fault, message):
    found = calibrated(("dl",))
    columns = {name: np.asarray(column) for name, column in found.to_columns().items()}
    columns.pop(fault.get("drop"), None)
    lasers = np.zeros(fault.get("lasers", 1), dtype=int)
    initial = LaserParameters(*(getattr(found.initial, name)[lasers] for name in PARAMETERS))
    covariance = {name: np.asarray(c) for name, c in found.covariance_columns().items()}
    covariance["first"] = np.asarray(fault.get("first", covariance["first"]))
    with pytest.raises(VelocalError, match=message):
        CalibrationSet.from_columns(columns, initial, covariance)


def test_settings():
    config = {"method": "paper", "truncate_at": None, "noise_cm": 2, "prior": {"v_deg": 90}}
    chosen = validated(Adjustment, config | {"parameters": ["v"]}, "config")
    assert chosen.solver() == PaperModel(truncate_at=None)
    assert chosen.stochastic() == Stochastic(noise_std_m=0.02, prior_std={"v": np.pi / 2})
    with pytest.raises(ConfigError, match=r"method: 'magic' \(allowed: prior, paper"):
        validated(Adjustment, config | {"parameters": ["v"], "method": "magic"}, "config")


def test_a_parameter_without_a_prior_is_named():
    data, true = walls()
    model = Stochastic(noise_std_m=0.02, prior_std={"dl": 0.02})
    with pytest.raises(VelocalError, match=r"no prior standard deviation of voff.*allowed: dl"):
        adjust_all(data, true, ("dl", "voff"), WithPrior(), model)


@pytest.mark.parametrize("solver", [PaperModel(), WithPrior()])
def test_corrections_alone_are_those_of_the_whole_adjustment(solver):
    data, true = walls(noise=0.01)
    names, model = ("dl", "alpha"), Stochastic(noise_std_m=0.01, prior_std=PRIOR)
    start = LaserParameters(*np.repeat([getattr(true, name) for name in PARAMETERS], 2, axis=1))
    whole = adjust_all(data, start, names, solver, model)
    corrections, converged = find_corrections(data, start, names, solver, model)
    np.testing.assert_array_equal(corrections, [each.corrections for each in whole])
    # Nothing is seen of the second laser.
    np.testing.assert_array_equal(converged, [True, False])
    assert corrections[0].all()
    assert not corrections[1].any()


def test_parameters_have_their_order():
    assert PARAMETERS == ("dl", "alpha", "v", "voff", "hoff")


def test_what_two_stations_have_of_uneven_walls():
    """Half the variance of one, wherever the angles of the two lie between each other."""
    data, true = walls(noise=0.001)
    survey = SurveyUncertainty(
        translation=np.zeros(3),
        pose=np.zeros((6, 6)),
        planes=np.zeros((2, 4, 4)),
        flatness_m=np.full(2, 0.004),
    )
    data = replace(data, plane=(data.phi > 0).astype(int))
    again = replace(data, phi=data.phi + 1e-6)
    parts = []
    for stations in ([data], [data, again]):
        model = Stochastic(noise_std_m=0.01, prior_std=PRIOR, survey=(survey,) * len(stations))
        found = adjust_laser(joined(stations), 0, true, ("dl", "alpha"), WithPrior(), model)
        parts.append(found.parts["flatness"])
    # Where cells begin is not the same for the second.
    np.testing.assert_allclose(np.diag(parts[1]), np.diag(parts[0]) / 2, rtol=0.05)
