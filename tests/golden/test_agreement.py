"""What of the paper is reproduced must stay so: the guard that `make results` ends with."""

from pathlib import Path

import pandas as pd
import pytest
import yaml
from support.in_process import Rules
from support.running import copy_project

from velocal.errors import VelocalError
from velocal.paper.agreement import COLUMNS, check, judged
from velocal.paper.printed import PREFIX, TOLERANCES, known_misses, printed_rows, printed_statements

KNOWN = {"b": "a contradiction of the paper"}


def agreement(**reproduced):
    """Agreement of items that are printed as 1 and may be off by 0.5."""
    rows = [judged(item, 1.0, value, 0.5) for item, value in reproduced.items()]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def test_known_misses_are_listed_with_their_reason():
    missed = check(agreement(a=1.2, b=2.0), KNOWN)
    assert missed[["item", "reason"]].to_numpy().tolist() == [["b", KNOWN["b"]]]


def test_a_new_miss_is_an_error_that_names_it():
    with pytest.raises(
        VelocalError, match=r"1 of 2 items.*\n  a: printed 1, reproduced 1.6"
    ) as error:
        check(agreement(a=1.6, b=2.0), KNOWN)
    assert "Hint: " in str(error.value)


def test_a_known_miss_that_is_met_is_an_error():
    with pytest.raises(VelocalError, match="b: is listed as a known miss, but it is not missed"):
        check(agreement(a=1.2, b=1.2), KNOWN)


def test_a_known_miss_that_is_no_item_is_an_error():
    with pytest.raises(VelocalError, match="c: is listed as a known miss"):
        check(agreement(a=1.2, b=2.0), KNOWN | {"c": "?"})


def test_a_known_miss_may_be_one_of_recordings_of_a_length(tmp_path):
    path = tmp_path / "known.csv"
    path.write_text("item,rotations,reason\na,,always\nb,330,near the tolerance\n")
    assert known_misses(path, 330) == {"a": "always", "b": "near the tolerance"}
    assert known_misses(path, 3000) == {"a": "always"}
    assert known_misses(path) == known_misses(path, 330)


def test_every_known_miss_is_an_item_and_has_a_reason():
    items = {row.item(name) for row in printed_rows() for name in TOLERANCES}
    items |= {PREFIX + str(item) for item in printed_statements()["item"]}
    known = known_misses()
    assert known.keys() <= items
    assert all(len(reason) > 20 for reason in known.values())


def test_the_report_is_written_before_the_check_that_may_fail(tmp_path, monkeypatch):
    folder = copy_project(tmp_path / "project")
    monkeypatch.chdir(folder)
    rules = Rules(folder, yaml.safe_load(Path("config/config.yaml").read_text()))
    report, checked = rules.job("write_report"), rules.job("check_agreement")
    assert set(report.output) <= set(checked.input)
    assert not set(checked.output) & set(report.input)
    assert {*report.input} >= {checked.input.agreement, checked.input.known}
