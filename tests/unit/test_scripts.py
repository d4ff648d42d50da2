"""From a job's values to the arguments of a script."""

import gc
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest
from pydantic import BaseModel

from velocal.errors import ConfigError, ScriptError
from velocal.io.scripts import calls, convert, for_each, run


class Limits(BaseModel):
    distance_cm: float


def job(log=(), **parts):
    every = {"input": {}, "output": {}, "params": {}, "wildcards": {}} | parts
    return SimpleNamespace(rule="r", log=list(log), **every)


@pytest.mark.parametrize(
    ("value", "type_", "expected"),
    [
        ("a/b.csv", Path, Path("a/b.csv")),
        ("a/b.csv", Path | None, Path("a/b.csv")),
        ([], Path | None, None),
        (["a", "b"], list[Path], [Path("a"), Path("b")]),
        ("a", list[Path], [Path("a")]),
        ([], list[Path], []),
        ("12", int, 12),
        (3, int, 3),
        (None, int | None, None),
        (0, int | None, 0),
        (2, float, 2.0),
        ("sa1", str, "sa1"),
        (False, bool, False),
        ({}, Mapping[str, Any] | None, {}),
        ({"a": "b"}, dict[str, Path], {"a": Path("b")}),
        (("a", "b"), tuple[str, ...], ("a", "b")),
        ({"distance_cm": 25}, Limits, Limits(distance_cm=25.0)),
        (Limits(distance_cm=1.0), Limits, Limits(distance_cm=1.0)),
        ({"a": {"distance_cm": 1}}, Mapping[str, Limits], {"a": Limits(distance_cm=1.0)}),
        ([1, "x"], Any, [1, "x"]),
        ("equal", Literal["equal", "other"], "equal"),
    ],
)
def test_values_become_what_the_annotation_says(value, type_, expected):
    found = convert(value, type_, "here")
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("value", "type_"),
    [
        (["a", "b"], Path),
        ([], Path),
        (None, Path),
        (1.5, int),
        ("x", int),
        (True, int),
        (1, bool),
        (None, str),
        (3, str),
        (3, list[Path]),
        ("a", Mapping[str, Any]),
        ({"distance": 1}, Limits),
        (1, complex),
        ("third", Literal["equal", "other"]),
        (1, int | str),
    ],
)
def test_what_does_not_fit_is_an_error(value, type_):
    with pytest.raises(ScriptError, match="here: "):
        convert(value, type_, "here")


def main(*, data: Path, table: Path, seed: int) -> None:
    """Of a script."""
    raise ConfigError(f"{data} {table} {seed}")


PARTS = {
    "input": {"data": "in.csv"},
    "output": {"table": "out.csv"},
    "params": {"library": "0123"},
    "wildcards": {"seed": "7", "other": "x"},
}


def test_names_of_all_four_kinds_and_no_digest():
    expected = {"data": Path("in.csv"), "table": Path("out.csv"), "seed": 7}
    assert calls(main, job(**PARTS)) == [expected]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"input": {}}, "rule r: the rule does not give 'data', which main takes"),
        ({"params": {"more": 1}}, "main does not take the param 'more' of the rule"),
        ({"params": {"data": 1}}, "'data' is both input and param of the rule"),
        ({"params": {"seed": 1}}, "'seed' is both param and wildcard of the rule"),
    ],
)
def test_names_that_differ_are_an_error(change, message):
    with pytest.raises(ScriptError, match=message):
        calls(main, job(**(PARTS | change)))


def test_a_positional_argument_is_an_error():
    def positional(data: Path, *, table: Path, seed: int) -> None: ...

    with pytest.raises(ScriptError, match="main takes 'data' by position"):
        calls(positional, job(**PARTS))


def test_an_error_is_one_message_in_the_log(tmp_path, capsys):
    log = tmp_path / "log"
    with pytest.raises(SystemExit) as stopped:
        run(main, job(log=[str(log)], **PARTS))
    assert stopped.value.code == 1
    assert log.read_text() == "Error: in.csv out.csv 7\n" == capsys.readouterr().err


@for_each("data", "table", "seed")
def each(*, data: Path | None, more: list[Path], table: Path, seed: int, name: str) -> None:
    """Of a script that is called for each of several tables."""


LISTS = {
    "input": {"data": ["a.csv"], "more": "all.csv"},
    "output": {"table": ["1.csv", "2.csv"]},
    "params": {"library": "0123", "seed": [7, 8], "taken": {"data": [[], [0]]}, "name": "x"},
}


def test_one_call_for_each_value():
    expected = [
        {"data": data, "more": [Path("all.csv")], "table": Path(table), "seed": seed, "name": "x"}
        for data, table, seed in ((None, "1.csv", 7), (Path("a.csv"), "2.csv", 8))
    ]
    assert calls(each, job(**LISTS)) == expected


def test_several_files_of_one_input():
    @for_each("more", "table")
    def several(*, more: list[Path], table: Path) -> None: ...

    given = job(
        input={"more": ["a", "b", "c"]},
        output={"table": ["1", "2", "3"]},
        params={"taken": {"more": [[0], [1, 2], [2, 0]]}},
    )
    assert [call["more"] for call in calls(several, given)] == [
        [Path("a")],
        [Path("b"), Path("c")],
        [Path("c"), Path("a")],
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"output": {"table": "1.csv"}}, "lists of different lengths: .*'table': 1"),
        (
            {"input": {"data": ["a", "b"], "more": []}},
            r"2 files of 'data', but those taken are \[0\]",
        ),
        ({"params": LISTS["params"] | {"seed": 7}}, "7 does not fit .allowed: a list"),
        ({"params": LISTS["params"] | {"seed": [7, "x"]}}, "'x' does not fit .allowed: int"),
    ],
)
def test_lists_that_do_not_fit_are_an_error(change, message):
    with pytest.raises(ScriptError, match=message):
        calls(each, job(**(LISTS | change)))


def test_for_each_names_arguments():
    @for_each("other")
    def wrong(*, data: Path, table: Path, seed: int) -> None: ...

    with pytest.raises(ScriptError, match="for_each names 'other', which main does not take"):
        calls(wrong, job(**PARTS))


def test_an_error_of_one_call_says_of_which(capsys):
    @for_each("table", "seed")
    def failing(*, table: Path, seed: int) -> None:
        if seed == 8:
            raise ConfigError("it has no rows")

    given = {"output": {"table": ["1.csv", "2.csv"]}, "params": {"seed": [7, 8]}}
    with pytest.raises(SystemExit):
        run(failing, job(**given))
    assert capsys.readouterr().err == "Error: 2.csv: it has no rows\n"


def test_what_is_imported_is_not_visited_again():
    """The collector of garbage would visit pandas and matplotlib again and again."""
    frozen = []

    def main() -> None:
        frozen.append(gc.get_freeze_count())

    gc.unfreeze()
    run(main, job())
    gc.unfreeze()
    assert frozen[0] > 1000
