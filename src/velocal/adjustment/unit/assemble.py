"""Put the result of a unit together from its posterior at several standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.result import CalibrationSet, LaserQuality
from velocal.adjustment.unit.common_mean import DATUM
from velocal.adjustment.unit.describe import Description
from velocal.adjustment.unit.model import UNKNOWNS, Linearised, lever
from velocal.adjustment.unit.noise import Noise
from velocal.adjustment.unit.population import SHRINKING, Integrated, Population, quantiles
from velocal.adjustment.unit.result import (
    NAMES,
    CommonPart,
    Component,
    Held,
    PlaneEffect,
    RangeScale,
    StationEffect,
    UnitCalibration,
    UnitNoise,
)
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.stage import Stage
from velocal.adjustment.unit.station import Bins, UnitStation
from velocal.arrays import Array
from velocal.scanner.parameters import LaserParameters

#: Quantiles of the intervals of the population.
_QUANTILES = (0.5, 0.05, 0.95)
#: Share of the expected observations that may be missing without a warning.
MISSING = 0.05


def assemble(
    stations: Sequence[UnitStation],
    factory: LaserParameters,
    settings: UnitSettings,
    stage: Stage,
    integrated: Integrated[Description],
) -> UnitCalibration:
    """Average the descriptions, and put the result together."""
    bins, at, noise, mean_range = stage.bins, stage.linearised, stage.noise, stage.mean_range
    weight, each = integrated.weight, integrated.found
    lasers, u = each[0].corrections.shape

    def mean(values: Sequence[Array]) -> Array:
        return np.asarray(np.tensordot(weight, np.stack(values), axes=1))

    corrections = mean([one.corrections for one in each])
    between = np.stack([one.corrections - corrections for one in each])
    spread = np.einsum("p,pku,pkv->kuv", weight, between, between)
    sources = {name: mean([one.sources[name] for one in each]) for name in each[0].sources}
    sources["population"] = spread
    if len(stations) == 1:
        sources["shift"] = sources["shift"].copy()
        sources["shift"][:, 0, 0] += (1.0 - SHRINKING**2) * settings.shift_m**2
    covariance = np.asarray(sum(sources.values()))
    prior, means = mean([one.prior for one in each]), mean([one.means for one in each])
    flat = between.reshape(len(weight), -1)
    together = mean([one.together for one in each]) + (weight[:, None] * flat).T @ flat
    values, vectors = np.linalg.eigh(together)
    kept = values > 1e-8 * max(float(values[-1]), 1e-300)
    root = (vectors[:, kept] * np.sqrt(values[kept])).reshape(lasers, u, -1)

    variance = np.diagonal(covariance, axis1=1, axis2=2)
    total = prior.copy()
    total += np.stack([np.diag(one.datum.covariance) for one in each]).T @ weight
    determined = np.clip(1.0 - variance / total, 0.0, 1.0)
    # What the data do not decide stays with the mean of the unit.
    of_spread = np.diagonal(spread, axis1=1, axis2=2)
    counted = typical(variance, of_spread, corrections - means, prior)
    # If this mean is known less well than the lasers differ from each other, its variance is not a
    # matter of a single laser.
    in_common = root.mean(axis=0)
    of_mean = (in_common**2).sum(axis=-1)
    about_mean = counted - (root**2).sum(axis=-1) + ((root - in_common) ** 2).sum(axis=-1)
    share = 1.0 - counted / total
    share = np.where(of_mean > prior, np.maximum(share, 1.0 - about_mean / prior), share)
    held = np.clip(share, 0.0, 1.0) < settings.hold_below
    # Errors of voff are not corrected: what they explain must not be what the others follow.
    known = covariance - sources["offsets"]
    corrections, back = hold(corrections, known, means, total, held)
    sources["prior"] = sources["prior"] + back

    count = np.zeros((lasers, len(stations)), dtype=np.int64)
    np.add.at(count, (bins.mean.laser_id, bins.mean.station_number), bins.count.astype(np.int64))
    calibration = CalibrationSet(
        names=NAMES,
        initial=factory,
        corrections=corrections,
        observed=count.sum(axis=1) > 0,
        sources=sources,
    )
    after = bins.mean.misclosure(calibration.adjusted)
    before = bins.mean.misclosure(factory)
    calibration = replace(
        calibration, quality=_quality(bins, at, calibration, after, determined, count)
    )
    station_effects = tuple(
        _station_effect(number, station, stage, each[0], (before, after), count[:, number])
        for number, station in enumerate(stations)
    )
    datum = each[0].datum
    parts = tuple(
        CommonPart(
            name=name,
            unit=unit,
            value=float(datum.mean[i]),
            std=float(np.sqrt(datum.covariance[i, i])),
            by_survey=float(datum.by_survey[i]),
            by_survey_std=float(datum.by_survey_std[i]),
            decided=float(datum.decided[i]),
        )
        for i, (name, unit) in enumerate(DATUM.items())
    )
    observed = count > 0
    shape = (lasers, len(stations))
    return UnitCalibration(
        calibration=calibration,
        shared=root,
        determined=determined,
        held=tuple(Held(int(k), NAMES[j], float(determined[k, j])) for k, j in np.argwhere(held)),
        common=parts,
        population=_population(stage.population, integrated, noise, observed.ravel()),
        stations=station_effects,
        noise=UnitNoise(
            np.where(observed, noise.tau.reshape(shape), np.nan),
            np.where(observed, noise.omega.reshape(shape), np.nan),
            noise.length,
        ),
        mean_range_m=mean_range,
        range_limits_m=(float(at.range_m.min()), float(at.range_m.max())),
        far_point_m=settings.far_point_m,
        range_scale=None if settings.far_point_m else _range_scale(bins, at, stage, each[0]),
        warnings=_warnings(station_effects),
    )


def _range_scale(bins: Bins, at: Linearised, stage: Stage, description: Description) -> RangeScale:
    """Scale of the most probable values, and the ranges at which it was observed."""
    laser, place = bins.mean.laser_id, UNKNOWNS.index("scale")
    near, far = np.full((2, len(stage.mean_range)), np.inf)
    np.minimum.at(near, laser, at.range_m)
    np.minimum.at(far, laser, -at.range_m)
    spread = description.values[[size.name for size in stage.population.sizes].index("scale")]
    share = 1.0 - (description.scale_std / spread) ** 2
    return RangeScale(
        value=description.unknowns[:, place],
        std=description.scale_std,
        determined=np.clip(share, 0.0, 1.0),
        near_m=np.where(np.isfinite(near), near, np.nan),
        far_m=np.where(np.isfinite(far), -far, np.nan),
    )


def typical(variance: Array, of_spread: Array, difference: Array, prior: Array) -> Array:
    """Variances of parameters if no laser differed from the mean by more than the unit's spread.

    Parameters
    ----------
    variance : ndarray, shape (lasers, u)
    of_spread : ndarray, shape (lasers, u)
        The part of it that is there because the spread of the unit is estimated.
    difference : ndarray, shape (lasers, u)
        Of the estimates from the mean of the unit.
    prior : ndarray, shape (lasers, u)
        Square of the spread.

    Returns
    -------
    ndarray, shape (lasers, u)

    Notes
    -----
    Another spread moves an estimate in proportion to its difference, so that this part grows with
    the square of the difference. The lasers that are far off, and gain most from a correction,
    would seem to be those of which the data say least.
    """
    far = np.maximum(difference**2, prior)
    return np.asarray(variance - (1.0 - prior / np.where(far > 0.0, far, 1.0)) * of_spread)


def hold(
    corrections: Array, covariance: Array, means: Array, prior: Array, held: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Hold some parameters of lasers at the mean of the unit, and condition the others on it.

    Parameters
    ----------
    corrections : ndarray, shape (lasers, u)
    covariance : ndarray, shape (lasers, u, u)
        Of the corrections.
    means : ndarray, shape (lasers, u)
        Where parameters are held.
    prior : ndarray, shape (lasers, u)
        Variances of the parameters about `means` before the adjustment.
    held : ndarray of bool, shape (lasers, u)

    Returns
    -------
    corrections : ndarray, shape (lasers, u)
    back : ndarray, shape (lasers, u, u)
        What is added to the covariance.

    Notes
    -----
    The parameters of a laser are correlated: a dl that was estimated together with a v does not
    fit the data with another v. The others therefore move by ``C_oh C_hh^-1 (mean - held)``, as if
    they had been adjusted with the held value. Before the adjustment, the step of a held parameter
    has the prior covariance less ``C_hh``; the others move by their share of it.
    """
    corrections, back = corrections.copy(), np.zeros_like(covariance)
    for k in np.flatnonzero(held.any(axis=1)):
        own = held[k]
        block = covariance[k][np.ix_(own, own)]
        # The held parameters follow themselves: the gain of their own rows is the identity.
        gain = np.linalg.solve(block, covariance[k][own]).T
        corrections[k] += gain @ (means[k] - corrections[k])[own]
        corrections[k, own] = means[k, own]
        values, vectors = np.linalg.eigh(np.diag(prior[k, own]) - block)
        root = gain @ vectors * np.sqrt(np.maximum(values, 0.0))
        back[k] = root @ root.T
    return corrections, back


