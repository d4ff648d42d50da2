"""One door to all formats: the suffix of the file's name tells which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from velocal.calibration.convert import convert
from velocal.calibration.dialects import MANUAL, PAPER, Dialect, dialect_named
from velocal.calibration.files.document import CalibrationFile, Document, checked
from velocal.calibration.fit import check_fit
from velocal.errors import CalibrationFileError
from velocal.scanner.models import DISTANCE_TICK_M, Scanner
from velocal.scanner.parameters import LaserParameters, nominal


class Codec(Protocol):
    """What a module of this folder does for one format."""

    def parse(self, path: Path) -> Document:
        """Parse a file without checking what it holds.

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

    def write(self, path: Path, found: CalibrationFile) -> None:
        """Write a file with the numbers as they are.

        Parameters
        ----------
        path : Path
        found : CalibrationFile

        Raises
        ------
        CalibrationFileError
            If a value is not finite.
        """


# A format is imported when it is first used: who writes one does not load the others.
def _xml() -> Codec:
    from velocal.calibration.files import db_xml

    return db_xml


def _yaml() -> Codec:
    from velocal.calibration.files import ros_yaml

    return ros_yaml


def _csv() -> Codec:
    from velocal.calibration.files import velocal_csv

    return velocal_csv


def _json() -> Codec:
    from velocal.calibration.files import velocal_json

    return velocal_json


@dataclass(frozen=True)
class Format:
    """One format of calibration files.

    Attributes
    ----------
    codec : callable
        Gives the module that reads and writes the format.
    default : str or None
        Dialect that files are written for unless another is asked for; None where the numbers
        stay as they are.
    """

    codec: Callable[[], Codec]
    default: str | None


FORMATS = {
    ".xml": Format(_xml, "veloview"),
    ".yaml": Format(_yaml, "ros"),
    ".yml": Format(_yaml, "ros"),
    ".csv": Format(_csv, "paper"),
    ".json": Format(_json, None),
}


def format_of(path: Path) -> Format:
    """Look up the format that the suffix of a file names.

    Parameters
    ----------
    path : Path
        The file itself need not exist.

    Returns
    -------
    Format

    Raises
    ------
    CalibrationFileError
        If it names no known format.
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


def read_calibration(
    path: str | Path, n_lasers: int | None = None, *, scanner: str | None = None
) -> CalibrationFile:
    """Read a calibration file of any format as it is, with all that it holds.

    Parameters
    ----------
    path : str or Path
        Velodyne's XML, a ROS driver's YAML, or CSV or JSON of velocal.
    n_lasers : int, optional
        Number of lasers of the scanner; if None, as many as the file has.
    scanner : str, optional
        Name of the scanner, if a YAML file describes it (`read_scanner`).

    Returns
    -------
    CalibrationFile
        Numbers as the file has them, in metres and radians.

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, the file damaged, or not of a scanner with `n_lasers` lasers.

    Examples
    --------
    >>> found = velocal.read_calibration("factory.xml")
    >>> len(found.parameters), found.tick_m
    (32, 0.002)
    """
    return checked(format_of(Path(path)).codec().parse(Path(path)), n_lasers, scanner)


def dialect_of(found: CalibrationFile, path: Path) -> Dialect:
    """Dialect of the numbers of a file: what it says, or else the manufacturer's.

    Files of others do not say. Their numbers are the factory's, unit for unit, whichever driver
    they were made for.

    Parameters
    ----------
    found : CalibrationFile
    path : Path
        Named in errors.

    Returns
    -------
    Dialect

    Raises
    ------
    ConfigError
        If it states a dialect that is not known.
    """
    return MANUAL if found.dialect is None else dialect_named(found.dialect, where=str(path))


def read(path: Path, n_lasers: int, tick_m: float = DISTANCE_TICK_M) -> LaserParameters:
    """Read a calibration file of any format as parameters of equations (1) to (3).

    Numbers that were written for another dialect are converted. Near-point corrections are
    carried in the manner of the manual, but are not part of the model.

    Parameters
    ----------
    path : Path
    n_lasers : int
        Number of lasers of the scanner.
    tick_m : float
        One tick of its raw distance, metres.

    Returns
    -------
    LaserParameters

    Raises
    ------
    CalibrationFileError
        As `read_calibration`; also for a distance tick other than the scanner's `tick_m`.
    """
    return _of_model(_with_tick(read_calibration(path, n_lasers), tick_m, path), path)


def read_for(path: Path, scanner: Scanner) -> CalibrationFile:
    """Read a calibration file of any format as it is, and check that it is one of the scanner.

    Parameters
    ----------
    path : Path
    scanner : Scanner

    Returns
    -------
    CalibrationFile
        Numbers as the file has them.

    Raises
    ------
    CalibrationFileError
        As `read_calibration`; also for a distance tick of another scanner, and for the calibration
        of another model.
    """
    found = read_calibration(path, scanner.n_lasers, scanner=scanner.name)
    check_fit(found.parameters.v, scanner, str(path), found.scanner)
    return _with_tick(found, scanner.distance_tick_m, path)


def _with_tick(found: CalibrationFile, tick_m: float, path: Path) -> CalibrationFile:
    # Old files of scanners with another tick do not say which.
    if found.tick_m not in (tick_m, DISTANCE_TICK_M):
        raise CalibrationFileError(
            f"is made for a distance tick of {found.tick_m:g} m",
            where=str(path),
            allowed=f"{tick_m} m",
            hint="Is this the file of another scanner?",
        )
    return found


def _of_model(
    found: CalibrationFile, path: Path, scanner: Scanner | None = None
) -> LaserParameters:
    """Parameters of equations (1) to (3), with near-point corrections as the manual has them."""
    if found.dialect is None:
        return found.parameters
    source, parameters = dialect_of(found, path), found.parameters
    target = MANUAL if source.has_near(parameters) else PAPER
    rate_hz = found.rotation_rate_hz
    return convert(parameters, source, target, scanner=scanner, rate_hz=rate_hz, inexact=True)


def write(path: Path, found: CalibrationFile | LaserParameters) -> None:
    """Write a calibration file, in the format that the suffix names, with the numbers as they are.

    `read_calibration` gives back the same floats. Values that a set does not carry are written
    such that they have no effect (see `document.neutral`).

    Parameters
    ----------
    path : Path
    found : CalibrationFile or LaserParameters

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, or a value is not finite.
    """
    whole = CalibrationFile(found) if isinstance(found, LaserParameters) else found
    format_of(path).codec().write(path, whole)


def read_or_nominal(path: Path | None, scanner: Scanner) -> LaserParameters:
    """Read a calibration file, or take the nominal values of the scanner where there is none.

    Parameters
    ----------
    path : Path or None
    scanner : Scanner

    Returns
    -------
    LaserParameters

    Raises
    ------
    CalibrationFileError
        As `read_for`.
    """
    return nominal(scanner) if path is None else _of_model(read_for(path, scanner), path, scanner)
