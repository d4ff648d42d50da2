"""The bench that compares methods where the truth is known: what is run again, and its verdicts."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def bench(monkeypatch):
    """Modules of the bench, which are no package."""
    monkeypatch.syspath_prepend(str(FOLDER))
    import calibration
    import calibration_tables

    yield calibration, calibration_tables
    for name in [name for name in sys.modules if name.startswith("calibration")]:
        del sys.modules[name]


def test_a_run_that_is_resumed_leaves_out_complete_draws(bench, tmp_path):
    """A method that the case has not, is not missed."""
    calibration, _ = bench
    file = tmp_path / "draws.csv"
    tasks = [("angles-0.2", seed, ("factory", "joint", "paper")) for seed in (1, 2)]
    assert calibration.left(tasks, file) == tasks
    rows = [("angles-0.2", 1, "factory"), ("angles-0.2", 1, "joint"), ("angles-0.2", 2, "joint")]
    pd.DataFrame(rows, columns=["case", "seed", "method"]).to_csv(file, index=False)
    assert calibration.left(tasks, file) == tasks[1:]


@pytest.mark.parametrize(
    ("cover", "kept"),
    [
        ((0.90, 0.99, 0.96), (True, True)),
        ((0.99, 0.90, 0.85), (False, True)),
        ((0.90, 0.90, 0.91), (False, False)),
        ((0.90,), (False,)),
    ],
)
def test_coverage_is_judged_with_its_standard_error_over_the_draws(bench, cover, kept):
    _, tables = bench
    found = tables._coverage_checks("v", "a study", pd.Series(cover))
    assert tuple(check.kept for check in found) == kept
    if len(cover) > 1:
        error = 100.0 * np.std(cover, ddof=1) / np.sqrt(len(cover))
        assert found[0].error == pytest.approx(error)


def test_table_of_surveys_has_a_row_for_each_and_the_factory(bench):
    _, tables = bench
    values = {"dl_cm": 0.1, "alpha_deg": 0.02, "v_deg": 0.03, "unseen_cm": 1.0, "induced_cm": 0.2}
    rows = [
        {"case": case, "seed": seed, "method": method} | values
        for case in ("survey-0.3-0.2-1", "survey-0.1-1-10")
        for seed in (1, 2)
        for method in ("factory", "joint", "truth")
    ]
    lines = tables.survey_table(tables.summarised(pd.DataFrame(rows))).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == [
        "0.3 m, 0.2 mm",
        "0.1 m, 1 mm",
        "factory values",
    ]
    # Six targets on a circle of 0.1 m, 1 and 0.7 mm.
    assert lines[3].split("|")[2].strip() == "0.29"
