"""A unit calibrated on planes that nobody surveyed, and judged on planes that were left out.

There may be one recording or many: the scanner may be moved, turned and tilted between them. The
lasers are the same in all, every recording has planes of its own.

The planes are those found in the data. They are unknowns, and adjusted together with the lasers.
What all lasers have in common is hardly seen then: the means of dl, alpha and v over the lasers
stay at the factory's, unless the data decide them clearly better than the unit's own spread
(`UnitCalibration.common`). Upright planes alone do not show a trend of dl with the sine of the
vertical angle either, because all of them tilt with it. The covariance contains both.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.adjustment.unit.common_mean import CERTAIN, GivenMean
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.evaluation.holdout import LEVEL, Gain, HeldOut, HoldOut, JudgedCalibration
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, plane_of
from velocal.geometry.planes import fit_plane
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters

#: Prior standard deviation of a plane at the rms distance of its points from their centre, metres.
#: It is much larger than what the lasers can shift a fitted plane by.
LOOSE_M = 0.2
#: Standard deviation of a wall or floor about its plane, metres, before the data are seen. DIN
#: 18202 allows finished walls to deviate by as much over one metre. The adjustment learns a
#: multiple of it.
FLATNESS_M = 0.005
#: An angle of which the data decide less than this share is not adjusted.
LEAST_SHARE = 0.5
#: Spread over the lasers of an angle that is not adjusted, radians.
_HELD_RAD = 1e-7
#: Spread of v over the lasers by which its mean is judged at least, radians: that of usual units.
#: Where all lasers are wrong alike, the data show nearly no spread.
USUAL_V_RAD = float(np.deg2rad(0.05))
#: Resamples of the bootstrap, and its seed.
_RESAMPLES, _SEED = 2000, 1


#: A plane of a recording: the names of both.
PlaneKey = tuple[str, str]


@dataclass(frozen=True)
class Seen:
    """What a recording shows: its points, and planes among them.

    Attributes
    ----------
    name : str
        Of the recording.
    cloud : Cloud
        With the parameters that are corrected, which are the same for all recordings of a unit.
    planes : tuple of FieldPlane
        Found in this cloud.
    """

    name: str
    cloud: Cloud
    planes: tuple[FieldPlane, ...]

    @classmethod
    def of_members(
        cls,
        name: str,
        cloud: Cloud,
        rows: NDArray[np.integer],
        plane: NDArray[np.integer],
        plane_names: Sequence[str],
    ) -> Seen:
        """Fit the planes whose points are known.

        Parameters
        ----------
        name : str
        cloud : Cloud
        rows, plane : ndarray of int, shape (n,)
            Points on planes, and the number of the plane of each.
        plane_names : sequence of str
        """
        members = [rows[plane == number].astype(np.int64) for number in range(len(plane_names))]
        planes = zip(plane_names, members, strict=True)
        return cls(name, cloud, tuple(plane_of(each, cloud, own) for each, own in planes))

    @property
    def keys(self) -> list[PlaneKey]:
        """All planes by their names."""
        return [(self.name, plane.name) for plane in self.planes]

    def without(self, left_out: Collection[PlaneKey]) -> Seen:
        """The same recording without some planes."""
        kept = (each for each in self.planes if (self.name, each.name) not in left_out)
        return replace(self, planes=tuple(kept))


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

    def gain(self, lasers: int) -> Gain:
        """The same as a gain of so many lasers."""
        return Gain(self.before_m, self.after_m, self.gain_m, self.low_m, self.high_m, lasers)


@dataclass(frozen=True)
class PlaneLeftOut:
    """A plane that was left out of the adjustment.

    Attributes
    ----------
    recording : str
        Name of its recording.
    plane : FieldPlane
        As the search or the fit found it with the factory's parameters.
    lasers : int
        Number of lasers that see it.
    spread : Spread
    unit : UnitCalibration
        Adjusted on the other planes.
    """

    recording: str
    plane: FieldPlane
    lasers: int
    spread: Spread
    unit: UnitCalibration


@dataclass(frozen=True)
class LeftOut:
    """Planes that were left out, each once.

    Attributes
    ----------
    planes : tuple of PlaneLeftOut
    mean : Spread
        Mean over the planes.
    """

    planes: tuple[PlaneLeftOut, ...]
    mean: Spread


def unsurveyed_settings(
    scanner: Scanner, parameters: LaserParameters, prior: Mapping[str, float] | None = None
) -> UnitSettings:
    """Settings for planes that nobody surveyed.

    Parameters
    ----------
    scanner : Scanner
    parameters : LaserParameters
        Parameters that are corrected.
    prior : mapping of str to float, optional
        See `UnitSettings`.

    Notes
    -----
    No dl stays at the factory's alone. Without a survey, that of one laser is known only relative
    to those of the others, so that the data never seem to decide much of it.
    """
    return replace(
        UnitSettings.recommended(scanner, prior=prior, factory=parameters),
        hold_below=0.0,
        learn_relief=True,
        least_spread={"v": USUAL_V_RAD},
    )


def unit_station_of(seen: Seen) -> UnitStation:
    """Points on planes as a station whose pose is known and whose planes are not.

    Parameters
    ----------
    seen : Seen

    Returns
    -------
    UnitStation
        Its site frame is the scanner frame: the pose has no error. Every plane has a wide prior
        about what was fitted.
    """
    cloud, planes = seen.cloud, seen.planes
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
    return UnitStation(seen.name, observations, survey, tuple(plane.name for plane in planes))


def adjust_unsurveyed(recordings: Sequence[Seen], settings: UnitSettings) -> UnitCalibration:
    """Adjust a unit on planes that nobody surveyed.

    The distances are always adjusted. Alpha and v are adjusted only if the data decide more than
    half of them (`LEAST_SHARE`) for most lasers: few planes that are met at similar angles show the
    differences of the lasers as distances and as angles alike.

    Parameters
    ----------
    recordings : sequence of Seen
        Those without a plane are passed over.
    settings : UnitSettings
        See `unsurveyed_settings`.

    Returns
    -------
    UnitCalibration
        The variances of the angles that are not adjusted are those of the unit as the data show
        them. The covariance contains what errors of this size do to the distances. The mean of
        such an angle is corrected if the planes decide on it (`CommonPart.decided`), if they know
        it better than the lasers differ from each other, and if it is larger than 4.5 times its
        standard deviation, as where a file is wrong for all lasers alike; otherwise it is only
        stated (`CommonPart.by_survey`).

    Raises
    ------
    VelocalError
        If no recording has a plane.
    """
    # Here, as it needs scipy: the maps of residuals and the report use this module without.
    from velocal.adjustment.unit.adjust import adjust_unit

    used = [each for each in recordings if each.planes]
    if not used:
        raise VelocalError(
            "no recording has a plane",
            where="calibration without a survey",
            hint="Name planes by boxes (`patches`), or let more planes be found (`search`).",
        )
    factory = used[0].cloud.parameters
    stations = [unit_station_of(each) for each in used]
    found = adjust_unit(stations, factory, settings)
    share = np.median(found.determined[found.calibration.observed], axis=0)
    held = {
        name: _HELD_RAD
        for name, decided in zip(NAMES, share, strict=True)
        if name != "dl" and decided < LEAST_SHARE
    }
    if not held:
        return found
    spread = {one.name.removeprefix("sigma_"): one.rms for one in found.population}
    # Where all lasers are taken to have the same angle, its mean seems to be known too well.
    free = {one.name: one for one in found.common if one.name in held}
    # Where surfaces are uneven, a mean that is not there reaches three or four times its standard
    # deviation. Only what is clearer than that moves all points.
    means = {
        name: GivenMean(one.value, one.std)
        for name, one in free.items()
        if not one.at_factory
        and abs(one.by_survey) > CERTAIN * one.by_survey_std
        and one.by_survey_std < max(spread[name], settings.least_spread.get(name, 0.0))
    }
    result = adjust_unit(
        stations,
        factory,
        replace(
            settings,
            prior={**(settings.prior or {}), **held},
            least_std={**settings.least_std, **{name: spread[name] for name in held}},
            least_spread={},
            means=means,
        ),
    )
    common = {one.name: one for one in result.common}
    for name, one in free.items():
        common[name] = (
            one
            if name in means
            else replace(common[name], by_survey=one.by_survey, by_survey_std=one.by_survey_std)
        )
    return replace(result, common=tuple(common.values()))


def fitted_residuals(cloud: Cloud, plane: FieldPlane) -> Array:
    """Residuals s of the points of a plane about the plane that is fitted to them, metres.

    Parameters
    ----------
    cloud : Cloud
        Points of its recording, by any calibration.
    plane : FieldPlane

    Returns
    -------
    ndarray, shape (points,)
    """
    return cloud.s(plane.rows, fit_plane(cloud.xyz[plane.rows]).plane)


def divisions(recordings: Sequence[Seen]) -> list[frozenset[PlaneKey]]:
    """Parts that are left out one after the other: recordings, or planes of the only one.

    Parameters
    ----------
    recordings : sequence of Seen

    Returns
    -------
    list of frozenset of (recording, plane)
    """
    used = [each for each in recordings if each.planes]
    if len(used) > 1:
        return [frozenset(each.keys) for each in used]
    return [frozenset([key]) for each in used for key in each.keys]


def drawn(recordings: Sequence[Seen], share: float, seed: int) -> list[PlaneKey]:
    """Draw planes at random that are only judged.

    Parameters
    ----------
    recordings : sequence of Seen
    share : float
        Share of the planes, between 0 and 1; one at least is drawn, and one at least is not.
    seed : int

    Returns
    -------
    list of (recording, plane)
    """
    keys = [key for each in recordings for key in each.keys]
    count = min(max(round(share * len(keys)), 1), len(keys) - 1)
    chosen = np.random.default_rng(seed).permutation(len(keys))[: max(count, 0)]
    return [keys[i] for i in sorted(chosen)]


def leave_out(
    recordings: Sequence[Seen], parts: Sequence[Collection[PlaneKey]], settings: UnitSettings
) -> LeftOut:
    """Adjust without the planes of a part, fit these to the corrected points, for every part.

    Parameters
    ----------
    recordings : sequence of Seen
    parts : sequence of collection of (recording, plane)
        See `divisions`. No plane is in two parts. The points of a plane remain the same before and
        after.
    settings : UnitSettings
        See `unsurveyed_settings`.

    Returns
    -------
    LeftOut

    Raises
    ------
    VelocalError
        If nothing is left to adjust on.
    """
    # Only the corrections are used: the most probable standard deviations of the unit are enough.
    settings = replace(settings, integration_points=1)
    found: list[tuple[str, FieldPlane, UnitCalibration]] = []
    moments = []
    lasers = len(recordings[0].cloud.parameters)
    for part in parts:
        kept = [each.without(part) for each in recordings]
        if not any(each.planes for each in kept):
            raise VelocalError(
                f"all {sum(len(each.planes) for each in recordings)} planes are left out",
                where="calibration without a survey",
                allowed="2 planes or more, of which some are left",
                hint="Name planes by boxes, or let more planes be found.",
            )
        unit = adjust_unsurveyed(kept, settings)
        for seen in recordings:
            judged = [plane for plane in seen.planes if (seen.name, plane.name) in part]
            after = Cloud.from_beams(seen.cloud, unit.calibration.adjusted) if judged else None
            for plane in judged:
                laser = seen.cloud.laser_id[plane.rows]
                s = [
                    fitted_residuals(each, plane)
                    for each in (seen.cloud, after)
                    if each is not None
                ]
                moments.append([[np.bincount(laser, e**k, lasers) for k in range(3)] for e in s])
                found.append((seen.name, plane, unit))
    # By plane, before and after, power of s, and laser.
    sums = np.array(moments)
    lasers_seen = np.flatnonzero(sums[:, 0, 0].any(axis=0))
    n = len(lasers_seen)
    times = np.random.default_rng(_SEED).multinomial(n, np.full(n, 1.0 / n), size=_RESAMPLES)
    std, resampled = _std(sums.sum(axis=3)), _std(sums[..., lasers_seen] @ times.T)
    count, variance = sums[:, 1, 0], np.nan_to_num(_std(sums)[:, 1] ** 2)
    within = np.sqrt((count * variance).sum(axis=1) / count.sum(axis=1))
    planes = tuple(
        PlaneLeftOut(*which[:2], int((own[0, 0] > 0).sum()), _spread(*numbers), which[2])
        for which, own, *numbers in zip(found, sums, within, std, resampled, strict=True)
    )
    return LeftOut(planes, _spread(within.mean(), std.mean(axis=0), resampled.mean(axis=0)))


def calibrate_unsurveyed(
    recordings: Sequence[Seen],
    settings: UnitSettings,
    judged: Collection[PlaneKey] = (),
) -> JudgedCalibration:
    """Calibrate a unit on planes that nobody surveyed, and judge it on planes left out.

    Parameters
    ----------
    recordings : sequence of Seen
    settings : UnitSettings
        See `unsurveyed_settings`.
    judged : collection of (recording, plane)
        Planes that are only judged. If left out, every plane is used, and each part of `divisions`
        is left out once to judge the method.

    Returns
    -------
    JudgedCalibration
        Without a survey the residuals of a plane are those about the plane that is fitted to its
        points, so that `HeldOut.total` and `HeldOut.centred` are the same. The interval is that
        of a bootstrap over the lasers.

    Raises
    ------
    VelocalError
        If no recording has a plane, or all planes are only judged.
    """
    unit = adjust_unsurveyed([each.without(judged) for each in recordings], settings)
    unit = replace(unit, warnings=(*unit.warnings, *_datum(unit)))
    parts = [frozenset(judged)] if judged else divisions(recordings)
    lasers = len(unit.calibration)
    if sum(len(each.planes) for each in recordings) < 2:
        return JudgedCalibration(unit, HoldOut((), None, None), np.zeros(lasers))
    left_out = leave_out(recordings, parts, settings)
    held_out = []
    for one in left_out.planes:
        gain = one.spread.gain(one.lasers)
        held_out.append(HeldOut(one.recording, one.plane.name, gain, gain))
    mean = left_out.mean.gain(max(one.lasers for one in left_out.planes))
    return JudgedCalibration(unit, HoldOut(tuple(held_out), mean, mean), np.zeros(lasers))


def relative_std(unit: UnitCalibration) -> Array:
    """Standard deviations of corrections relative to their mean over the observed lasers.

    A recording without a survey hardly shows that mean. It is the same for all lasers, so that it
    does not make a plane thicker.

    Parameters
    ----------
    unit : UnitCalibration

    Returns
    -------
    ndarray, shape (lasers, 3)
        In the order of `NAMES`; NaN for a laser that was not observed.
    """
    seen = unit.calibration.observed
    n = int(seen.sum())
    own = np.diagonal(unit.calibration.covariance, axis1=1, axis2=2)[:, : len(NAMES)]
    shared = unit.shared[seen]
    # The covariance between lasers is shared[k] @ shared[l].T; that of a laser with itself is more.
    alone = own[seen] - (shared**2).sum(axis=2)
    centre = shared.mean(axis=0)
    variance = ((shared - centre) ** 2).sum(axis=2) + alone * (1.0 - 2.0 / n)
    found = np.full((len(seen), len(NAMES)), np.nan)
    found[seen] = np.sqrt(np.maximum(variance + alone.sum(axis=0) / n**2, 0.0))
    return found


def _datum(unit: UnitCalibration) -> list[str]:
    """Say in words and numbers what a calibration without a survey cannot know."""
    common = {one.name: one for one in unit.common}
    near, far = unit.range_limits_m
    relative = np.sqrt(np.nanmean(relative_std(unit)[:, NAMES.index("dl")] ** 2))
    said = (
        "without a survey a common correction of the distances of all lasers is hardly seen: "
        f"it is {common['dl'].value * 1e3:.1f} mm here, with a standard deviation of "
        f"{common['dl'].std * 1e3:.1f} mm; relative to it the distance of a laser is known to "
        f"{relative * 1e3:.1f} mm"
    )
    turned = "a common correction of alpha is a turn of the scanner frame and stays at zero"
    if not common["v"].at_factory:
        value, std = np.rad2deg([common["v"].value, common["v"].std])
        turned += (
            f"; the planes show that all beams are {abs(value):.2f} deg "
            f"{'higher' if value > 0.0 else 'lower'} than the file says, with a standard deviation "
            f"of {std:.2f} deg, and this is applied"
        )
    ranges = (
        f"the planes lie at {near:.1f} to {far:.1f} m; at other ranges the corrections are not "
        "tested"
    )
    return [said, turned, ranges]


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
