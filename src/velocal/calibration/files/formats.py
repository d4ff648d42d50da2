"""One door to all formats: the suffix of the file's name tells which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from velocal.calibration.convert import convert
from velocal.calibration.dialects import MANUAL, PAPER, Dialect, dialect_named
from velocal.calibration.files import db_xml, ros_yaml
from velocal.calibration.files import document as lasers
from velocal.calibration.files import velocal_csv as table
from velocal.calibration.files import velocal_json as complete
from velocal.calibration.files.document import Calibration, Document
from velocal.errors import CalibrationFileError
from velocal.scanner.models import DISTANCE_TICK_M, Scanner
from velocal.scanner.parameters import LaserParameters, nominal


def _write_table(path: Path, found: Calibration) -> None:
    table.write(path, found.parameters, found.std)


class Format(NamedTuple):
    """Reader and writer of one format.

    `default` is the dialect that files are written for unless another is asked for; None where
    the numbers stay as they are.
    """

    parse: Callable[[Path], Document]
    write: Callable[[Path, Calibration], None]
    default: str | None


FORMATS = {
    ".xml": Format(db_xml.parse, db_xml.write, "veloview"),
    ".yaml": Format(ros_yaml.parse, ros_yaml.write, "ros"),
    ".yml": Format(ros_yaml.parse, ros_yaml.write, "ros"),
    ".csv": Format(table.parse, _write_table, "paper"),
    ".json": Format(complete.parse, complete.write, None),
}


def format_of(path: Path) -> Format:
    """Format that the suffix of a file names.

    Raises
    ------
    CalibrationFileError
        If it names none.
    """
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise CalibrationFileError(
            f"unknown suffix {path.suffix!r}",
            where=str(path),
            allowed=", ".join(FORMATS),
            hint="XML is Velodyne's, YAML that of ROS, CSV and JSON are our own.",
        ) from None


def read_calibration(path: Path, n_lasers: int | None = None) -> Calibration:
    """Read a calibration file of any format as it is, with all that it holds.

    Parameters
    ----------
    path : Path
    n_lasers : int, optional
        Number of lasers of the scanner; if None, as many as the file has.

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, the file damaged, or not of a scanner with so many lasers.
    """
    form = format_of(path)
    if form.parse is complete.parse:
        return complete.read(path, n_lasers)
    return lasers.calibration(form.parse(path), n_lasers)


def dialect_of(found: Calibration, path: Path) -> Dialect:
    """Dialect of the numbers of a file: what it says, or else the manufacturer's.

    Files of others do not say. Their numbers are the factory's, unit for unit, whichever driver
    they were made for.

    Raises
    ------
    ConfigError
        If it states a dialect that is not known.
    """
    return MANUAL if found.dialect is None else dialect_named(found.dialect, where=str(path))


def read(path: Path, n_lasers: int, tick_m: float = DISTANCE_TICK_M) -> LaserParameters:
    """Read a calibration file of any format as parameters of equations (1) to (3).

    Numbers that were written for another dialect are converted. Near-point corrections of the
    manufacturer are carried, but not part of the model.

    Raises
    ------
    CalibrationFileError
        As `read_calibration`; also for a distance tick other than the scanner's `tick_m`.
    """
    found = read_calibration(path, n_lasers)
    # Old files of scanners with another tick do not say which.
    if found.tick_m not in (tick_m, DISTANCE_TICK_M):
        raise CalibrationFileError(
            f"is made for a distance tick of {found.tick_m:g} m",
            where=str(path),
            allowed=f"{tick_m} m",
            hint="Is this the file of another scanner?",
        )
    if found.dialect is None:
        return found.parameters
    return convert(found.parameters, dialect_of(found, path), PAPER, inexact=True)


def write(path: Path, found: Calibration | LaserParameters) -> None:
    """Write a calibration file, in the format that the suffix names, with the numbers as they are.

    `read_calibration` gives back the same floats. Values that a set does not carry are written
    such that they have no effect (see `lasers.neutral`).

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, or a value is not finite.
    """
    calibration = Calibration(found) if isinstance(found, LaserParameters) else found
    format_of(path).write(path, calibration)


def read_or_nominal(path: Path | None, scanner: Scanner) -> LaserParameters:
    """Read a calibration file, or take the nominal values of the scanner where there is none."""
    if path is None:
        return nominal(scanner)
    return read(path, scanner.n_lasers, scanner.distance_tick_m)
