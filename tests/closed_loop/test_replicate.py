"""The study in memory: what `make seeds` runs many times."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.chain import study_world
from support.world import changed

from velocal.paper import printed, replicate, tuning
from velocal.paper.agreement import judged
from velocal.study.reading import read_yaml
from velocal.study.study import read_study

ROOT = Path(__file__).parents[2]
WORLD = study_world()

#: Some constants of the HDL-32E's errors, and another value of each.
OTHER = {
    "dl_cm": 0.5,
    "range_scale_cm_per_m": 0.2,
    "pattern_median_cm": 1.0,
    "noise_median_cm": 1.0,
    "shift_cm": 1.0,
    "thermal_cm_per_k": 0.1,
}


def small_study(monkeypatch):
    """Sample sa5 alone."""
    monkeypatch.chdir(ROOT)
    study = read_study(read_yaml(ROOT / "config/config.yaml"), "configuration")
    return replace(study, surveyed={"sa5": study.surveyed["sa5"]})


def numbers(world, study):
    found = replicate.lasers(world, study, 1)
    return found[["rms_cm", "within_1sigma_pct", "within_3sigma_pct"]]


def warm(**errors):
    """The world with a warm sample and other errors of the unit."""
    values = {f"scanners/HDL-32E/errors/{name}": value for name, value in errors.items()}
    start = {"warmth/samples/sa5": {"halogen": True, "start_k": 10.0}}
    return changed(WORLD, start | values)


def test_a_constant_of_the_world_changes_the_numbers(monkeypatch):
    study = small_study(monkeypatch)
    before = numbers(warm(), study)
    pd.testing.assert_frame_equal(before, numbers(warm(), study))
    same = [name for name in OTHER if numbers(warm(**{name: OTHER[name]}), study).equals(before)]
    assert same == []


def test_another_seed_is_another_unit(monkeypatch):
    study = small_study(monkeypatch)
    first, second = (numbers(changed(WORLD, {"seed": seed}), study) for seed in (1, 2))
    assert (first["rms_cm"] - second["rms_cm"]).abs().max() > 0.5


def replica(value):
    rows = [judged(row.item("std_cm"), row.values["std_cm"], value, 0.3)
            for row in printed.printed_rows()[:2]]  # fmt: skip
    return pd.DataFrame(rows)


@pytest.mark.parametrize(("values", "within"), [((3.4, 3.7), "true"), ((3.6, 3.8), "false")])
def test_spread(values, within):
    found = replicate.spread(dict(enumerate(map(replica, values)))).iloc[0]
    assert found["item"] == "II HDL-64E sa3 beginning before std_cm"
    assert found["mean"] == pytest.approx(sum(values) / 2)
    assert found["std"] == pytest.approx(abs(values[0] - values[1]) / 2**0.5, abs=1e-3)
    assert (found["minimum"], found["maximum"], found["seeds"]) == (*values, 2)
    assert found["tolerance"] == printed.tolerances_of_mean()[found["item"]] == 0.15
    assert found["within"] == within


def test_tuning_finds_the_constants_of_made_up_tables():
    """Cells that are linear in two constants, with known best values."""
    content = {"tuned": ["a/x", "b"], "a": {"x": 2.0, "y": 7.0}, "b": 0.0}

    def cells(world, study, seeds, rotations):
        assert world["a"]["y"] == 7.0
        assert (study, list(seeds), rotations) == (None, [1, 2], 3)
        x, b = tuning.value_at(world, "a/x"), tuning.value_at(world, "b")
        return np.array([x - 1.5, 2.0 * (b - 0.3), x + b - 1.8])

    found = tuning.tune(content, None, [1, 2], 3, iterations=20, evaluate=cells)
    assert found["after"].to_numpy() == pytest.approx([1.5, 0.3], abs=1e-3)
    assert (found["misfit_after"] < 1e-2).all()
    assert content["a"]["x"] == 2.0


def test_tuning_takes_a_shorter_step_where_the_world_allows_no_constants():
    """A standard deviation below zero has no cells; the best value lies beside it."""
    errors = "scanners/HDL-64E/errors"
    content = WORLD.plain() | {"tuned": [f"{errors}/dl_cm", f"{errors}/dl_mean_cm"]}
    start, refused = tuning.value_at(content, content["tuned"][1]), []

    def cells(world, study, seeds, rotations):
        size, mean = (tuning.value_at(world, path) for path in content["tuned"])
        if size < 0.0:
            refused.append(tuning.misfit(world, study, seeds, rotations))
            return refused[-1]
        return np.array([np.sqrt(size) - 0.1, mean - start])

    found = tuning.tune(content, None, [1], 3, iterations=50, evaluate=cells)
    assert found["after"][0] == pytest.approx(0.01, abs=1e-3)
    assert refused
    assert set(np.concatenate(refused)) == {np.inf}
