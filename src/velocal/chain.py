"""From a recording and a survey to a calibration, as functions in the order of the work.

The public API offers these functions, and the scripts of the workflow and the replicas of the
study call them too, so that there is one chain only.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array, joined_rows
from velocal.calibration.dialects import near_effect
from velocal.evaluation.holdout import JudgedCalibration, hold_out
from velocal.evaluation.statistics import LaserStatistics, laser_statistics
from velocal.reduction.assignment import Limits, assigned_and_expected, assigned_rows
from velocal.reduction.medians import medians_of
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import LaserParameters, nominal
from velocal.study.adjustment import Adjustment
from velocal.survey.station import Station

# What needs scipy or pandas is imported in the functions: jobs that adjust single lasers do not.
if TYPE_CHECKING:
    from velocal.evaluation.planes_in_data import Cloud
    from velocal.evaluation.stability import BinsOnPlanes
    from velocal.evaluation.unsurveyed import PlaneKey, Seen
    from velocal.study.planes import PlaneSearch


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
    """Calibrate a scanner on the planes of one station, each laser on its own.

    This is the adjustment of the paper and of the literature. `calibrate_unit` adjusts all lasers,
    stations and planes together; it is the one to use for work.

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


def unit_stations(
    recordings: Sequence[tuple[Beams, Station]],
    parameters: LaserParameters,
    limits: Limits | None = None,
) -> list[UnitStation]:
    """Put all medians at a station together, each with the plane that it hit.

    Parameters
    ----------
    recordings : sequence of (Beams, Station)
        Medians of every window, and the station where they were recorded.
    parameters : LaserParameters
        Calibration that decides what hit which plane.
    limits : Limits, optional
        Limits of the assignment; `Limits()` if left out.

    Returns
    -------
    list of UnitStation
        In the order in which they occur.
    """
    chosen = limits or Limits()
    found = []
    for name in dict.fromkeys(station.position for _, station in recordings):
        windows = [(beams, each) for beams, each in recordings if each.position == name]
        station = windows[0][1]
        assigned = [
            assigned_and_expected(beams, parameters, station.patches, chosen)
            for beams, _ in windows
        ]
        parts = [station.observations(rows) for rows, _ in assigned]
        expected = np.sum([number for _, number in assigned], axis=0)
        found.append(station.of_unit(joined_rows(parts), expected.astype(np.float64)))
    return found


def calibrate_unit(
    recordings: Sequence[tuple[Beams, Station]],
    factory: LaserParameters,
    *,
    settings: UnitSettings | None = None,
    limits: Limits | None = None,
    near_points: bool = True,
) -> JudgedCalibration:
    """Calibrate a scanner on all its stations: lasers, poses and planes are adjusted together.

    Parameters
    ----------
    recordings : sequence of (Beams, Station)
        Medians of every window (`Recording.medians`), and the station where they were recorded.
        Several recordings may be of one station.
    factory : LaserParameters
        Initial parameters, to which the corrections will belong.
    settings : UnitSettings, optional
        What is known beforehand; `UnitSettings.recommended` if left out.
    limits : Limits, optional
        What a median must satisfy to belong to a plane; `Limits()` if left out.
    near_points : bool
        Whether the near-point corrections of the factory's file, if it has any, are part of what
        is corrected. The paper leaves them out.

    Returns
    -------
    JudgedCalibration
        The calibration, and what it gains on stations (or planes) that were held out.

    Raises
    ------
    VelocalError
        If no median lies on a plane.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> station = velocal.read_station("station.json")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> medians = recording.medians("all", min_count=3)
    >>> found = velocal.calibrate_unit([(medians, station)], factory)
    >>> found.hold_out.by
    'plane'
    >>> found.unit.calibration.names
    ('dl', 'alpha', 'v')
    """
    from velocal.adjustment.unit.adjust import adjust_unit, readjust

    scanner = scanner_named(recordings[0][1].scanner)
    chosen = settings or UnitSettings.recommended(scanner, factory=factory)
    if near_points:
        recordings = [(_with_near_points(beams, factory), station) for beams, station in recordings]

    def adjusted(stations: Sequence[UnitStation]) -> LaserParameters:
        return adjust_unit(stations, factory, chosen).calibration.adjusted

    def assign(parameters: LaserParameters) -> list[UnitStation]:
        return unit_stations(recordings, parameters, limits)

    unit = readjust(assign, factory, chosen)
    stations = assign(unit.calibration.adjusted)
    near_m = np.zeros(len(factory))
    if near_points:
        near_m = _mean_near_effect(stations, factory)
    return JudgedCalibration(unit, hold_out(stations, factory, adjusted), near_m)


