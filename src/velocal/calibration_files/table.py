"""Our own CSV: one row per laser, in metres and radians, with standard deviations if known."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import pandas as pd

from velocal import storage
from velocal.calibration_files import lasers
from velocal.calibration_files.decimals import UNCHANGED
from velocal.errors import CalibrationFileError
from velocal.parameters import UNITS, Array, ParameterSet

#: Columns of the values, unit at the end of the name.
COLUMNS: lasers.Keys = {
    name: (f"{name}_{unit}" if unit else name, UNCHANGED)
    for name, unit in {**UNITS, **lasers.CARRIED}.items()
}
#: Columns of the standard deviations.
STD_COLUMNS = {name: f"{name}_std_{unit}" for name, unit in UNITS.items()}
LASER_ID = "laser_id"


def read(path: Path, n_lasers: int | None = None) -> ParameterSet:
    """Read a calibration; standard deviations are skipped.

    Parameters
    ----------
    path : Path
    n_lasers : int, optional
        Number of lasers of the scanner; if None, as many as the file has.

    Raises
    ------
    CalibrationFileError
        If columns are missing or unknown, a value is not a finite number, or the lasers are not
        those of the scanner.
    """
    return lasers.parameter_set(path, _lasers(path), n_lasers, angle_hint=lasers.DEGREES_HINT)


def _lasers(path: Path) -> Iterator[tuple[int, dict[str, float]]]:
    try:
        # Spreadsheets put a byte order mark before the text.
        text = lasers.content(path).decode("utf-8-sig")
        header, *records = [*csv.reader(text.splitlines(), strict=True)] or [[]]
    except (ValueError, csv.Error) as error:
        raise CalibrationFileError(f"is not CSV: {error}", where=str(path)) from None
    _check_header(path, header)
    for index, record in enumerate(records, start=2):
        if not record:
            continue  # an empty line
        where = f"{path}, row {index}"
        if len(record) != len(header):
            raise CalibrationFileError(
                f"has {len(record)} fields", where=where, allowed=f"{len(header)}, as the header"
            )
        found = dict(zip(header, record, strict=True))
        yield (
            lasers.laser_id(found[LASER_ID], LASER_ID, where),
            lasers.values(found, COLUMNS, where),
        )


def _check_header(path: Path, header: list[str]) -> None:
    required = [LASER_ID, *(COLUMNS[name][0] for name in UNITS)]
    allowed = [LASER_ID, *(column for column, _ in COLUMNS.values()), *STD_COLUMNS.values()]
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


def write(path: Path, parameters: ParameterSet, std: Mapping[str, Array] | None = None) -> None:
    """Write a calibration; `read` gives back the same floats.

    Parameters
    ----------
    path : Path
    parameters : ParameterSet
    std : mapping of str to ndarray, shape (n,), optional
        Standard deviations by parameter, in the parameter's unit; NaN where unknown.

    Raises
    ------
    CalibrationFileError
        If a parameter is not finite, or `std` names something else than a parameter.
    """
    unknown = set(std or {}) - set(STD_COLUMNS)
    if unknown:
        raise CalibrationFileError(
            f"standard deviations of {', '.join(sorted(unknown))}",
            where=str(path),
            allowed=", ".join(STD_COLUMNS),
        )
    values = pd.DataFrame(lasers.rows(path, parameters))
    table = values[list(UNITS)].rename(columns=lambda name: COLUMNS[name][0])
    table.insert(0, LASER_ID, range(len(parameters)))
    for name, column in STD_COLUMNS.items():
        if std and name in std:
            table[column] = std[name]
    for name in lasers.CARRIED:
        if name in values:
            table[COLUMNS[name][0]] = values[name]
    storage.write_csv(path, table)
