"""Comparison with the printed numbers."""

import pandas as pd
import pytest
from compare_with_paper import main
from support.results import TABLES, statistics

from velocal.errors import VelocalError
from velocal.io import storage
from velocal.paper import agreement, printed, tables

_, SUMMARY = statistics()
ROWS = printed.printed_rows()


def reproduced(summary=SUMMARY):
    return pd.concat(
        [
            tables.formatted(tables.build(number, entry, summary, simulated=True).frame)
            for number, entry in TABLES.items()
        ]
    )


def cells(summary=SUMMARY, shown=None):
    shown = reproduced(summary) if shown is None else shown
    return agreement.of_cells(agreement.statistics_shown(summary, shown))


def said(summary=SUMMARY):
    return agreement.said_by_tables(agreement.statistics_shown(summary, reproduced(summary)))


def as_printed():
    """A summary whose numbers are exactly the paper's."""
    summary = SUMMARY.copy()
    for row in ROWS:
        same = (summary["sample"] == row.reproduced_sample) & (summary["window"] == row.window)
        same &= summary["data"] == printed.DATA[row.table]
        before = summary["role"] == "factory"
        same &= before if row.calibration == "before" else ~before
        assert same.any()
        for quantity, value in row.values.items():
            summary.loc[same, tables.STATISTICS[quantity]] = value
    return summary


def test_every_printed_cell_has_a_row():
    found = cells()
    assert list(found) == list(agreement.COLUMNS)
    assert list(found["item"]) == [row.item(q) for row in ROWS for q in printed.TOLERANCES]
    assert found["item"].is_unique
    assert not found.isna().any().any()
    assert set(found["within"]) <= {"true", "false"}
    assert found["item"][0] == "II HDL-64E sa3 beginning before std_cm"


def test_the_papers_own_numbers_agree_exactly():
    summary = as_printed()
    found = cells(summary)
    assert (found["difference"] == 0).all()
    assert (found["within"] == "true").all()


def test_verdict_follows_the_printed_numbers():
    found = cells()
    within = found["difference"].abs() <= found["tolerance"]
    assert (found["within"] == within.map({True: "true", False: "false"})).all()
    assert ((found["reproduced"] - found["paper"] - found["difference"]).abs() < 1e-9).all()
    assert {"true", "false"} == set(found["within"])


@pytest.mark.parametrize(("change", "verdict"), [(0.3, "true"), (0.301, "false"), (-0.3, "true")])
def test_the_tolerance_itself_is_within(change, verdict):
    summary = as_printed()
    summary.loc[summary["role"] == "factory", "rms_cm"] += change
    found = cells(summary).set_index("item")
    assert found["within"]["IV HDL-64E sa1 end before std_cm"] == verdict


def test_numbers_have_all_digits_of_the_statistics():
    found = cells().set_index("item")["reproduced"]
    best = SUMMARY.query(
        "sample == 'sa2' and window == 'end' and data == 'validation' and parameter_set == 'set2'"
    )
    assert found["IV HDL-64E sa2 end after std_cm"] == round(best["rms_cm"].iloc[0], 3)


@pytest.mark.parametrize(
    ("item", "sample", "data", "shown"),
    [
        ("III HDL-32E sa6 middle after std_cm", "sa5", "calibration", ("window", "")),
        ("V HDL-32E sc3 beginning before std_cm", "sa5", "validation", ("factory", "")),
        ("V HDL-32E sa3 end after std_cm", "sa5", "validation", ("set", "set1")),
        ("V HDL-32E sa4 end before std_cm", "sa6", "validation", ("factory", "")),
        ("V HDL-32E sa4 end after std_cm", "sa6", "validation", ("set", "set1")),
    ],
)
def test_contradictory_labels_are_read_as_documented(item, sample, data, shown):
    found = cells().set_index("item")["reproduced"]
    keys = ["scanner", "sample", "window", "data", "role", "parameter_set"]
    rows = SUMMARY.set_index(keys)["rms_cm"]
    value = rows.loc[("HDL-32E", sample, item.split()[3], data, *shown)]
    assert found[item] == round(value, 3)


def test_contradictions_are_cells_and_explained():
    items = {row.item(quantity) for row in ROWS for quantity in printed.TOLERANCES}
    assert set(printed.CONTRADICTIONS) < items
    assert all(len(reason) > 40 for reason in printed.CONTRADICTIONS.values())


@pytest.mark.parametrize(
    ("keep", "message"),
    [
        ("table != 'V'", r"table V.*nothing is reproduced for 'V HDL-32E sc3"),
        ("sample != 'sa4'", r"table II.*HDL-64E, sample sa4"),
        ("not (table == 'IV' and window == 'end')", r"table IV.*window end"),
    ],
)
def test_what_is_missing_is_named(keep, message):
    with pytest.raises(VelocalError, match=rf"{message}(.|\n)*Hint: .*compare_with_paper"):
        cells(shown=reproduced().query(keep))


