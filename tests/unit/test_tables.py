"""Tables of windows before and after, and the choice of the best parameter set."""

import csv
import io

import pandas as pd
import pytest
from make_table import main
from support.results import STD_CM, TABLES, statistics

from velocal.errors import ConfigError, VelocalError
from velocal.evaluation.candidates import Role
from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.paper import printed as printed_numbers
from velocal.paper import tables
from velocal.paper.best_set import shown_after

LASERS, SUMMARY = statistics()
SET2 = SUMMARY["parameter_set"] == "set2"


def build(number="4", summary=SUMMARY, *, simulated=True, **changes):
    return tables.build(
        number, TABLES[number].model_copy(update=changes), summary, simulated=simulated
    )


def best_set(summary, scanner, samples):
    shown = shown_after(summary, scanner, samples, "validation", "tables")
    assert shown.role is Role.SET
    return shown.parameter_set


def test_best_set_has_the_least_mean():
    assert best_set(SUMMARY, "HDL-64E", ["sa1", "sa2"]) == "set2"
    means = shown_after(SUMMARY, "HDL-64E", ["sa1", "sa2"], "validation", "tables").means_cm
    assert list(means) == ["set1", "set2", "set3"]
    assert means == pytest.approx({name: STD_CM[name] for name in means}, rel=0.05)


def test_medians_are_shown_with_the_adjustment_of_their_window():
    shown = shown_after(SUMMARY, "HDL-64E", ["sa3"], "calibration", "tables")
    assert (shown.role, shown.parameter_set) == (Role.WINDOW, "")


def test_a_table_says_that_rotations_are_of_the_window_itself():
    note = "from which its medians were made as well: "
    assert not any(note in each for each in build("4").notes)
    own = (SUMMARY["sample"] == "sa3") & (SUMMARY["window"] != "end")
    summary = SUMMARY.assign(rotations_from=SUMMARY["rotations_from"].where(~own, "window"))
    said = [each for each in build("4", summary).notes if note in each]
    assert len(said) == 1
    assert said[0].endswith("well: sa3 beginning, sa3 middle.")
    # Medians are always of the window.
    assert build("2", summary).notes == build("2").notes


def test_best_set_depends_on_the_samples_asked_for():
    summary = SUMMARY.copy()
    own = (summary["sample"] == "sa4") & (summary["parameter_set"] == "set3")
    summary.loc[own, "rms_cm"] = 0.1
    assert best_set(summary, "HDL-64E", ["sa4"]) == "set3"
    assert best_set(summary, "HDL-64E", ["sa1"]) == "set2"


def test_first_of_equal_sets():
    assert best_set(SUMMARY.assign(rms_cm=0.0), "HDL-64E", ["sa1"]) == "set1"


def test_a_set_without_residuals_is_never_the_best():
    summary = SUMMARY.copy()
    summary.loc[SET2, "rms_cm"] = float("nan")
    assert best_set(summary, "HDL-64E", ["sa1"]) == "set3"
    with pytest.raises(VelocalError, match="without residuals"):
        best_set(SUMMARY.assign(rms_cm=float("nan")), "HDL-64E", ["sa1"])


def test_sets_must_share_their_windows():
    summary = SUMMARY.drop(SUMMARY.index[SUMMARY["parameter_set"] == "set3"][0])
    with pytest.raises(VelocalError, match="rows per parameter set"):
        best_set(summary, "HDL-64E", ["sa1"])
    with pytest.raises(VelocalError, match="no parameter set"):
        best_set(SUMMARY, "VLP-16", ["sa1"])


def test_rows_before_then_after_by_sample_and_window():
    frame = build().frame
    assert list(frame) == list(tables.COLUMNS)
    keys = frame[["calibration", "sample", "window"]].to_numpy().tolist()
    assert keys == [
        [calibration, sample, window]
        for calibration in ("before", "after")
        for sample in ("sa1", "sa2", "sa3", "sa4")
        for window in ("beginning", "middle", "end")
    ]
    assert set(frame["table"]) == {"IV"}


@pytest.mark.parametrize(
    ("number", "after"),
    [("2", ("window", "")), ("4", ("set", "set2")), ("5", ("set", "set1"))],
)
def test_numbers_are_those_of_the_summary(number, after):
    table = build(number)
    keys = ["scanner", "sample", "window", "role", "parameter_set"]
    of_data = SUMMARY[SUMMARY["data"] == TABLES[number].data].set_index(keys)
    for row in table.frame.to_dict(orient="records"):
        shown = ("factory", "") if row["calibration"] == "before" else after
        assert (row["role"], row["parameter_set"]) == shown
        same = of_data.loc[(row["scanner"], row["sample"], row["window"], *shown)]
        assert row["std_cm"] == same["rms_cm"]
        for name in ("within_1sigma_pct", "within_3sigma_pct"):
            assert row[name] == same[name]
    assert any((after[1] or "adjusted") in note for note in table.notes)


