"""A unit calibrated on planes that nobody surveyed, and judged on planes that were left out.

The planes are those found in the data. They are unknowns, and adjusted together with the lasers.
What all lasers have in common is hardly seen then: the means of dl and alpha over the lasers stay
at the factory's, unless the data decide them clearly better than the unit's own spread
(`UnitCalibration.common`). Upright planes alone do not show a trend of dl with the sine of the
vertical angle either, because all of them tilt with it. The covariance contains both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.evaluation.holdout import LEVEL
from velocal.evaluation.planes_in_data import Cloud, FieldPlane
from velocal.geometry.planes import fit_plane
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters

#: Prior standard deviation of a plane at the rms distance of its points from their centre, metres.
#: It is much larger than what the lasers can shift a fitted plane by.
LOOSE_M = 0.2
#: Standard deviation of a wall or floor about its plane, metres. DIN 18202 allows finished walls to
#: deviate by as much over one metre.
FLATNESS_M = 0.005
#: An angle of which the data decide less than this share is not adjusted.
LEAST_SHARE = 0.5
#: Spread over the lasers of an angle that is not adjusted, radians.
_HELD_RAD = 1e-7
#: Resamples of the bootstrap, and its seed.
_RESAMPLES, _SEED = 2000, 1


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Standard deviation of the residuals s of a plane about it, before and after.

    Attributes
    ----------
    before_m, after_m : float
        With the factory's and with the adjusted parameters; the plane is fitted to each.
    within_m : float
        After, about the mean of each laser on the plane: noise and the surface. It remains,
        however well the distances of the lasers agree.
    gain_m : float
        Before minus after; positive where the adjusted ones are better.
    low_m, high_m : float
        Interval of the difference with the confidence `LEVEL`: bootstrap over the lasers.
    """

    before_m: float
    after_m: float
    within_m: float
    gain_m: float
    low_m: float
    high_m: float


@dataclass(frozen=True)
class PlaneLeftOut:
    """A plane that was left out of the adjustment.

    Attributes
    ----------
    plane : FieldPlane
        As the search or the fit found it with the factory's parameters.
    lasers : int
        Number of lasers that see it.
    spread : Spread
    unit : UnitCalibration
        Adjusted on the other planes.
    """

    plane: FieldPlane
    lasers: int
    spread: Spread
    unit: UnitCalibration


@dataclass(frozen=True)
class LeftOut:
    """Every plane, left out once.

    Attributes
    ----------
    planes : tuple of PlaneLeftOut
    mean : Spread
        Mean over the planes.
    """

    planes: tuple[PlaneLeftOut, ...]
    mean: Spread


def unsurveyed_settings(scanner: Scanner, parameters: LaserParameters) -> UnitSettings:
    """Settings for planes that nobody surveyed.

    Parameters
    ----------
    scanner : Scanner
    parameters : LaserParameters
        Parameters that are corrected.

    Notes
    -----
    No dl stays at the factory's alone. Without a survey, that of one laser is known only relative
    to those of the others, so that the data never seem to decide much of it.
    """
    return replace(UnitSettings.recommended(scanner, factory=parameters), hold_below=0.0)


def unit_station_of(
    cloud: Cloud, planes: Sequence[FieldPlane], name: str = "recording"
) -> UnitStation:
    """Points on planes as a station whose pose is known and whose planes are not.

    Parameters
    ----------
    cloud : Cloud
    planes : sequence of FieldPlane
        Found in this cloud.
    name : str
        Of the station.

    Returns
    -------
    UnitStation
        Its site frame is the scanner frame: the pose has no error. Every plane has a wide prior
        about what was fitted.
    """
    rows = np.concatenate([plane.rows for plane in planes])
    number = np.repeat(np.arange(len(planes)), [len(plane.rows) for plane in planes])
    normal = np.stack([plane.fit.plane.normal for plane in planes])
    offset = np.array([plane.fit.plane.offset for plane in planes])
    survey = SurveyUncertainty(
        translation=np.zeros(3),
        pose=np.zeros((6, 6)),
        planes=np.stack([_loose(plane, cloud.xyz[plane.rows]) for plane in planes]),
        flatness_m=np.full(len(planes), FLATNESS_M),
    )
    observations = Observations(
        cloud.distance_m[rows],
        cloud.phi[rows],
        cloud.laser_id[rows],
        normal[number],
        offset[number],
        number,
    )
    return UnitStation(name, observations, survey, tuple(plane.name for plane in planes))