def points_of(beams: Beams, factory: LaserParameters, near_points: bool = True) -> Cloud:
    """Points of returns, or of medians, among which planes can be looked for.

    Parameters
    ----------
    beams : Beams
    factory : LaserParameters
    near_points : bool
        Whether the near-point corrections of the factory's file, if it has any, are applied.

    Returns
    -------
    Cloud
        In the scanner frame.
    """
    from velocal.evaluation.planes_in_data import Cloud

    if near_points:
        beams = _with_near_points(beams, factory)
    return Cloud.from_beams(beams, factory)


def observe_again(
    returns: Mapping[str, NDArray[Any]],
    rate_hz: float,
    bins: BinsOnPlanes,
    scanner: Scanner,
    factory: LaserParameters,
    near_points: bool = True,
) -> Observations:
    """Reduce a part of a recording, in bins that lie on planes of the whole recording.

    Parameters
    ----------
    returns : mapping of str to ndarray
        Columns ``azimuth``, ``laser_id`` and ``distance`` of `schemas.RETURNS`, of the part.
    rate_hz : float
        Rotations in a second.
    bins : BinsOnPlanes
        Of the whole recording.
    scanner : Scanner
    factory : LaserParameters
    near_points : bool
        As in `points_of`.

    Returns
    -------
    Observations
        Planes have the numbers that they have in `bins`.
    """
    medians = asdict(medians_of(returns, scanner, bin_ticks=bins.ticks, min_count=bins.min_count))
    rows, plane = bins.rows_of(medians)
    cloud = points_of(Beams.from_ticks(medians, scanner, rate_hz), factory, near_points)
    return Observations(
        cloud.distance_m[rows],
        cloud.phi[rows],
        cloud.laser_id[rows],
        bins.normal[plane],
        bins.offset[plane],
        plane,
    )


def calibrate_on_planes(
    recordings: Sequence[Seen],
    scanner: str | Scanner,
    *,
    settings: UnitSettings | None = None,
    judged: Collection[PlaneKey] = (),
    near_points: bool = True,
) -> JudgedCalibration:
    """Calibrate a scanner without a survey, on planes that were found in its recordings.

    Lasers and planes are adjusted together. What all lasers have in common is hardly seen.

    Parameters
    ----------
    recordings : sequence of Seen
        Points (`points_of`) and planes of every recording of one unit, all with the same
        parameters of the factory.
    scanner : str or Scanner
    settings : UnitSettings, optional
        `unsurveyed_settings` if left out.
    judged : collection of (recording, plane)
        Planes that are only judged; see `calibrate_unsurveyed`.
    near_points : bool
        As in `points_of`.

    Returns
    -------
    JudgedCalibration

    Raises
    ------
    VelocalError
        If no recording has a plane, or nothing is left to adjust on.
    """
    from velocal.evaluation.unsurveyed import (
        calibrate_unsurveyed,
        unit_station_of,
        unsurveyed_settings,
    )

    factory = recordings[0].cloud.parameters
    known = scanner_named(scanner) if isinstance(scanner, str) else scanner
    chosen = settings or unsurveyed_settings(known, factory)
    found = calibrate_unsurveyed(recordings, chosen, judged)
    if not near_points:
        return found
    stations = [unit_station_of(each) for each in recordings if each.planes]
    return replace(found, near_m=_mean_near_effect(stations, factory))