def _quality(
    bins: Bins,
    at: Linearised,
    calibration: CalibrationSet,
    after: Array,
    determined: Array,
    count: NDArray[np.int64],
) -> tuple[LaserQuality, ...]:
    """Quality of every laser in the form of all other adjustments."""
    found = []
    laser = bins.mean.laser_id
    for number, n in enumerate(count.sum(axis=1)):
        own = laser == number
        weight = bins.count[own]
        weak = tuple(
            name for name, share in zip(NAMES, determined[number], strict=True) if share < 0.5
        )
        rank = len(NAMES) - len(weak) if n else 0
        rows = int(own.sum())
        variance = float((weight * after[own] ** 2).sum() / weight.sum()) if rows else np.nan
        if rows:
            scaled = at.matrix[own][:, :3] / np.maximum(
                np.sqrt((at.matrix[own][:, :3] ** 2).sum(axis=0)), 1e-300
            )
            condition = float(np.linalg.cond(scaled)) if rows >= len(NAMES) else float("inf")
        else:
            condition = float("inf")
        found.append(
            LaserQuality(
                count=int(n),
                rank=rank,
                redundancy=max(int(n) - rank, 0),
                residual_std_m=float(np.sqrt(variance)),
                variance_factor=float("nan"),
                condition=condition,
                least_redundancy_number=float("nan"),
                weakly_determined=weak,
                iterations=2,
                converged=bool(n),
                message="adjusted with all lasers of the unit" if n else "no observations",
            )
        )
    return tuple(found)