def adjust_unsurveyed(
    stations: Sequence[UnitStation], factory: LaserParameters, settings: UnitSettings
) -> UnitCalibration:
    """Adjust a unit on planes that nobody surveyed.

    The distances are always adjusted. Alpha and v are adjusted only if the data decide more than
    half of them (`LEAST_SHARE`) for most lasers: few planes that are met at similar angles show the
    differences of the lasers as distances and as angles alike.

    Parameters
    ----------
    stations : sequence of UnitStation
        See `unit_station_of`.
    factory : LaserParameters
        Parameters that are corrected.
    settings : UnitSettings
        See `unsurveyed_settings`.

    Returns
    -------
    UnitCalibration
        Its covariance is that for given values of the angles that are not adjusted.
    """
    found = adjust_unit(stations, factory, replace(settings, integration_points=1))
    share = np.median(found.determined[found.calibration.observed], axis=0)
    held = {
        name: _HELD_RAD
        for name, decided in zip(NAMES, share, strict=True)
        if name != "dl" and decided < LEAST_SHARE
    }
    return adjust_unit(
        stations, factory, replace(settings, prior={**(settings.prior or {}), **held})
    )


def leave_one_plane_out(
    cloud: Cloud, planes: Sequence[FieldPlane], settings: UnitSettings
) -> LeftOut:
    """Adjust on all planes but one, fit the one to the corrected points, for every plane.

    Parameters
    ----------
    cloud : Cloud
        With the parameters that are corrected.
    planes : sequence of FieldPlane
        Found in this cloud. The points of a plane remain the same before and after.
    settings : UnitSettings
        See `unsurveyed_settings`.

    Returns
    -------
    LeftOut

    Raises
    ------
    VelocalError
        If there are fewer than two planes.
    """
    if len(planes) < 2:
        raise VelocalError(
            f"{len(planes)} planes, of which one is left out",
            where="leave one plane out",
            allowed="2 planes or more",
            hint="Name planes by boxes, or let more planes be found.",
        )
    lasers = len(cloud.parameters)
    units, moments = [], []
    for left_out in planes:
        station = unit_station_of(cloud, [plane for plane in planes if plane is not left_out])
        units.append(adjust_unsurveyed([station], cloud.parameters, settings))
        after = Cloud.from_beams(cloud, units[-1].calibration.adjusted)
        laser = cloud.laser_id[left_out.rows]
        residuals = [_residuals(each, left_out) for each in (cloud, after)]
        moments.append([[np.bincount(laser, s**k, lasers) for k in range(3)] for s in residuals])
    # By plane, before and after, power of s, and laser.
    sums = np.array(moments)
    seen = np.flatnonzero(sums[:, 0, 0].any(axis=0))
    rng = np.random.default_rng(_SEED)
    times = rng.multinomial(len(seen), np.full(len(seen), 1.0 / len(seen)), size=_RESAMPLES)
    std, resampled = _std(sums.sum(axis=3)), _std(sums[..., seen] @ times.T)
    count, variance = sums[:, 1, 0], np.nan_to_num(_std(sums)[:, 1] ** 2)
    within = np.sqrt((count * variance).sum(axis=1) / count.sum(axis=1))
    parts = tuple(
        PlaneLeftOut(plane, int((own[0, 0] > 0).sum()), _spread(*found), unit)
        for plane, own, unit, *found in zip(
            planes, sums, units, within, std, resampled, strict=True
        )
    )
    return LeftOut(parts, _spread(within.mean(), std.mean(axis=0), resampled.mean(axis=0)))


def _loose(plane: FieldPlane, points: Array) -> Array:
    """Covariance (4, 4) of a plane that may turn about both axes of its points, and shift."""
    centre = points.mean(axis=0)
    centred = points - centre
    # The last axis is the normal.
    axes = np.linalg.eigh(centred.T @ centred)[1][:, :0:-1]
    turn = LOOSE_M / np.sqrt(np.mean((centred @ axes) ** 2, axis=0))
    root = np.zeros((4, 3))
    root[:3, :2] = axes * turn
    root[3, :2] = -centre @ axes * turn
    root[3, 2] = LOOSE_M
    return np.asarray(root @ root.T)


def _residuals(cloud: Cloud, plane: FieldPlane) -> Array:
    """Residuals s of the points of a plane about the plane that is fitted to them."""
    return cloud.s(plane.rows, fit_plane(cloud.xyz[plane.rows]).plane)


def _std(sums: Array) -> Array:
    """Standard deviation out of the sums of the powers 0 to 2, along the axis 2."""
    count, total, square = np.moveaxis(sums, 2, 0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.maximum(square / count - (total / count) ** 2, 0.0)))


def _spread(within: float, std: Array, resampled: Array) -> Spread:
    """Before and after, out of arrays (2,) and (2, resamples)."""
    before, after = std
    tail = (1.0 - LEVEL) / 2.0
    low, high = np.nanquantile(resampled[0] - resampled[1], [tail, 1.0 - tail])
    return Spread(
        before_m=float(before),
        after_m=float(after),
        within_m=float(within),
        gain_m=float(before - after),
        low_m=float(low),
        high_m=float(high),
    )
