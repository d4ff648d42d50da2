"""Adjust a unit: all lasers, the poses of its stations and the planes together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.result import CalibrationSet, LaserQuality
from velocal.adjustment.unit.describe import Description, describe
from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.model import (
    UNKNOWNS,
    Linearised,
    Shared,
    linearise,
    range_columns,
    shared_effects,
)
from velocal.adjustment.unit.noise import FIRST_LENGTH, Group, Noise, estimate
from velocal.adjustment.unit.population import (
    SHRINKING,
    Integrated,
    Population,
    find_mode,
    integrate,
    quantiles,
)
from velocal.adjustment.unit.result import (
    NAMES,
    CommonPart,
    Component,
    Held,
    PlaneEffect,
    StationEffect,
    UnitCalibration,
    UnitNoise,
)
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import Bins, UnitStation, azimuth_bins
from velocal.adjustment.unit.sums import Layout, Sums, groups_of, sums
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Quantiles of the intervals of the population.
_QUANTILES = (0.5, 0.05, 0.95)
#: Assignments after which `readjust` gives up.
MAX_PASSES = 5
#: Share of the observations of a laser on a plane that may change in the last assignment.
UNCHANGED = 0.02
#: Share of the expected observations that may be missing without a warning.
MISSING = 0.05


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
    stations = _checked(stations)
    bins = azimuth_bins(stations, factory, settings.azimuth_bin_rad)
    x = np.zeros((len(factory), len(UNKNOWNS)))
    by_survey = np.zeros(len(bins.mean.phi))
    mode: Array | None = None
    for number in range(1, settings.linearisations + 1):
        at = linearise(bins, factory, x, settings.far_point_m)
        # What the survey explains of the residuals has a longer correlation than the pattern: the
        # length is estimated when that has been subtracted.
        length = FIRST_LENGTH if number < settings.linearisations else None
        stage = _stage(stations, len(factory), bins, at, at.z - by_survey, settings, length)
        mode = find_mode(stage.population, stage.sums, mode)
        if number < settings.linearisations:
            best = stage.describe(
                stage.population.posterior(stage.sums, mode), stage.population.values(mode)
            )
            x = best.unknowns
            by_survey = stage.shared.matrix @ best.common[stage.layout.survey]
    assert mode is not None
    integrated = integrate(
        stage.population, stage.sums, mode, settings.integration_points, stage.describe
    )
    return _result(stations, factory, settings, stage, integrated)


@dataclass(frozen=True)
class _Stage:
    """One linearisation, and all that follows before the standard deviations are known."""

    bins: Bins
    linearised: Linearised
    shared: Shared
    noise: Noise
    layout: Layout
    sums: Sums
    population: Population
    mean_range: Array
    output: Array
    survey: Mapping[str, NDArray[np.int64]]

    def describe(self, posterior: Posterior, values: Array) -> Description:
        """Posterior in the form of a result."""
        return describe(posterior, values, self.output, self.survey)


def _stage(
    stations: Sequence[UnitStation],
    lasers: int,
    bins: Bins,
    at: Linearised,
    left: Array,
    settings: UnitSettings,
    length: float | None,
) -> _Stage:
    """Estimate the noise of what is `left` of the misclosures, and sum the rows."""
    rows = groups_of(bins, lasers, len(stations))
    noise = estimate([_group(bins, at, left, r) if len(r) else None for r in rows], length)
    group = bins.mean.laser_id * len(stations) + bins.mean.station_number
    weight = 1.0 / (noise.tau[group] ** 2 + noise.omega[group] ** 2 / bins.count)
    shared = shared_effects(stations, bins, at, settings).reduced(weight)
    layout = Layout(
        len(stations), tuple(len(s.plane_names) for s in stations), shared.matrix.shape[1]
    )
    mean_range = _mean_range(bins, at, lasers)
    survey = {
        kind: layout.survey.start + shared.columns(kind) for kind in ("pose", "planes", "flatness")
    }
    return _Stage(
        bins=bins,
        linearised=at,
        shared=shared,
        noise=noise,
        layout=layout,
        sums=sums(bins, at, shared, noise, layout, rows),
        population=Population.of(layout, settings),
        mean_range=mean_range,
        output=_output(mean_range, settings.far_point_m),
        survey=survey,
    )


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
        whose expected observations more than `MISSING` are missing.
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


def _checked(stations: Sequence[UnitStation]) -> list[UnitStation]:
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


def _group(bins: Bins, at: Linearised, z: Array, rows: NDArray[np.int64]) -> Group:
    """Input of the estimation of noise; columns of parameters and planes are projected out."""
    plane = bins.mean.plane_number[rows]
    on = (plane[:, None] == np.unique(plane)).astype(np.float64)
    # The constant of dl is the sum of the columns of the planes.
    design = np.concatenate([at.matrix[rows, 1:], on], axis=1)
    return Group(bins.mean.phi[rows], bins.count[rows], z[rows], design)


def _mean_range(bins: Bins, at: Linearised, lasers: int) -> Array:
    """Mean range of the observations of every laser; that of all for a laser without any."""
    laser = bins.mean.laser_id
    count = np.bincount(laser, bins.count, minlength=lasers)
    total = np.bincount(laser, bins.count * at.range_m, minlength=lasers)
    mean = np.full(lasers, total.sum() / count.sum())
    mean[count > 0] = total[count > 0] / count[count > 0]
    return mean


def _output(mean_range: Array, far_point_m: float | None) -> Array:
    """Derivatives of dl at the mean range, alpha and v by the unknowns, (lasers, 3, 6)."""
    output = np.zeros((len(mean_range), len(NAMES), len(UNKNOWNS)))
    output[:, 0, 0], output[:, 0, 3] = range_columns(mean_range, far_point_m)
    output[:, 1, 1] = output[:, 2, 2] = 1.0
    return output


def _result(
    stations: Sequence[UnitStation],
    factory: LaserParameters,
    settings: UnitSettings,
    stage: _Stage,
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
    covariance = sum(sources.values())
    prior, means = mean([one.prior for one in each]), mean([one.means for one in each])
    flat = between.reshape(len(weight), -1)
    together = mean([one.together for one in each]) + (weight[:, None] * flat).T @ flat
    values, vectors = np.linalg.eigh(together)
    kept = values > 1e-8 * max(float(values[-1]), 1e-300)
    root = (vectors[:, kept] * np.sqrt(values[kept])).reshape(lasers, u, -1)

    common_std = np.stack([np.sqrt(np.diag(one.common_covariance)) for one in each])
    common_std = np.sqrt(mean(list(common_std**2)))
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    total = prior.copy()
    total[:, 1:] += np.stack([np.diag(one.datum.covariance) for one in each]).T @ weight
    total[:, 0] += common_std[0] ** 2
    determined = np.clip(1.0 - variance / total, 0.0, 1.0)
    # What the data do not decide stays with the mean of the unit. The variance of the prior is
    # then that of the error.
    held = determined < settings.hold_below
    corrections = np.where(held, means, corrections)
    back = np.where(held, np.maximum(total - variance, 0.0), 0.0)
    sources["prior"] = sources["prior"] + back[:, :, None] * np.eye(u)

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
            value=float(datum.mean[i]),
            std=float(np.sqrt(datum.covariance[i, i])),
            by_survey=float(datum.by_survey[i]),
            by_survey_std=float(datum.by_survey_std[i]),
            decided=float(datum.decided[i]),
        )
        for i, name in enumerate(("alpha", "v"))
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
        warnings=_warnings(station_effects),
    )


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
                variance_factor_p=float("nan"),
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
    stage: _Stage,
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
    turn = stage.shared.pose(number)
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
