"""The bench that compares methods where the truth is known: what is run again, and its verdicts."""

import sys
from dataclasses import replace
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


def test_further_draws_are_kept_apart_and_have_intervals(bench):
    _, tables = bench
    errors = {"factory": 5.0, "joint": 1.2, "oracle": 1.0}
    rows = [
        {"case": case, "seed": seed, "method": method, "unseen_cm": error}
        | dict.fromkeys(tables.PARAMETERS.values(), error)
        | {f"cover_{name}": 0.95 for name in tables.PARAMETERS}
        for case, seed, methods in (("near", 1, ["dl"]), ("near", 2, []), ("near", 3, []))
        for method, error in [*errors.items(), *((name, 3.0) for name in methods)]
    ]
    rows[5]["dl_cm"] = 2.4  # The joint adjustment of seed 2.
    draws = pd.DataFrame(rows)
    assert set(tables.complete(draws)["seed"]) == {1}
    line = tables.further_table(draws.drop(tables.complete(draws).index)).splitlines()[2]
    _, study, number, dl, alpha, *_, worst, _ = (cell.strip() for cell in line.split("|"))
    assert (study, number) == (bench[0].CASES["near"].text, "2")
    assert dl == f"{np.sqrt((2.4**2 + 1.2**2) / 2):.2f} (1.20 to 2.40)"
    assert alpha == "1.20 (1.20 to 1.20)"
    assert worst == "0.24"


def test_dl_is_judged_at_one_range_also_where_it_depends_on_the_range(bench):
    """A scanner with a dl of 1 m measures a raw distance of 2 m at a range of 3 m.

    The true values miss the true correction by no more than the form of their file: it takes the
    correction of X at the range of X, which is shorter than the beam.
    """
    import calibration_judge
    from calibration_methods import truth

    from velocal.simulation.independent.plan import Plan, UnitErrors
    from velocal.simulation.independent.shots import FAR_M
    from velocal.simulation.independent.trial import NEAR_M, draw

    trial = draw(Plan(every=40, windows=1, unit=UnitErrors(two_point_cm=2.0)), 1)
    slope = np.full(len(trial.slope), 0.001)
    near = {
        name: trial.true.dl + slope * (at - FAR_M)
        for name, at in zip(calibration_judge.NEAR_POINT, NEAR_M, strict=True)
    }
    true = replace(trial.true, carried={**trial.true.carried, **near})
    trial = replace(trial, true=true, slope=slope)
    found = calibration_judge.judged(trial, truth(trial))["dl_mean"] * 1e-2
    azimuth, v = np.arange(0.0, 2.0 * np.pi, 0.01), true.v[:, None]
    x, y = (np.cos(v) * abs(turn(azimuth - true.alpha[:, None])) for turn in (np.sin, np.cos))
    # It takes the length with the correction of the far point.
    at_m = 3.0 + slope[0] * (FAR_M - 3.0)
    shorter = at_m * (x**3 + (np.sin(v) ** 2 + y**2) * y) - 3.0
    assert found == pytest.approx(slope[0] * shorter.mean(), rel=0.005)


def test_draws_that_are_worse_have_the_verdict_of_the_hold_out(bench):
    _, tables = bench
    row = {"case": "HDL-64E-1", "seed": 7, "ratio": 1.0312, "held": 1.2, "verdict": "worse"}
    line = tables.harm_table(pd.DataFrame([row])).splitlines()[2]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == [tables.CASES["HDL-64E-1"].text, "7", "1.031", "1.200", "worse"]
