"""Stated uncertainty against truth, on medians drawn at random; bounds follow from the runs.

A root mean square of N independent errors is known to 1 / sqrt(2 N), a share p to
sqrt(p (1 - p) / N). Errors of pose and drift are common to the lasers of a run: for shares, only
the runs count as independent, which is cautious for everything else.
"""

import numpy as np
import pytest
import yaml
from support.chain import WORLD, study_world

from velocal.adjustment.solvers import GaussHelmert, PaperModel, WithPrior
from velocal.simulation.coverage import (
    cramer_rao,
    observable_only,
    of_unit,
    outcome,
    summary,
    white_only,
)
from velocal.simulation.draws import full_draws, geometry, white_draws
from velocal.study.adjustment import Adjustments

CONFIG = yaml.safe_load((WORLD.parent / "config.yaml").read_text())["adjustment"]
MODEL = Adjustments.model_validate(CONFIG).stochastic()
NAMES = ("dl", "alpha", "v")
STATIONS = {"HDL-64E": "P2", "HDL-32E": "P5"}


@pytest.mark.slow
@pytest.mark.parametrize("solver", [GaussHelmert(), PaperModel(truncate_at=None)], ids=["A", "B"])
@pytest.mark.parametrize("names", [NAMES, NAMES[:2]], ids=["all three", "dl and alpha"])
@pytest.mark.parametrize("scanner", STATIONS)
def test_white_noise_reaches_the_cramer_rao_bound(scanner, names, solver):
    runs, white = 200, white_only(MODEL)
    every = geometry(study_world(), scanner, STATIONS[scanner], every=9)
    at = observable_only(every, white, names)
    bound = cramer_rao(at, white, names)
    found = outcome(white_draws(at, white, names, runs, 7), at, names, solver, white)
    ratio = np.sqrt(np.mean(found.error**2, axis=0)) / bound
    # Of each laser, 4 standard deviations; of all together, the band that is claimed.
    assert np.abs(ratio - 1.0).max() < 4.0 / np.sqrt(2.0 * runs)
    pooled = np.sqrt(np.mean(ratio**2, axis=0))
    margin = 3.0 / np.sqrt(2.0 * runs * len(ratio))
    assert (pooled > 0.95 - margin).all()
    assert (pooled < 1.10 + margin).all()
    assert np.abs(found.error.mean(axis=0) / bound).max() < 4.0 / np.sqrt(runs)


@pytest.mark.slow
@pytest.mark.parametrize("scanner", STATIONS)
def test_intervals_cover_the_truth_with_all_errors(scanner):
    runs = 150
    at = geometry(study_world(), scanner, STATIONS[scanner], every=9)
    model = of_unit(MODEL, at.errors)
    found = outcome(full_draws(at, MODEL, NAMES, runs, 7, scenes=15), at, NAMES, WithPrior(), model)
    margin = 300.0 * np.sqrt(0.95 * 0.05 / runs)
    for row in summary(found):
        print(row)
        assert abs(row["coverage_95_pct"] - 95.0) < margin, row
        # Three standard deviations of a root mean square over the runs.
        assert abs(row["ratio"] - 1.0) < 3.0 / np.sqrt(2.0 * runs), row


def test_configured_sizes_are_those_of_the_first_unit():
    """Range scale and repeatability of the configuration are the HDL-64E's of the world."""
    at = geometry(study_world(), "HDL-64E", "P2", every=32)
    unit = of_unit(MODEL, at.errors)
    assert unit.range_scale == pytest.approx(MODEL.range_scale)
    assert unit.repeatability_m == pytest.approx(MODEL.repeatability_m, rel=0.05)


def test_draws_depend_on_seed_and_run_only():
    at = geometry(study_world(), "HDL-32E", "P5", every=16)
    first, second = (list(full_draws(at, MODEL, NAMES, n, 3, scenes=2)) for n in (2, 3))
    for one, other in zip(first, second, strict=False):
        np.testing.assert_array_equal(one.observations.distance_m, other.observations.distance_m)
        np.testing.assert_array_equal(one.survey.pose, other.survey.pose)
    assert (first[0].observations.distance_m != first[1].observations.distance_m).all()
