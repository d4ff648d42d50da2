"""What the adjustment of a unit will state, before anything is measured."""

from dataclasses import replace

import numpy as np
import pytest

from velocal.adjustment.unit import predict
from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.predict import UnitSizes, predict_unit
from velocal.adjustment.unit.settings import UnitSettings
from velocal.arrays import joined_rows
from velocal.errors import VelocalError
from velocal.scanner.models import SCANNERS
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import draw

#: Agreement that the planner promises.
WITHIN = 0.15
SIZES = UnitSizes(
    spread={
        "dl": 0.02,
        "alpha": 1.7e-3,
        "v": 1.7e-3,
        "scale": 3e-4,
        "hoff": 4e-4,
        "shift": 1.3e-3,
        "plane": 2e-4,
        "common": 1e-3,
    },
    tau_m=np.array(0.0034),
    omega_m=np.array(0.006),
    length_rad=0.016,
)


def unit_of(stations, every):
    """Stations of a simulated VLP-16, the same without misclosures, factory and settings."""
    trial = draw(Plan(scanner="VLP-16", stations=stations, windows=1, every=every), 31)
    measured = [each.survey.of_unit(joined_rows(each.windows)) for each in trial.stations]
    expected = []
    for station in measured:
        data = station.observations
        distance = data.distance_m - data.misclosure(trial.factory)
        expected.append(replace(station, observations=replace(data, distance_m=distance)))
    settings = UnitSettings.recommended(SCANNERS["VLP-16"], factory=trial.factory)
    return measured, expected, trial.factory, settings


def std_of(unit):
    return np.sqrt(np.diagonal(unit.calibration.covariance, axis1=1, axis2=2))


@pytest.mark.parametrize("stations", [1, 2])
def test_agrees_with_the_adjustment(stations):
    measured, expected, factory, settings = unit_of(stations, 4)
    stated = adjust_unit(measured, factory, settings)
    planned = predict_unit(expected, factory, settings, UnitSizes.of(stated))
    ratio = np.median(std_of(planned) / std_of(stated), axis=0)
    assert np.all(np.abs(ratio - 1.0) < WITHIN)


@pytest.fixture
def population(monkeypatch):
    """Population and sums of a prediction whose sizes have to be learnt."""
    seen = {}
    search = predict.find_mode

    def spy(population, sums, start):
        seen.update(population=population, sums=sums)
        return search(population, sums, start)

    monkeypatch.setattr(predict, "find_mode", spy)
    _, expected, factory, settings = unit_of(2, 40)
    predict_unit(expected, factory, replace(settings, integration_points=1), SIZES)
    return seen["population"], seen["sums"]


def test_the_expected_likelihood_is_largest_at_the_truth(population):
    population, sums = population
    own, common = population.posterior(sums, population.true_log).second_moments
    # What is learnt from data agrees with the truth on average, whichever unknown it is.
    assert np.allclose(own, 1.0, atol=1e-6)
    assert np.allclose(common, 1.0, atol=1e-6)


def test_gradient_is_the_derivative_of_the_expected_likelihood(population):
    population, sums = population
    log = population.true_log + 0.3 * np.cos(np.arange(len(population.true_log)))
    members = [size.own for size in population.learnt]
    common = [size.common for size in population.learnt]
    step = 1e-4
    numeric = [
        population.posterior(sums, log + step * e).minus_2_log
        - population.posterior(sums, log - step * e).minus_2_log
        for e in np.eye(len(log))
    ]
    gradient = population.posterior(sums, log).gradient(members, common)
    assert np.allclose(gradient, np.array(numeric) / (2.0 * step), atol=1e-3)


def test_without_means_nothing_is_corrected():
    _, expected, factory, settings = unit_of(1, 40)
    planned = predict_unit(expected, factory, settings, SIZES)
    assert np.abs(planned.calibration.corrections).max() < 1e-12
    moved = predict_unit(expected, factory, settings, replace(SIZES, mean={"dl": 0.02}))
    # One station knows the mean of dl to some millimetres.
    assert np.allclose(moved.calibration.corrections[:, 0], 0.02, atol=0.005)


def test_sizes_that_must_be_learnt_make_the_statement_wider():
    _, expected, factory, settings = unit_of(1, 10)
    learnt = predict_unit(expected, factory, settings, SIZES)
    exactly = {name: (x, x) for name, x in SIZES.spread.items()}
    given = predict_unit(expected, factory, settings, replace(SIZES, found=exactly))
    assert np.median(std_of(learnt)[:, 2]) > np.median(std_of(given)[:, 2])


def test_a_missing_size_is_named():
    _, expected, factory, settings = unit_of(1, 40)
    spread = {name: value for name, value in SIZES.spread.items() if name != "hoff"}
    with pytest.raises(VelocalError, match="no spread of hoff"):
        predict_unit(expected, factory, settings, replace(SIZES, spread=spread))
