"""The result that the adjustment of a unit will state, before anything is measured.

The standard deviations of an adjustment follow from its design, its weights and the assumed spreads
of its unknowns; what is measured enters only through the sizes that it estimates. If these are
given, the same equations state the covariance beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from velocal.adjustment.unit.adjust import checked
from velocal.adjustment.unit.assemble import assemble
from velocal.adjustment.unit.describe import Description
from velocal.adjustment.unit.expected import ExpectedPopulation
from velocal.adjustment.unit.model import UNKNOWNS, about_scanner, linearise
from velocal.adjustment.unit.noise import Noise
from velocal.adjustment.unit.population import Integrated, find_mode, integrate
from velocal.adjustment.unit.result import NORMAL_95, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.stage import Stage, make_stage
from velocal.adjustment.unit.station import UnitStation, azimuth_bins
from velocal.adjustment.unit.threads import one_thread
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Places, in standard deviations, and weights of the average over a normal distribution (Gauss and
#: Hermite). Seven: with two stations the mean of dl changes from the factory's to that of the data
#: within one standard deviation of the size of the common shift.
_PLACES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


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
    found : mapping of str to (float, float), or None
        Quantiles of 5 and 95 % of every spread, where an adjustment has found them; their medians
        are in `spread`. If None, the spreads are the truth that the adjustment has to learn from
        its data, and the uncertainty of that is part of what it will state.
    mean : mapping of str to float
        Means of the corrections of ``dl``, ``alpha`` and ``v`` over the lasers, as the data and the
        survey will show them; 0 where not given. How much of a mean is believed depends on it.
    """

    spread: Mapping[str, float]
    tau_m: Array
    omega_m: Array
    length_rad: float
    found: Mapping[str, tuple[float, float]] | None = None
    mean: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, unit: UnitCalibration) -> UnitSizes:
        """Take the sizes that an adjustment has found; the median where a laser saw nothing."""
        parts = {
            "scale" if one.name == "sigma_far" else one.name.removeprefix("sigma_"): one
            for one in unit.population
        }
        tau, omega = (
            np.where(np.isfinite(each), each, np.nanmedian(each))
            for each in (unit.noise.tau, unit.noise.omega)
        )
        return cls(
            spread={name: one.value for name, one in parts.items()},
            tau_m=tau,
            omega_m=omega,
            length_rad=unit.noise.length_rad,
            found={name: (one.low, one.high) for name, one in parts.items()},
            mean={one.name: one.by_survey for one in unit.common},
        )


@one_thread()
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
        With the observations that are expected. They must agree with `factory` and the planes, so
        that the misclosures are zero.
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
        that will be held. The corrections are the part of the means that is believed.

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
    at = replace(at, z=at.matrix @ [sizes.mean.get(name, 0.0) for name in UNKNOWNS])
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
    if sizes.found is None:
        population = ExpectedPopulation(**vars(stage.population), true_log=true_log)
        mode = find_mode(population, stage.sums, true_log)
        points = settings.integration_points
        integrated = integrate(population, stage.sums, mode, points, stage.describe)
    else:
        low, high = np.log([sizes.found[name] for name in learnt]).reshape(-1, 2).T
        integrated = _averaged(stage, true_log, low, high)
    return assemble(stations, factory, settings, stage, integrated)


def _averaged(stage: Stage, middle: Array, low: Array, high: Array) -> Integrated[Description]:
    """Average over the distribution of the sizes, of which quantiles of 50, 5 and 95 % are known.

    Parameters
    ----------
    stage : Stage
    middle, low, high : ndarray, shape (learnt,)
        Logarithms; they are taken as normal, with another standard deviation to either side.
    """
    described = []
    for place in _PLACES:
        step = high - middle if place > 0.0 else middle - low
        log = middle + place / NORMAL_95 * step
        posterior = stage.population.posterior(stage.sums, log)
        described.append(stage.describe(posterior, stage.population.values(log)))
    return Integrated(_WEIGHTS, tuple(described))
