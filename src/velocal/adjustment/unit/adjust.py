"""Adjust a unit: all lasers, the poses of its stations and the planes together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from velocal.adjustment.unit.assemble import assemble
from velocal.adjustment.unit.corrected_survey import CorrectedSurvey
from velocal.adjustment.unit.model import UNKNOWNS, about_scanner, linearise
from velocal.adjustment.unit.noise import FIRST_LENGTH
from velocal.adjustment.unit.population import find_mode, integrate
from velocal.adjustment.unit.result import UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.stage import make_stage, noise_of
from velocal.adjustment.unit.station import UnitStation, azimuth_bins
from velocal.adjustment.unit.threads import one_thread
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Assignments after which `readjust` gives up.
MAX_PASSES = 5
#: After the linearisations of the settings, the model is linearised again, at most this often in
#: all, until no pose turns by more than this: a pose that is wrong by some degrees is found in
#: steps, and each leaves terms of second order of the next.
MAX_LINEARISATIONS = 8
SAME_POSE_RAD = float(np.deg2rad(0.1))
#: The same where one linearisation is wanted, for a rough result.
ROUGH_POSE_RAD = float(np.deg2rad(1.0))
#: Share of the observations of a laser on a plane that may change in the last assignment.
UNCHANGED = 0.02


@one_thread()
def adjust_unit(
    stations: Sequence[UnitStation],
    factory: LaserParameters,
    settings: UnitSettings | None = None,
) -> UnitCalibration:
    """Adjust all lasers of a unit on the observations of all its stations.

    Unknowns are dl, alpha, v, range scale, voff and hoff of every laser, the pose of every
    station, the planes and their deviations from flatness. Their standard deviations and the
    correlated noise are estimated from the data; the survey has the covariances that it states.

    Parameters
    ----------
    stations : sequence of UnitStation
        One at least.
    factory : LaserParameters
        Parameters that are corrected.
    settings : UnitSettings, optional
        The defaults are those that are recommended.

    Returns
    -------
    UnitCalibration

    Raises
    ------
    VelocalError
        If there is no station or no observation, if two stations have one name, or if an
        observation is of an unknown laser or not finite.
    """
    settings = settings or UnitSettings()
    stations = checked(stations)
    bins = azimuth_bins(stations, factory, settings.azimuth_bin_rad)
    x = np.zeros((len(factory), len(UNKNOWNS)))
    centred = [about_scanner(station) for station in stations]
    survey = CorrectedSurvey.none(centred)
    relief = np.zeros(len(bins.mean.phi))
    mode: Array | None = None
    number = 0
    while True:
        number += 1
        enough = number >= settings.linearisations
        moved = survey.bins(bins)
        at = linearise(moved, factory, x, settings.far_point_m)
        # What the survey explains of the residuals has a longer correlation than the pattern: the
        # length is estimated when that has been subtracted.
        length = None if enough else FIRST_LENGTH
        left = at.z - relief
        at = replace(at, z=at.z + survey.accounted(moved, at))
        noise = noise_of(moved, at, left, len(factory), len(stations), length)
        stage = make_stage(survey.moved(), len(factory), moved, at, noise, settings)
        mode = find_mode(stage.population, stage.sums, mode)
        best = stage.describe(
            stage.population.posterior(stage.sums, mode), stage.population.values(mode)
        )
        errors = best.common[stage.layout.survey]
        corrected = CorrectedSurvey.of(centred, stage.shared, errors)
        turn = np.abs(corrected.pose[:, :3] - survey.pose[:, :3]).max()
        allowed = SAME_POSE_RAD if settings.linearisations > 1 else ROUGH_POSE_RAD
        if enough and (turn < allowed or number >= MAX_LINEARISATIONS):
            break
        x, survey = best.unknowns, corrected
        places = stage.shared.columns("flatness")
        relief = stage.shared.matrix[:, places] @ errors[places]
    integrated = integrate(
        stage.population, stage.sums, mode, settings.integration_points, stage.describe
    )
    # Misclosures are stated on the planes as surveyed.
    return assemble(stations, factory, settings, replace(stage, bins=bins), integrated)


def readjust(
    assign: Callable[[LaserParameters], Sequence[UnitStation]],
    factory: LaserParameters,
    settings: UnitSettings | None = None,
) -> UnitCalibration:
    """Adjust, and assign the returns to planes again, until the assignment does not change.

    A laser that is off by about the limit of the assignment keeps only the part of its returns
    that lies within the limit. The adjusted parameters assign the others too.

    Parameters
    ----------
    assign : callable
        Gives the stations with the observations that parameters assign to planes. The
        `UnitStation.expected` of each says how many observations a laser should have.
    factory : LaserParameters
    settings : UnitSettings, optional

    Returns
    -------
    UnitCalibration
        With a warning where the assignment still changes after `MAX_PASSES`, and for lasers of
        whose expected observations more than 5 % are missing.
    """
    settings = settings or UnitSettings()
    # Until the assignment is final, the most probable standard deviations are enough.
    rough = replace(settings, integration_points=1, linearisations=1)
    stations, changes = list(assign(factory)), True
    passes = 1
    while changes and passes < MAX_PASSES:
        again = list(assign(adjust_unit(stations, factory, rough).calibration.adjusted))
        changes = not _same(stations, again, len(factory))
        stations = again if changes else stations
        passes += changes
    result = replace(adjust_unit(stations, factory, settings), passes=passes)
    if not changes:
        return result
    told = f"the assignment of returns to planes still changes after {passes} adjustments"
    return replace(result, warnings=(*result.warnings, told))


def _same(first: Sequence[UnitStation], second: Sequence[UnitStation], lasers: int) -> bool:
    """Whether two assignments choose about as many observations of every laser on every plane.

    Single returns at the edges of planes come and go with every small change of the angles. What
    matters is a laser that was near the limit: it gains many.
    """
    for a, b in zip(first, second, strict=True):
        planes = len(a.plane_names)
        old, new = (
            np.bincount(
                each.observations.laser_id.astype(np.int64) * planes
                + each.observations.plane_number,
                minlength=lasers * planes,
            )
            for each in (a, b)
        )
        if (np.abs(new - old) > UNCHANGED * old + 2).any():
            return False
    return True


def checked(stations: Sequence[UnitStation]) -> list[UnitStation]:
    """Stations in the order of their names, which must differ; one must have observations."""
    names = [station.name for station in stations]
    if not stations or not any(len(station.observations.phi) for station in stations):
        raise VelocalError(
            "no observations to adjust the unit on",
            where="adjustment of a unit",
            allowed="one station with observations at least",
        )
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise VelocalError(
            f"more than one station is called {', '.join(repeated)}",
            where="adjustment of a unit",
            hint="Join all recordings of a position in one station.",
        )
    # The result must not depend on the order of the stations.
    return sorted(stations, key=lambda station: station.name)