def test_notes_name_the_set_and_how_it_was_chosen():
    note = build("4").notes[0]
    assert "set2" in note
    assert "chosen on the validation data" in note
    assert "the only one" in build("5").notes[0]


def test_only_simulated_studies_say_so():
    for number in TABLES:
        for write in (tables.to_markdown, tables.to_latex):
            assert "simulated" in write(build(number))
            assert "imulated" not in write(build(number, simulated=False))


def test_markdown_and_latex_hold_every_number():
    table = build("3")
    for text in (tables.to_markdown(table), tables.to_latex(table)):
        for row in tables.formatted(table.frame)[list(tables.DECIMALS)].to_numpy().tolist():
            assert all(cell in text for cell in row)
    latex = tables.to_latex(build("3", samples=["sa5"], scanner="HDL-32E"))
    assert r"\toprule" in latex
    assert latex.count(r"\midrule") == 2


def test_a_study_of_ones_own_does_not_number_its_tables_as_the_paper():
    table = build("3")
    assert tables.to_markdown(table).startswith(f"**Table III.** {table.caption}")
    assert tables.to_markdown(table, numbered=False).startswith(table.caption)


def test_special_characters_in_names():
    summary = SUMMARY.replace({"sample": {"sa5": "hall_1|b"}})
    table = build("3", summary, samples=["hall_1|b"])
    assert r"hall_1\|b |" in tables.to_markdown(table)
    assert r"hall\_1|b &" in tables.to_latex(table)


def test_names_that_look_like_numbers_or_like_nothing(tmp_path):
    """A sample 1 and a set 02, a set that is called NA."""
    names = {"set1": "1", "set2": "02", "set3": "NA"}
    summary = SUMMARY.assign(sample=SUMMARY["sample"].str[2:]).replace({"parameter_set": names})
    storage.write_csv(tmp_path / "summary.csv", summary)
    read = pd.DataFrame(storage.read_csv(tmp_path / "summary.csv", text=KEYS))
    assert best_set(read, "HDL-64E", ["1"]) == "02"
    frame = build("4", read, samples=["1", "2"]).frame
    assert set(frame["sample"]) == {"1", "2"}
    assert set(frame["parameter_set"]) == {"", "02"}
    read.loc[read["parameter_set"] == "NA", "rms_cm"] = 0.1
    assert best_set(read, "HDL-64E", ["1"]) == "NA"


@pytest.mark.parametrize("name", ["before", "after", "factory", "window", "adjusted"])
def test_a_set_may_have_the_name_of_a_role(name):
    summary = SUMMARY.replace({"parameter_set": {"set2": name}})
    frame, same = build("4", summary).frame, build("4").frame
    assert set(frame["parameter_set"]) == {"", name}
    assert frame.drop(columns="parameter_set").equals(same.drop(columns="parameter_set"))


def test_a_table_begins_with_the_columns_of_the_paper():
    printed = pd.read_csv(printed_numbers.TABLES)
    assert list(build().frame)[: len(printed.columns)] == list(printed)


def test_errors_name_what_is_missing():
    with pytest.raises(ConfigError, match=r"no table '9'.*2, 3, 4, 5"):
        tables.build("9", TABLES["2"], SUMMARY, simulated=False)
    with pytest.raises(VelocalError, match=r"tables\.2.*sample 'sa9'.*sa1, sa2, sa3, sa4"):
        build("2", samples=["sa9"])


def test_script_writes_rounded_csv(tmp_path):
    storage.write_csv(tmp_path / "summary.csv", SUMMARY)
    paths = {suffix: tmp_path / f"table.{suffix}" for suffix in ("csv", "md", "tex")}
    arguments = {"table": "2", "selection": TABLES["2"], "simulated": True, "of_paper": True}
    main(summary=tmp_path / "summary.csv", **paths, **arguments)
    rows = list(csv.DictReader(io.StringIO(paths["csv"].read_text())))
    assert len(rows) == 12
    assert list(rows[0]) == list(tables.COLUMNS)
    for row in rows:
        assert len(row["std_cm"].split(".")[1]) == 2
        assert len(row["within_1sigma_pct"].split(".")[1]) == 1
    first = [path.read_bytes() for path in paths.values()]
    main(summary=tmp_path / "summary.csv", **paths, **arguments)
    assert [path.read_bytes() for path in paths.values()] == first
