"""Our own CSV: one row per laser, in metres and radians, with standard deviations if known."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from velocal.calibration.files import document as lasers
from velocal.calibration.files.document import OWN_KEYS, CalibrationFile, Document
from velocal.errors import CalibrationFileError
from velocal.io import storage
from velocal.scanner.parameters import UNITS

#: Columns of the standard deviations.
STD_COLUMNS = {name: f"{name}_std_{unit}" for name, unit in UNITS.items()}
LASER_ID = "laser_id"


def parse(path: Path) -> Document:
    """Parse the file; standard deviations are skipped.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Document
        As the file is, right or wrong.

    Raises
    ------
    CalibrationFileError
        If the file cannot be read, or is not of this format.
    """
    try:
        # Spreadsheets put a byte order mark before the text.
        text = lasers.content(path).decode("utf-8-sig")
        header, *records = [*csv.reader(text.splitlines(), strict=True)] or [[]]
    except (ValueError, csv.Error) as error:
        raise CalibrationFileError(f"is not CSV: {error}", where=str(path)) from None
    _check_header(path, header)
    found = []
    for index, record in enumerate(records, start=2):
        if not record:
            continue  # an empty line
        place = f"row {index}"
        if len(record) != len(header):
            raise CalibrationFileError(
                f"has {len(record)} fields",
                where=f"{path}, {place}",
                allowed=f"{len(header)}, as the header",
            )
        found.append((place, dict[str, object](zip(header, record, strict=True))))
    return Document(path, OWN_KEYS, LASER_ID, found, dialect="paper")


def _check_header(path: Path, header: list[str]) -> None:
    required = [LASER_ID, *(OWN_KEYS[name][0] for name in UNITS)]
    allowed = [LASER_ID, *(column for column, _ in OWN_KEYS.values()), *STD_COLUMNS.values()]
    faults = {
        "missing": [column for column in required if column not in header],
        "unknown": [column for column in header if column not in allowed],
        "doubled": sorted({column for column in header if header.count(column) > 1}),
    }
    for fault, columns in faults.items():
        if columns:
            raise CalibrationFileError(
                f"columns {fault}: {', '.join(columns)}",
                where=str(path),
                allowed=", ".join(allowed),
            )


def write(path: Path, found: CalibrationFile) -> None:
    """Write the parameters, with the standard deviations of those that have any.

    Parameters
    ----------
    path : Path
    found : CalibrationFile
        Of dialect ``paper``; standard deviations are NaN where unknown.

    Raises
    ------
    CalibrationFileError
        If a parameter is not finite, or `std` names something else than a parameter.
    """
    parameters, std = found.parameters, found.std
    unknown = set(std) - set(STD_COLUMNS)
    if unknown:
        raise CalibrationFileError(
            f"standard deviations of {', '.join(sorted(unknown))}",
            where=str(path),
            allowed=", ".join(STD_COLUMNS),
        )
    rows = lasers.rows(path, parameters)
    table: dict[str, Any] = {LASER_ID: list(range(len(rows)))}
    table |= {OWN_KEYS[name][0]: [row[name] for row in rows] for name in UNITS}
    table |= {column: std[name] for name, column in STD_COLUMNS.items() if name in std}
    carried = [name for name in lasers.CARRIED if rows and name in rows[0]]
    table |= {OWN_KEYS[name][0]: [row[name] for row in rows] for name in carried}
    storage.write_csv(path, table)