def test_no_residuals_is_an_error_and_not_a_verdict():
    shown = reproduced()
    summary = SUMMARY.copy()
    for frame, name in ((summary, "rms_cm"), (shown, "std_cm")):
        frame.loc[(frame["sample"] == "sa5") & (frame["window"] == "end"), name] = None
    with pytest.raises(VelocalError, match="with residuals"):
        cells(summary, shown)


def test_tables_of_other_statistics_are_refused():
    other = reproduced()
    other["std_cm"] = other["std_cm"].astype(float) + 0.05
    with pytest.raises(VelocalError, match="do not show numbers of the statistics"):
        cells(shown=other)


def test_script(tmp_path):
    storage.write_csv(tmp_path / "summary.csv", SUMMARY)
    parts = []
    for number, frame in reproduced().groupby("table"):
        parts.append(tmp_path / f"{number}.csv")
        storage.write_csv(parts[-1], frame)
    stated = printed.printed_statements()
    facts = stated.rename(columns={"paper": "value"})[["item", "value"]]
    # What comes from tables and surveys is no fact of its own.
    own = facts["item"].str.match("lasers|indoor|flatness|base|gcp|target")
    storage.write_csv(tmp_path / "facts.csv", facts[~own])
    survey = {
        "scanner": "HDL-64E",
        "pose": {"targets": ["A", "B", "C"]},
        "planes": [
            {"name": name, "flatness_mean_m": 0.001, "flatness_max_m": 0.004}
            for name in ("short_wall", "long_wall", "floor")
        ],
    }
    for number, scanner in enumerate(("HDL-64E", "HDL-32E")):
        storage.write_json(tmp_path / f"{number}.json", survey | {"scanner": scanner})
    surveys = [tmp_path / "0.json", tmp_path / "1.json"]
    accuracy = {
        "item": ["control_points", "targets", "base_field", "base_scanner"],
        "value_mm": [0.89, 0.9, 0.9, 0.9],
        "points": [23, 372, 26, 13],
    }
    storage.write_csv(tmp_path / "accuracy.csv", accuracy)
    facts, output = [tmp_path / "facts.csv"], tmp_path / "agreement.csv"
    main(
        summary=tmp_path / "summary.csv", tables=parts, surveys=surveys,
        accuracy=tmp_path / "accuracy.csv", facts=facts, agreement=output,
    )  # fmt: skip
    lines = output.read_text().splitlines()
    assert lines[0] == "item,paper,reproduced,difference,tolerance,within"
    assert len(lines) == 1 + 3 * len(ROWS) + len(stated)
    assert "text base_targets_64,6.0,3.0,-3.0,0.0,false" in lines
    assert "text flatness_long_max,5.0,4.0,-1.0,0.75,false" in lines
    assert "text gcp_mse,0.89,0.89,0.0,0.1335,true" in lines
    assert all(line.endswith((",true", ",false")) for line in lines[1:])


def test_statements_that_are_tables_in_other_words():
    found = said()
    best = SUMMARY.query(
        "scanner == 'HDL-64E' and data == 'validation' and parameter_set == 'set2'"
    )
    assert found["indoor_after_64"] == pytest.approx(best["rms_cm"].mean())
    assert found["lasers_after_validation_64"] == pytest.approx(best["complies_zero"].mean())


def test_sets_that_round_alike_are_told_apart():
    """The table shows set2, which is best; set1 prints the same numbers and comes before it."""
    summary = SUMMARY.copy()
    of_scanner = (summary["scanner"] == "HDL-64E") & (summary["data"] == "validation")
    first, best = (of_scanner & (summary["parameter_set"] == name) for name in ("set1", "set2"))
    for name in tables.STATISTICS.values():
        summary.loc[best, name] = summary.loc[best, name].round(1)
        summary.loc[first, name] = summary.loc[best, name].to_numpy() + 1e-4
    summary.loc[first, "complies_zero"], summary.loc[best, "complies_zero"] = 7, 41
    found = said(summary)
    assert found["lasers_after_validation_64"] == 41


def test_a_statement_that_is_not_reproduced_is_an_error():
    with pytest.raises(VelocalError, match="statement 'lasers_before_calibration_64'"):
        agreement.of_statements({})
    assert agreement.of_statements({}, partial=True).empty


def test_every_cell_and_statement_has_a_tolerance_of_its_mean():
    of_mean = printed.tolerances_of_mean()
    items = {row.item(quantity) for row in ROWS for quantity in printed.TOLERANCES}
    stated = {printed.PREFIX + item for item in printed.printed_statements()["item"]}
    assert set(of_mean) == items | stated
    rows = printed.printed_statements()
    assert (rows["tolerance_of_mean"] <= rows["tolerance"]).all()
