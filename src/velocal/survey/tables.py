"""CSV files of a survey: named columns, and numbers with their standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.io.written_tables import number, read_written_table

#: Coordinates, angles and lengths of a survey are not larger, in the unit of their column: the
#: northings of a UTM grid have 1e7 m.
LARGEST = 1e8
#: Standard deviations, in the unit of their column.
SMALLEST_STD, LARGEST_STD = 1e-6, 1e6


@dataclass(frozen=True)
class Table:
    """Rows of a CSV file of a survey.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (n,)
        By name: texts as objects, or numbers, NaN where a value is missing.
    lines : sequence of int
        Line of the file in which every row stands.
    """

    columns: Mapping[str, NDArray[Any]]
    lines: Sequence[int]

    def text(self, name: str) -> tuple[str, ...]:
        """Return a column of text."""
        return tuple(self.columns[name])

    def numbers(self, names: Sequence[str]) -> Array:
        """Return columns of numbers side by side, shape (n, len(names))."""
        return np.column_stack([self.columns[name] for name in names])

    def take(self, rows: NDArray[np.bool_]) -> Table:
        """Return some of the rows."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return Table(columns, [line for line, kept in zip(self.lines, rows, strict=True) if kept])


def read_table(
    path: Path,
    names: Sequence[str],
    numbers: Sequence[str],
    positive: Mapping[str, str],
    *,
    gaps: bool = False,
    may_be_empty: Sequence[str] = (),
) -> Table:
    """Read a CSV file of a survey, and check it.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Columns of text.
    numbers : sequence of str
        Columns of numbers; the file must have these columns and `names`, in any order.
    positive : mapping of str to str
        By column of values: the column (of standard deviations) that must be positive wherever
        there is a value.
    gaps : bool
        Whether values may be missing.
    may_be_empty : sequence of str
        Columns of text whose entries may be empty.

    Returns
    -------
    Table

    Raises
    ------
    SurveyError
        If the file is missing, a column is missing or unknown, a name is empty, a value is missing,
        no number or larger than `LARGEST`, or a standard deviation is missing, not positive or
        beyond `SMALLEST_STD` and `LARGEST_STD`.
    """
    written = read_written_table(path, [*names, *numbers], SurveyError)
    columns: dict[str, NDArray[Any]] = {
        name: np.array(written.columns[name], dtype=object) for name in names
    }

    def check(good: NDArray[np.bool_], what: str, allowed: str | None, hint: str | None) -> None:
        if not good.all():
            row = int(np.argmin(good))
            raise SurveyError(
                what.format(text[row]), where=written.where(row), allowed=allowed, hint=hint
            )

    text: list[str] = []
    for column in names:
        text = written.columns[column]
        if column not in may_be_empty:
            there = np.array([bool(value) for value in text], dtype=bool)
            check(there, f"{column} is empty", "a name", "Every row needs all names.")
    comma = written.decimal_comma(numbers)
    for column in numbers:
        text = written.columns[column]
        values = [number(value, comma) for value in text]
        known = np.array(
            [value is not None or not t for value, t in zip(values, text, strict=True)]
        )
        found = np.array([np.nan if value is None else value for value in values], dtype=float)
        hint = (
            "Commas and points stand before decimals in this table: write points only."
            if any("," in value for value in text)
            else None
        )
        check(known, f"{column} is no number: {{!r}}", "a decimal number, as -1.234", hint)
        low, high = (
            (SMALLEST_STD, LARGEST_STD) if column in positive.values() else (-LARGEST, LARGEST)
        )
        inside = np.isnan(found) | (found >= low) & (found <= high)
        if column in positive.values():
            check(
                np.isnan(found) | (found > 0.0),
                f"{column} is not positive: {{!r}}",
                f"{low:g} to {high:g}",
                "State the accuracy of each value.",
            )
        check(
            inside,
            f"{column} is {{!r}}",
            f"{low:g} to {high:g}",
            "The unit is part of the name of the column.",
        )
        columns[column] = found
    for value, deviation in positive.items():
        there = ~np.isnan(columns[value])
        text = written.columns[value]
        if not gaps:
            check(there, f"{value} is missing", "a number", None)
        check(
            ~there | ~np.isnan(columns[deviation]),
            f"{deviation} is missing",
            f"{SMALLEST_STD:g} to {LARGEST_STD:g}",
            "State the accuracy of each value.",
        )
    return Table(columns, written.lines)


def check_unique(table: Table, columns: Sequence[str], what: str, where: str) -> None:
    """Check that no row has the names of an earlier row.

    Parameters
    ----------
    table : Table
        As `read_table` gives it.
    columns : sequence of str
        Columns of the names, with the name for the message first.
    what : str
        Kind of the rows, for the message.
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If a row does.
    """
    first: dict[tuple[str, ...], int] = {}
    for names, line in zip(zip(*map(table.text, columns), strict=True), table.lines, strict=True):
        if names in first:
            raise SurveyError(
                f"{what} {names[0]!r} occurs twice",
                where=f"{where}, row {line}",
                hint=f"Row {first[names]} has the same name: delete one, or rename it.",
            )
        first[names] = line
