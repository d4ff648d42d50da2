"""From a recording and a survey to a calibration, as functions in the order of the work.

The public API offers these functions, and the scripts of the workflow and the replicas of the
study call them too, so that there is one chain only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.calibration.convert import for_program
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.evaluation.statistics import LaserStatistics, laser_statistics
from velocal.reduction.assignment import Limits, assigned_rows
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import LaserParameters
from velocal.study.adjustment import Adjustment
from velocal.survey.station import Station

#: Standard deviation of a distance in the datasheets of the HDL-64E and the HDL-32E, metres.
DATASHEET_STD_M = 0.02


def observe(
    beams: Beams, station: Station, parameters: LaserParameters, limits: Limits | None = None
) -> Observations:
    """Choose the returns, or medians, that hit a surveyed plane.

    Parameters
    ----------
    beams : Beams
        Returns, or medians of them.
    station : Station
        Where the scanner stood, and the planes around it.
    parameters : LaserParameters
        Calibration that decides what hit which plane; those of the factory are good enough.
    limits : Limits, optional
        Limits of the assignment; `Limits()` if left out.

    Returns
    -------
    Observations
        Distances with the plane that each of them hit.
    """
    rows = assigned_rows(beams, parameters, station.patches, limits or Limits())
    return station.observations(rows)


def adjust(
    observations: Observations,
    factory: LaserParameters,
    settings: Adjustment,
    survey: Sequence[SurveyUncertainty] = (),
) -> CalibrationSet:
    """Adjust the parameters of every laser on observed planes.

    Parameters
    ----------
    observations : Observations
        Distances to planes, of all lasers.
    factory : LaserParameters
        Initial parameters.
    settings : Adjustment
        Which parameters, how, and with which a-priori standard deviations.
    survey : sequence of SurveyUncertainty
        Uncertainty of every station; without it the survey is taken as free of errors.

    Returns
    -------
    CalibrationSet

    Raises
    ------
    VelocalError
        If an adjusted parameter has no prior standard deviation.
    """
    results = adjust_all(
        observations, factory, settings.parameters, settings.solver(), settings.stochastic(survey)
    )
    return CalibrationSet.from_adjustments(results, factory)


def calibrate(
    medians: Beams,
    station: Station,
    factory: LaserParameters,
    *,
    settings: Adjustment | None = None,
    limits: Limits | None = None,
) -> CalibrationSet:
    """Calibrate a scanner on the planes of one station.

    Parameters
    ----------
    medians : Beams
        Medians of a window (`Recording.medians`).
    station : Station
        Survey of the position where the scanner stood.
    factory : LaserParameters
        Initial parameters, to which the corrections will belong.
    settings : Adjustment, optional
        Which parameters are adjusted, how, and with which a-priori standard deviations; those of
        `Adjustment.recommended` if left out.
    limits : Limits, optional
        What a median must satisfy to belong to a plane; `Limits()` if left out.

    Returns
    -------
    CalibrationSet
        Corrections of every laser with their covariance by source.

    Raises
    ------
    VelocalError
        If an adjusted parameter has no prior standard deviation.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> station = velocal.read_station("station.json")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> found = velocal.calibrate(recording.medians("all", min_count=3), station, factory)
    >>> found.names
    ('dl', 'alpha', 'v')
    >>> len(found), int(found.observed.sum())
    (32, 32)
    """
    chosen = settings or Adjustment.recommended(scanner_named(station.scanner))
    data = observe(medians, station, factory, limits)
    return adjust(data, factory, chosen, [station.uncertainty()])


def residuals(
    beams: Beams,
    station: Station,
    parameters: LaserParameters,
    *,
    factory: LaserParameters | None = None,
    limits: Limits | None = None,
    sigma_m: float = DATASHEET_STD_M,
) -> LaserStatistics:
    """Tell how far the points of every laser lie from the surveyed planes.

    Parameters
    ----------
    beams : Beams
        Returns, or medians of them.
    station : Station
        Survey of the position where the scanner stood.
    parameters : LaserParameters
        Calibration that is judged.
    factory : LaserParameters, optional
        Calibration that decides what hit which plane. Give the same one to all calibrations that
        are compared, so that they are judged on the same returns; `parameters` if left out.
    limits : Limits, optional
        What a return must satisfy to belong to a plane; `Limits()` if left out.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.

    Returns
    -------
    LaserStatistics
        Root mean square, mean, standard deviation and shares within one and three sigma, by laser.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> station = velocal.read_station("station.json")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> before = velocal.residuals(recording.medians("all", min_count=3), station, factory)
    >>> bool(before.rms_m.mean() > 0.01)
    True
    """
    data = observe(beams, station, factory or parameters, limits)
    s = data.misclosure(parameters)
    return laser_statistics(s, data.laser_id, len(parameters), sigma_m)


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
    found: CalibrationSet, scanner: Scanner, provenance: Mapping[str, object] | None = None
) -> CalibrationFile:
    """Put a calibration set into the form of a calibration file, with all that is known of it.

    Parameters
    ----------
    found : CalibrationSet
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
    return CalibrationFile(
        found.adjusted,
        "paper",
        scanner.name,
        scanner.distance_tick_m,
        std=found.std_by_name(),
        covariance=found.covariance_by_pair(),
        provenance=provenance or {},
    )


def write_calibration(
    path: str | Path,
    calibration: CalibrationSet | LaserParameters,
    scanner: str | Scanner,
    *,
    program: str | None = None,
) -> None:
    """Write a calibration file; the suffix of its name decides the format.

    Parameters
    ----------
    path : str or Path
        ``.xml`` (Velodyne's format), ``.yaml`` (ROS drivers), ``.csv`` or ``.json`` (velocal, with
        standard deviations).
    calibration : CalibrationSet or LaserParameters
        What is written.
    scanner : str or Scanner
        Whose calibration it is.
    program : str, optional
        Program that will read the file, one of `DIALECTS`, since programs compute points
        differently; by format "veloview", "ros", or our own equations if left out.

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
    >>> bool(velocal.read_calibration("copy.yaml").parameters.dl[0] == factory.dl[0])
    True
    """
    known = scanner_named(scanner, where="scanner") if isinstance(scanner, str) else scanner
    name = program or formats.format_of(Path(path)).default or "paper"
    if name == "paper" and isinstance(calibration, CalibrationSet):
        formats.write(Path(path), as_file(calibration, known))
        return
    given = calibration.adjusted if isinstance(calibration, CalibrationSet) else calibration
    converted = for_program(given, name)
    formats.write(Path(path), CalibrationFile(converted, name, known.name, known.distance_tick_m))