def _station_effect(
    number: int,
    station: UnitStation,
    stage: Stage,
    description: Description,
    misclosures: tuple[Array, Array],
    count: NDArray[np.int64],
) -> StationEffect:
    bins, layout = stage.bins, stage.layout
    errors = description.common[layout.survey]
    covariance = description.common_covariance
    start = layout.survey.start
    place = layout.common_shift.start + number
    own = bins.mean.station_number == number
    turn = lever(station.survey.translation) @ stage.shared.pose(number)
    pose = turn @ errors
    pose_covariance = turn @ covariance[layout.survey, layout.survey] @ turn.T
    corrections = {}
    for effect in stage.shared.effects:
        places = np.arange(effect.columns.start, effect.columns.stop)
        block = covariance[np.ix_(start + places, start + places)]
        if effect.kind == "planes" and effect.station in (-1, number):
            to_scanner = np.eye(4) if station.pose is None else station.pose.plane_matrix()
            root = to_scanner @ effect.root
            std = np.sqrt(np.maximum(np.diag(root @ block @ root.T), 0.0))
            corrections[effect.name] = root @ errors[effect.columns], std
    planes = []
    for plane, name in enumerate(station.plane_names):
        rows = own & (bins.mean.plane_number == plane)
        n = bins.count[rows]
        before, after = (
            float((n * s[rows]).sum() / n.sum()) if len(n) else float("nan") for s in misclosures
        )
        correction, std = corrections.get(
            name, (np.zeros(4), np.sqrt(np.maximum(np.diag(station.survey.planes[plane]), 0.0)))
        )
        planes.append(PlaneEffect(name, correction, std, int(n.sum()), before, after))
    share = None
    if station.expected is not None:
        expected = np.asarray(station.expected, dtype=np.float64)
        share = np.where(expected > 0, count / np.maximum(expected, 1.0), 1.0)
    return StationEffect(
        name=station.name,
        shift_m=float(description.common[place]),
        shift_std_m=float(np.sqrt(covariance[place, place])),
        pose=pose,
        pose_prior=station.survey.pose,
        pose_covariance=pose_covariance,
        planes=tuple(planes),
        count=count,
        share=share,
    )


def _population(
    population: Population,
    integrated: Integrated[Description],
    noise: Noise,
    observed: NDArray[np.bool_],
) -> tuple[Component, ...]:
    values = np.stack([one.values for one in integrated.found])
    found = []
    for number, size in enumerate(population.sizes):
        name = "far" if size.name == "scale" and size.unit == "m" else size.name
        if size.fixed or len(values) == 1:
            value = low = high = float(values[0, number])
            if size.fixed and name == "shift":
                # The model knows only a share of it; see `SHRINKING`.
                value = low = high = value / SHRINKING
        else:
            value, low, high = quantiles(values[:, number], integrated.weight, _QUANTILES)
        found.append(
            Component(
                f"sigma_{name}", size.unit, float(value), float(low), float(high), not size.fixed
            )
        )
    for name, sizes in (("tau", noise.tau), ("omega", noise.omega)):
        value, low, high = np.quantile(sizes[observed], _QUANTILES)
        found.append(Component(name, "m", float(value), float(low), float(high), True))
    found.append(Component("length", "rad", noise.length, noise.length, noise.length, True))
    return tuple(found)


def _warnings(stations: Sequence[StationEffect]) -> tuple[str, ...]:
    found = []
    for station in stations:
        if station.share is not None and (station.share < 1.0 - MISSING).any():
            lasers = np.flatnonzero(station.share < 1.0 - MISSING)
            found.append(
                f"position {station.name}: more than {MISSING:.0%} of the expected observations "
                f"are missing of the lasers {', '.join(map(str, lasers[:8]))}"
                + (f" and {len(lasers) - 8} others" if len(lasers) > 8 else "")
            )
    return tuple(found)