def calibrate_without_survey(
    recordings: Sequence[Beams],
    scanner: str | Scanner,
    factory: LaserParameters | None = None,
    *,
    search: PlaneSearch | None = None,
) -> JudgedCalibration:
    """Calibrate a scanner on planes that are searched in its recordings; nobody surveyed them.

    Parameters
    ----------
    recordings : sequence of Beams
        Medians of every recording of one unit, of packets (`Recording.medians`) or of a cloud of
        points (`read_cloud`). The scanner stood still in each of them.
    scanner : str or Scanner
        Its name, or the description that `read_scanner` gives.
    factory : LaserParameters, optional
        Parameters that are corrected; the nominal ones if left out.
    search : PlaneSearch, optional
        How planes are searched for; as in a study of `velocal init` if left out.

    Returns
    -------
    JudgedCalibration
        The calibration, and what it gains on planes (or recordings) that were left out.

    Raises
    ------
    VelocalError
        If no plane is found.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> medians = recording.medians("all", azimuth_bin_deg=1.2, min_count=3)
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> found = velocal.calibrate_without_survey([medians], "HDL-32E", factory)
    >>> found.hold_out.by
    'plane'
    """
    from velocal.evaluation.plane_search import find_planes
    from velocal.evaluation.planes_in_data import Search
    from velocal.evaluation.unsurveyed import Seen
    from velocal.study.planes import PlaneSearch

    known = scanner_named(scanner, where="scanner") if isinstance(scanner, str) else scanner
    parameters = nominal(known) if factory is None else factory
    how = Search.from_config(search or PlaneSearch.recommended())
    seen = []
    for number, beams in enumerate(recordings):
        cloud = points_of(beams, parameters)
        planes, _ = find_planes(cloud, how)
        seen.append(Seen(f"recording{number + 1}", cloud, tuple(planes)))
    return calibrate_on_planes(seen, known)


def _with_near_points(beams: Beams, factory: LaserParameters) -> Beams:
    """Distances as the factory's file corrects them at short range, without its dl."""
    effect = near_effect(beams.distance_m, beams.phi, beams.laser_id, factory)
    return replace(beams, distance_m=beams.distance_m + effect)


def _mean_near_effect(stations: Sequence[UnitStation], factory: LaserParameters) -> Array:
    """Mean over the observations of every laser of what the near points add, shape (lasers,)."""
    data = joined_rows([station.observations for station in stations])
    # The effect changes by millimetres per metre, so that it may be taken at the corrected range.
    effect = near_effect(data.distance_m, data.phi, data.laser_id, factory)
    count = np.bincount(data.laser_id, minlength=len(factory))
    return np.bincount(data.laser_id, effect, len(factory)) / np.maximum(count, 1)


def residuals(
    beams: Beams,
    station: Station,
    parameters: LaserParameters,
    *,
    factory: LaserParameters | None = None,
    limits: Limits | None = None,
    sigma_m: float | None = None,
) -> LaserStatistics:
    """Tell how far the points of every laser lie from the surveyed planes.

    Parameters
    ----------
    beams : Beams
        Returns, or medians of them.
    station : Station
        Survey of the position where the scanner stood.
    parameters : LaserParameters
        Calibration that is judged, by equations (1) to (3): near-point corrections that it carries
        are left out (`JudgedCalibration.near_m` says how much they are).
    factory : LaserParameters, optional
        Calibration that decides what hit which plane. Give the same one to all calibrations that
        are compared, so that they are judged on the same returns; `parameters` if left out.
    limits : Limits, optional
        What a return must satisfy to belong to a plane; `Limits()` if left out.
    sigma_m : float, optional
        Standard deviation of a distance, metres; that of the scanner's datasheet if left out.

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
    sigma = scanner_named(station.scanner).range_sigma_m if sigma_m is None else sigma_m
    return laser_statistics(s, data.laser_id, len(parameters), sigma)
