"""One door to all formats: the suffix of the file's name tells which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from velocal.calibration_files import db_xml, ros_yaml, table
from velocal.errors import CalibrationFileError
from velocal.parameters import ParameterSet, nominal
from velocal.sensors import Scanner


class Format(NamedTuple):
    """Reader and writer of one format."""

    read: Callable[[Path, int], ParameterSet]
    write: Callable[[Path, ParameterSet], None]


FORMATS = {
    ".xml": Format(db_xml.read, db_xml.write),
    ".yaml": Format(ros_yaml.read, ros_yaml.write),
    ".yml": Format(ros_yaml.read, ros_yaml.write),
    ".csv": Format(table.read, table.write),
}


def _format(path: Path) -> Format:
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise CalibrationFileError(
            f"unknown suffix {path.suffix!r}", where=str(path), allowed=", ".join(FORMATS)
        ) from None


def read(path: Path, n_lasers: int) -> ParameterSet:
    """Read a calibration file of any known format.

    Parameters
    ----------
    path : Path
    n_lasers : int
        Number of lasers of the scanner.

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, the file damaged, or not of a scanner with so many lasers.
    """
    return _format(path).read(path, n_lasers)


def write(path: Path, parameters: ParameterSet) -> None:
    """Write a calibration file in the format that the suffix names.

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, or a value is not finite.
    """
    _format(path).write(path, parameters)


def read_or_nominal(path: Path | None, scanner: Scanner) -> ParameterSet:
    """Read a calibration file, or take the nominal values of the scanner where there is none."""
    return nominal(scanner) if path is None else read(path, scanner.n_lasers)
