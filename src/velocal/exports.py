"""Calibrations as files: from any format to parameters, and from results to files for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.unit.result import UnitCalibration
from velocal.calibration.convert import convert, depends_on_rate, for_program
from velocal.calibration.dialects import MANUAL, NEAR_X_M, NEAR_Y_M, PAPER, dialect_named
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.evaluation.holdout import JudgedCalibration
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import FAR_POINT_M, NEAR_POINT, TWO_POINT, LaserParameters

#: What a program gets that cannot fade a correction of the distance; see `for_driver`.
Distance = Literal["safe", "single"]


def read_parameters(path: str | Path | None, scanner: str | Scanner) -> LaserParameters:
    """Read a calibration file of any format as parameters of the beam equations (1) to (3).

    Numbers that were written for another program are converted.

    Parameters
    ----------
    path : str, Path or None
        Velodyne's XML, a ROS driver's YAML, or CSV or JSON of velocal; None for the nominal values
        of the scanner.
    scanner : str or Scanner
        Whose file it is, such as "HDL-64E".

    Returns
    -------
    LaserParameters
        Metres and radians.

    Raises
    ------
    CalibrationFileError
        If the file is missing, damaged, or of another scanner.
    ConfigError
        If no scanner has that name.

    Examples
    --------
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> len(factory)
    32
    """
    known = scanner_named(scanner, where="scanner") if isinstance(scanner, str) else scanner
    return formats.read_or_nominal(None if path is None else Path(path), known)


def as_file(
    found: JudgedCalibration | CalibrationSet,
    scanner: Scanner,
    provenance: Mapping[str, object] | None = None,
) -> CalibrationFile:
    """Put a calibration set into the form of a calibration file, with all that is known of it.

    Parameters
    ----------
    found : JudgedCalibration or CalibrationSet
        Calibration of one scanner.
    scanner : Scanner
        That scanner.
    provenance : mapping of str to object, optional
        Where the numbers come from.

    Returns
    -------
    CalibrationFile
        Numbers of the dialect ``paper``, with standard deviations and covariances.
    """
    sources = dict(provenance or {})
    if isinstance(found, JudgedCalibration):
        sources |= {
            "recommended": found.recommended,
            "hold_out": found.hold_out.verdict.value,
            "ranges_m": list(found.unit.range_limits_m),
        }
        parameters, found = found.single, found.unit.calibration
    else:
        parameters = found.adjusted
    return CalibrationFile(
        parameters,
        "paper",
        scanner.name,
        scanner.distance_tick_m,
        std=found.std_by_name(),
        covariance=found.covariance_by_pair(),
        provenance=sources,
    )


def write_calibration(
    path: str | Path,
    calibration: JudgedCalibration | CalibrationSet | LaserParameters,
    scanner: str | Scanner,
    *,
    program: str | None = None,
    distance: Distance = "safe",
    rate_hz: float | None = None,
) -> None:
    """Write a calibration file; the suffix of its name decides the format.

    Parameters
    ----------
    path : str or Path
        ``.xml`` (Velodyne's format), ``.yaml`` (ROS drivers), ``.csv`` or ``.json`` (velocal, with
        standard deviations).
    calibration : JudgedCalibration, CalibrationSet or LaserParameters
        What is written. Of a calibration that is not recommended, files for programs contain the
        values of the factory.
    scanner : str or Scanner
        Whose calibration it is.
    program : str, optional
        Program that will read the file, one of `DIALECTS`, since programs compute points
        differently; by format "veloview", "ros", or our own equations if left out.
    distance : {"safe", "single"}
        What a program gets that cannot fade the correction of the distance to that of the factory
        at long range; see `for_driver`.
    rate_hz : float, optional
        Rotation rate of the recordings. Some programs turn azimuths within a firing in another way
        than the model (VeloView those of an HDL-64E: 22 cm at 80 m and 10 Hz); the file is then
        made for this rate, and says so.

    Raises
    ------
    CalibrationFileError
        If the suffix is unknown, or a value is not finite.
    ConfigError
        If the scanner or the program is unknown.
    DialectError
        If the program cannot express the vertical offset of a laser.

    Examples
    --------
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> velocal.write_calibration("copy.yaml", factory, "HDL-32E", program="ros")
    >>> bool(abs(velocal.read_parameters("copy.yaml", "HDL-32E").dl - factory.dl).max() < 1e-9)
    True
    """
    known = scanner_named(scanner, where="scanner") if isinstance(scanner, str) else scanner
    name = program or formats.format_of(Path(path)).default or "paper"
    if name == "paper" and not isinstance(calibration, LaserParameters):
        formats.write(Path(path), as_file(calibration, known))
        return
    if isinstance(calibration, JudgedCalibration):
        converted = for_driver(calibration, name, distance, known, rate_hz)
    else:
        given = calibration.adjusted if isinstance(calibration, CalibrationSet) else calibration
        converted = for_program(given, name, known, rate_hz)
    turned = rate_hz is not None and depends_on_rate(PAPER, dialect_named(name), known)
    stated = CalibrationFile(
        converted,
        name,
        known.name,
        known.distance_tick_m,
        rotation_rate_hz=rate_hz if turned else None,
    )
    formats.write(Path(path), stated)


def write_calibration_files(
    found: JudgedCalibration,
    scanner: Scanner,
    *,
    ours: Sequence[Path],
    programs: Sequence[tuple[Path, str]],
    distance: Distance,
    rates_hz: Sequence[float],
    provenance: Mapping[str, object],
) -> None:
    """Write a calibration in every format, and for every program.

    Parameters
    ----------
    found : JudgedCalibration
    scanner : Scanner
    ours : sequence of Path
        CSV and JSON with all that is known.
    programs : sequence of (Path, str)
        Files for programs, with the names of these.
    distance : {"safe", "single"}
        See `for_driver`.
    rates_hz : sequence of float
        Rotation rates of the recordings; the files are made for their median.
    provenance : mapping of str to object
        Where the numbers come from.
    """
    for path in ours:
        formats.write(path, as_file(found, scanner, provenance))
    rate_hz = round(float(np.median(rates_hz)), 3)
    for path, program in programs:
        write_calibration(path, found, scanner, program=program, distance=distance, rate_hz=rate_hz)


def fades(dialect: str) -> bool:
    """Whether a program can fade a correction of the distance to nothing at the far point.

    Some programs read one correction per laser, and some extrapolate the two points of a file
    beyond the far point.

    Parameters
    ----------
    dialect : str
    """
    two_point = dialect_named(dialect).two_point
    return two_point is not None and two_point.limit_m < FAR_POINT_M + 1.0


def with_near_points(unit: UnitCalibration) -> LaserParameters:
    """Parameters of a unit whose correction of the distance fades to that of the factory.

    The factory's correction at the far point stays. Its near-point corrections, which are that of
    the far point where the file has none, change by the correction of the unit there.

    Parameters
    ----------
    unit : UnitCalibration
        With a far point.

    Returns
    -------
    LaserParameters
        Numbers of the dialect ``manual``.
    """
    factory, adjusted = unit.calibration.initial, unit.calibration.adjusted
    change = unit.near_correction(np.array([NEAR_X_M, NEAR_Y_M])).T
    near = (old + new for old, new in zip(MANUAL.near(factory), change, strict=True))
    carried = {**factory.carried, **dict(zip(NEAR_POINT, near, strict=True))}
    carried[TWO_POINT] = np.ones(len(factory))
    return replace(factory, alpha=adjusted.alpha, v=adjusted.v, carried=carried)


def for_driver(
    found: JudgedCalibration,
    dialect: str,
    distance: Distance,
    scanner: Scanner | None = None,
    rate_hz: float | None = None,
) -> LaserParameters:
    """Parameters of a calibration for a program.

    Scanners with a two-point file have a correction of the distance that the factory found at the
    far point. The calibration replaces it at short range only: a near-point correction changes,
    and fades to nothing at the far point.

    Parameters
    ----------
    found : JudgedCalibration
    dialect : str
        Program that will read the numbers.
    distance : {"safe", "single"}
        For a program that cannot do this: "safe" leaves the distance corrections of the factory,
        which are not worse than before at any range; "single" gives one correction per laser,
        which is right at the ranges of the calibration and wrong at long range.
    scanner : Scanner, optional
    rate_hz : float, optional
        Rotation rate of the recordings; see `write_calibration`.

    Returns
    -------
    LaserParameters
        Numbers of that dialect.

    Raises
    ------
    ConfigError
        If no dialect has that name.
    DialectError
        If the dialect cannot express the vertical offset of a laser.
    """
    target, unit = dialect_named(dialect), found.unit
    factory, adjusted = unit.calibration.initial, unit.calibration.adjusted

    def converted(parameters: LaserParameters) -> LaserParameters:
        return convert(parameters, MANUAL, target, scanner=scanner, rate_hz=rate_hz, inexact=True)

    if not found.recommended:
        return converted(factory)
    if unit.far_point_m is None or (not fades(dialect) and distance == "single"):
        return for_program(found.single, dialect, scanner, rate_hz)
    # Near points of the factory that were left out must not be replaced: they may be right.
    none = all((each == factory.dl).all() for each in MANUAL.near(factory))
    if fades(dialect) and (none or found.near_m.any()):
        return converted(with_near_points(unit))
    return converted(replace(factory, alpha=adjusted.alpha, v=adjusted.v))
