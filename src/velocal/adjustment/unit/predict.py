"""The result that the adjustment of a unit will state, before anything is measured.

The standard deviations of an adjustment follow from its design, its weights and the assumed spreads
of its unknowns; what is measured enters only through the sizes that it estimates. If these are
given, the same equations state the covariance beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from velocal.adjustment.unit.adjust import checked
from velocal.adjustment.unit.assemble import assemble
from velocal.adjustment.unit.expected import ExpectedPopulation
from velocal.adjustment.unit.model import UNKNOWNS, about_scanner, linearise
from velocal.adjustment.unit.noise import Noise
from velocal.adjustment.unit.population import Population, find_mode, integrate
from velocal.adjustment.unit.result import UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.stage import make_stage
from velocal.adjustment.unit.station import UnitStation, azimuth_bins
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Weights of the quantiles of 5, 50 and 95 % in the mean of a distribution (Pearson and Tukey).
_SHARES = np.array([0.185, 0.63, 0.185])


@dataclass(frozen=True, kw_only=True)
class UnitSizes:
    """Sizes that the adjustment of a unit estimates, and that a prediction is given.

    Attributes
    ----------
    spread : mapping of str to float
        Standard deviations of the random unknowns by name: ``dl``, ``alpha``, ``v``, ``scale`` (the
        error at the far point, metres, where there is one), ``hoff``, ``shift``, ``plane`` and
        ``common``; metres, radians, 1. See `population.Size`.
    tau_m, omega_m : ndarray, shape (lasers, stations) or any that fits it
        Standard deviations of the pattern along azimuth, and of one observation.
    length_rad : float
        Correlation length of the pattern.
    found : bool
        Whether an adjustment has found the spreads. If not, they are the truth that the adjustment
        has to learn from its data, and the uncertainty of that is part of what it will state.
    """

    spread: Mapping[str, float]
    tau_m: Array
    omega_m: Array
    length_rad: float
    found: bool = False

    @classmethod
    def of(cls, unit: UnitCalibration) -> UnitSizes:
        """Take the sizes that an adjustment has found; the median where a laser saw nothing.

        A spread that is not known exactly stands for its root mean square, since the adjustment
        averages variances. The mean of the squares follows from their quantiles by the rule of
        Pearson and Tukey (1965).
        """
        spread = {
            one.name.removeprefix("sigma_"): float(
                np.sqrt(_SHARES @ np.square([one.low, one.value, one.high]))
            )
            for one in unit.population
        }
        spread["scale"] = spread.pop("far", spread.get("scale", 0.0))
        tau, omega = (
            np.where(np.isfinite(each), each, np.nanmedian(each))
            for each in (unit.noise.tau, unit.noise.omega)
        )
        return cls(
            spread=spread, tau_m=tau, omega_m=omega, length_rad=unit.noise.length_rad, found=True
        )


def predict_unit(
    stations: Sequence[UnitStation],
    factory: LaserParameters,
    settings: UnitSettings,
    sizes: UnitSizes,
) -> UnitCalibration:
    """State what the adjustment of a unit will state.

    Parameters
    ----------
    stations : sequence of UnitStation
        With the observations that are expected. They must agree with `factory` and the planes: the
        misclosures are zero, and so are the corrections of the result.
    factory : LaserParameters
        Parameters that will be corrected.
    settings : UnitSettings
        As for the adjustment. The spreads that it fixes are those of the settings.
    sizes : UnitSizes
        Sizes that the adjustment would estimate. Columns of the noise are stations in the order
        of their names.

    Returns
    -------
    UnitCalibration
        As of `adjust_unit`: its covariances, the shares that the data decide, and the parameters
        that will be held. All corrections are zero, except for rounding.

    Raises
    ------
    VelocalError
        If there is no station or no observation, two stations have one name, or a size is
        missing.
    """
    stations = checked(stations)
    shape = len(factory), len(stations)
    bins = azimuth_bins(stations, factory, settings.azimuth_bin_rad)
    at = linearise(bins, factory, np.zeros((len(factory), len(UNKNOWNS))), settings.far_point_m)
    noise = Noise(
        np.broadcast_to(sizes.tau_m, shape).ravel(),
        np.broadcast_to(sizes.omega_m, shape).ravel(),
        sizes.length_rad,
        np.zeros(shape, dtype=bool).ravel(),
    )
    centred = [about_scanner(station) for station in stations]
    stage = make_stage(centred, len(factory), bins, at, noise, settings)
    learnt = [size.name for size in stage.population.learnt]
    if missing := [name for name in learnt if not sizes.spread.get(name, 0.0) > 0.0]:
        raise VelocalError(
            f"no spread of {', '.join(missing)}",
            where="prediction of a unit",
            allowed="a standard deviation above 0 of each",
        )
    true_log = np.log([sizes.spread[name] for name in learnt])
    population: Population = stage.population
    mode, points = true_log, 1
    if not sizes.found:
        population = ExpectedPopulation(**vars(population), true_log=true_log)
        mode, points = find_mode(population, stage.sums, true_log), settings.integration_points
    found = integrate(population, stage.sums, mode, points, stage.describe)
    return assemble(stations, factory, settings, stage, found)
