"""CSV files of a survey: named columns, and numbers with their standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from velocal.errors import SurveyError


def read_table(
    path: Path,
    names: Sequence[str],
    numbers: Sequence[str],
    positive: Mapping[str, str],
    *,
    gaps: bool = False,
) -> pd.DataFrame:
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

    Raises
    ------
    SurveyError
        If the file is missing, a column is missing or unknown, a value is missing or no number, or
        a standard deviation is missing or not positive.
    """
    where, columns = str(path), [*names, *numbers]
    try:
        table = pd.read_csv(path, comment="#", dtype=str, keep_default_na=False)
    except (OSError, ValueError) as error:
        raise SurveyError(f"cannot be read: {error}", where=where) from None
    if not isinstance(table.index, pd.RangeIndex):  # pandas takes the first values as an index
        raise SurveyError("cannot be read: rows have more values than the header", where=where)
    if set(table.columns) != set(columns):
        odd = sorted(set(table.columns) ^ set(columns))
        raise SurveyError(
            f"missing or unknown column {odd[0]!r}", where=where, allowed=", ".join(columns)
        )

    def check(good: np.ndarray, what: str, hint: str | None = None) -> None:
        if not good.all():
            row = int(np.argmin(good))
            raise SurveyError(what.format(text[row]), where=f"{where}, row {row + 2}", hint=hint)

    for column in numbers:
        text = table[column].str.strip()
        table[column] = pd.to_numeric(text.where(text != ""), errors="coerce").astype(float)
        there = np.isfinite(table[column].to_numpy())
        check(there | (text == "").to_numpy(), f"{column} is no number: {{!r}}")
    for value, deviation in positive.items():
        there = np.isfinite(table[value].to_numpy())
        if not gaps:
            check(there, f"{value} is missing")
        check(
            ~there | (table[deviation].to_numpy() > 0.0),
            f"{deviation} is missing or not positive",
            "State the accuracy of each value.",
        )
    return table


def check_unique(table: pd.DataFrame, columns: Sequence[str], what: str, where: str) -> None:
    """Check that no row has the names of an earlier row.

    Parameters
    ----------
    table : DataFrame
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
    twice = table.duplicated(list(columns)).to_numpy()
    if twice.any():
        row = int(np.argmax(twice))
        raise SurveyError(
            f"{what} {table[columns[0]][row]!r} occurs twice", where=f"{where}, row {row + 2}"
        )
