"""Tables that people write: CSV of a survey and sample tables, read strictly.

Spreadsheets write them in several ways. What can mean one thing only is read: commas, semicolons
or tabs between the columns, decimal commas, a byte order mark, quotes. All else is an error that
names the line of the file and says how to save the table.
"""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from velocal.errors import VelocalError, hidden

#: A table that people write is small.
LARGEST_BYTES = 50_000_000
#: Characters that may stand between columns, and their names.
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_SAVE = "In a spreadsheet choose File, Save as, CSV UTF-8."
#: First bytes of files that are no text, and what they are.
_NO_TEXT = {
    b"PK\x03\x04": "a spreadsheet (.xlsx or .ods)",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet (.xls)",
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
}
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class WrittenTable:
    """A table as it stands in a file.

    Attributes
    ----------
    path : Path
    separator : str
        Character between the columns.
    lines : tuple of int
        Line of the file of every row, counted from 1 with comments and the header.
    columns : dict of str to list of str
        Values of every column, without spaces around them.
    """

    path: Path
    separator: str
    lines: tuple[int, ...]
    columns: dict[str, list[str]]

    def where(self, row: int) -> str:
        """Name a row in errors: the file, and the line of the file."""
        return f"{self.path}, row {self.lines[row]}"

    def decimal_comma(self, names: Sequence[str]) -> bool:
        """Whether the numbers of some columns have a comma before their decimals.

        It is so if commas do not separate the columns, and no number there has a point.
        """
        values = [value for name in names for value in self.columns[name]]
        commas = any("," in value for value in values)
        return self.separator != "," and commas and not any("." in value for value in values)


def number(text: str, decimal_comma: bool = False) -> float | None:
    """Read a decimal number.

    Parameters
    ----------
    text : str
    decimal_comma : bool
        Whether a comma stands before the decimals.

    Returns
    -------
    float or None
        None for anything else; infinite for a number that is too large for a float.
    """
    written = text.replace(",", ".") if decimal_comma and text.count(",") == 1 else text
    return float(written) if _NUMBER.fullmatch(written) else None


def read_written_table(
    path: Path,
    required: Sequence[str],
    error: type[VelocalError],
    *,
    optional: Sequence[str] | None = (),
    separator: str = ",",
) -> WrittenTable:
    """Read a table with one line of headings; `#` outside of quotes begins a comment.

    Parameters
    ----------
    path : Path
    required, optional : sequence of str
        Headings, in any order; None as `optional` allows any others.
    error : type of VelocalError
        Class of the errors.
    separator : str
        What the documentation asks for between the columns; `SEPARATORS` are read too.

    Returns
    -------
    WrittenTable

    Raises
    ------
    VelocalError
        Of the class `error`: if the file is missing or no UTF-8 text, a heading is missing,
        unknown or doubled, or a row has more or fewer values than there are headings.
    """
    known = tuple(dict.fromkeys((*required, *(optional or ()))))
    lines = _lines(path, error, SEPARATORS[separator])
    if not lines:
        raise error(
            "the table is empty",
            where=str(path),
            allowed=f"a line of headings: {', '.join(known)}",
        )
    found = _separator(lines[0][1], separator)
    head_line, headings = lines[0][0], _cells(path, lines[0], found, error)
    while headings and not headings[-1]:
        headings.pop()
    head = f"{path}, row {head_line}"
    _check_headings(headings, required, None if optional is None else known, head, error, separator)
    numbers: list[int] = []
    columns: dict[str, list[str]] = {name: [] for name in headings}
    for line in lines[1:]:
        values = _cells(path, line, found, error)
        if not any(values):
            continue
        while len(values) > len(headings) and not values[-1]:
            values.pop()
        if len(values) != len(headings):
            comma = found == "," and len(values) > len(headings)
            raise error(
                f"the row has {len(values)} values",
                where=f"{path}, row {line[0]}",
                allowed=f"{len(headings)}, as the line of headings",
                hint="Do its numbers have decimal commas? Write points, or separate the columns by "
                "semicolons."
                if comma
                else "A comment begins with #; a value that holds one needs quotes.",
            )
        numbers.append(line[0])
        for name, value in zip(headings, values, strict=True):
            columns[name].append(value)
    return WrittenTable(path, found, tuple(numbers), columns)


def _lines(path: Path, error: type[VelocalError], separators: str) -> list[tuple[int, str]]:
    """Lines that hold something, without comments, and their numbers."""
    where = str(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) else str(fault)
        raise error(f"cannot be read: {reason}", where=where) from None
    if len(data) > LARGEST_BYTES:
        raise error(
            "the file is too large for a table",
            where=where,
            allowed=f"up to {LARGEST_BYTES // 10**6} MB",
            hint="Is this the path of a recording?",
        )
    for start, what in _NO_TEXT.items():
        if data.startswith(start):
            raise error(
                f"is {what}", where=where, allowed=f"UTF-8 text with {separators}", hint=_SAVE
            )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise error(
            f"the byte 0x{data[fault.start]:02x} is not UTF-8 text",
            where=f"{where}, row {line}",
            hint=_SAVE,
        ) from None
    found = []
    for number_, raw in enumerate(re.split(r"\r\n|\n|\r", text), start=1):
        if not raw.isprintable() and (code := hidden(raw.replace("\t", ""))):
            raise error(
                f"the line holds {code}, a character that cannot be seen",
                where=f"{where}, row {number_}",
                hint="Delete it, or save the table anew. " + _SAVE,
            )
        line_ = _uncommented(raw)
        if line_.strip():
            found.append((number_, line_))
    return found


def _uncommented(line: str) -> str:
    """Cut a line at a `#` that does not stand between quotes."""
    quoted = False
    for at, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == "#" and not quoted:
            return line[:at]
    return line


def _separator(headings: str, wanted: str) -> str:
    """Find the character between headings: no heading of ours holds one of `SEPARATORS`."""
    return max((wanted, *SEPARATORS), key=headings.count)


def _cells(
    path: Path, line: tuple[int, str], separator: str, error: type[VelocalError]
) -> list[str]:
    if line[1].count('"') % 2:
        raise error(
            "a quote is not closed",
            where=f"{path}, row {line[0]}",
            hint="A value between quotes ends in the line in which it begins.",
        )
    cells = next(csv.reader([line[1]], delimiter=separator, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def _check_headings(
    headings: Sequence[str],
    required: Sequence[str],
    known: Sequence[str] | None,
    where: str,
    error: type[VelocalError],
    separator: str,
) -> None:
    """Check the line of headings; any others than the required ones are allowed if `known` is None.

    Raises
    ------
    VelocalError
        Of the class `error`.
    """
    allowed = ", ".join(known or required)
    missing = [name for name in required if name not in headings]
    odd = [name for name in headings if known is not None and name not in known]
    if missing or odd:
        what = f"missing column {missing[0]!r}" if missing else f"unknown column {odd[0]!r}"
        others = odd or headings
        hint = f"The table has: {', '.join(headings)}."
        if len(headings) == 1:
            hint = f"Separate the columns by {SEPARATORS[separator]}."
        elif like := difflib.get_close_matches(others[0], missing or known or (), n=1):
            hint = f"The table has {others[0]!r}. Did you mean {like[0]!r}?"
        raise error(what, where=where, allowed=allowed, hint=hint)
    for name in headings:
        if headings.count(name) > 1:
            raise error(f"the column {name!r} occurs twice", where=where, allowed=allowed)
