"""One linearisation of a unit: noise, sums, and all that the posterior needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.unit.common_mean import GivenMean
from velocal.adjustment.unit.describe import Description, describe
from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.model import (
    UNKNOWNS,
    Linearised,
    Shared,
    range_columns,
    shared_effects,
)
from velocal.adjustment.unit.noise import Group, Noise, estimate
from velocal.adjustment.unit.population import Population
from velocal.adjustment.unit.result import NAMES
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import Bins, UnitStation
from velocal.adjustment.unit.sums import Layout, Sums, groups_of, sums
from velocal.arrays import Array


@dataclass(frozen=True)
class Stage:
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
    least_std: Mapping[str, float]
    least_spread: Mapping[str, float]
    means: Mapping[str, GivenMean]

    def describe(self, posterior: Posterior, values: Array) -> Description:
        """Posterior in the form of a result."""
        return describe(
            posterior,
            values,
            self.output,
            self.survey,
            least_std=self.least_std,
            least_spread=self.least_spread,
            given=self.means,
        )


def noise_of(
    bins: Bins, at: Linearised, left: Array, lasers: int, stations: int, length: float | None
) -> Noise:
    """Estimate the noise of what is `left` of the misclosures."""
    rows = groups_of(bins, lasers, stations)
    return estimate([_group(bins, at, left, r) if len(r) else None for r in rows], length)


def make_stage(
    stations: Sequence[UnitStation],
    lasers: int,
    bins: Bins,
    at: Linearised,
    noise: Noise,
    settings: UnitSettings,
) -> Stage:
    """Sum the rows, with the noise of every laser at every station."""
    rows = groups_of(bins, lasers, len(stations))
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
    return Stage(
        bins=bins,
        linearised=at,
        shared=shared,
        noise=noise,
        layout=layout,
        sums=sums(bins, at, shared, noise, layout, rows),
        population=Population.of(layout, settings, survey["flatness"]),
        mean_range=mean_range,
        output=_output(mean_range, settings.far_point_m),
        survey=survey,
        least_std=settings.least_std,
        least_spread=settings.least_spread,
        means=settings.means,
    )


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
