"""Truth of the simulated world: drawn from the seed, and therefore the same at every call."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.scanner.models import AZIMUTH_TICKS, SCANNERS
from velocal.scanner.parameters import LaserParameters, nominal
from velocal.simulation.world import World

#: Ranges at which the factory calibrates an HDL-64E S2 besides its far point (manual).
NEAR_POINTS_M = {"x": 2.4, "y": 1.93}


def factory_parameters(world: World, scanner: str) -> LaserParameters:
    """Parameters that the factory states for the simulated unit."""
    design = nominal(SCANNERS[scanner])
    model = world.scanner(scanner).factory
    if model is None:
        return design
    rng = world.rng("factory", scanner)
    n = len(design)
    far = design.corrected(
        {
            "dl": model.dist_mean_m + rng.normal(0.0, model.dist_cm * 1e-2, n),
            "alpha": np.deg2rad(
                rng.normal(0.0, model.rotational_unit_deg)
                + rng.normal(0.0, model.rotational_deg, n)
            ),
            "v": np.deg2rad(
                rng.normal(0.0, model.vertical_unit_deg) + rng.normal(0.0, model.vertical_deg, n)
            ),
        }
    )
    # The corrections of the near points as the factory measured them, with an error of near_cm.
    dl, scale, _ = _range_truth(world, scanner, far.dl)
    near = {
        f"dist_correction_{axis}": dl - scale * at_m + rng.normal(0.0, model.near_cm * 1e-2, n)
        for axis, at_m in NEAR_POINTS_M.items()
    }
    return replace(far, carried=near)


@dataclass(frozen=True)
class UnitTruth:
    """True properties of a unit.

    Attributes
    ----------
    parameters : LaserParameters
        True dl, alpha, v, voff, hoff.
    range_scale : ndarray, shape (n,)
        Error of the measured distance as a share of the range, up to `far_point_m`.
    far_point_m : float
        Beyond this range the error is constant.
    noise_m : ndarray, shape (n,)
        Standard deviation of a single shot at short range.
    noise_range_m : float
        Range at which the variance of a shot has doubled, metres.
    """

    parameters: LaserParameters
    range_scale: Array
    far_point_m: float
    noise_m: Array
    noise_range_m: float

    def raw(self, length: Array, laser: int | NDArray[np.integer]) -> Array:
        """Raw distances without noise, metres.

        Parameters
        ----------
        length : ndarray, shape (n,)
            True ranges, metres.
        laser : int or ndarray of int, shape (n,)
        """
        stretched = self.range_scale[laser] * np.minimum(length, self.far_point_m)
        return np.asarray(length + stretched - self.parameters.dl[laser])

    def noise(self, length: Array, laser: int | NDArray[np.integer]) -> Array:
        """Standard deviations of shots, metres.

        Constant at short range, and growing with the square of the range at long range, as in
        real recordings.

        Parameters
        ----------
        length : ndarray, shape (n,)
            True ranges, metres.
        laser : int or ndarray of int, shape (n,)
        """
        square = (length / self.noise_range_m) ** 2
        return np.asarray(self.noise_m[laser] * np.sqrt(1.0 + square * square))


def unit_truth(world: World, scanner: str) -> UnitTruth:
    """Draw the true parameters of a unit about its factory values."""
    errors = world.scanner(scanner).errors
    factory = factory_parameters(world, scanner)
    rng = world.rng("unit", scanner)
    n = len(factory)
    dl, scale, far_point_m = _range_truth(world, scanner, factory.dl)
    true = replace(
        factory,
        dl=dl,
        alpha=factory.alpha + np.deg2rad(rng.normal(0.0, errors.alpha_deg, n)),
        v=factory.v + np.deg2rad(rng.normal(0.0, errors.v_deg, n)),
    )
    noise = errors.noise_median_cm * 1e-2 * np.exp(errors.noise_log * even_normal(rng, n))
    return UnitTruth(true, scale, far_point_m, noise, errors.noise_range_m)


def even_normal(rng: np.random.Generator, n: int, limit: float = np.inf) -> Array:
    """Draw n standard normal values, one from each of n equally likely intervals, in random order.

    A unit has 64 or 32 lasers. The mean and the spread of independent values would differ from unit
    to unit by more than the tables of the study allow.

    Parameters
    ----------
    rng : Generator
    n : int
    limit : float
        The distribution is cut at this number of standard deviations, and scaled to the standard
        deviation 1 again.
    """
    share = (rng.permutation(n) + rng.uniform(0.0, 1.0, n)) / n
    from scipy.special import ndtr, ndtri

    inside = 1.0 - 2.0 * ndtr(-limit)
    variance = 1.0
    if np.isfinite(limit):
        density = np.exp(-0.5 * limit**2) / np.sqrt(2.0 * np.pi)
        variance -= 2.0 * limit * density / inside
    return np.asarray(ndtri(ndtr(-limit) + share * inside) / np.sqrt(variance))


def _range_truth(world: World, scanner: str, factory_dl: Array) -> tuple[Array, Array, float]:
    """True dl (at range zero), range scale, and the range up to which the scale holds.

    The dl of the factory holds at its far point: the error is drawn for that range, and the range
    scale gives the error at all other ranges. The two-point correction of the units compensates it.
    """
    errors = world.scanner(scanner).errors
    rng = world.rng("range", scanner)
    n = len(factory_dl)
    # With the factory's dl, distances are too long by the mean: the true dl is smaller.
    far = (errors.dl_mean_cm + errors.dl_cm * even_normal(rng, n, errors.dl_limit)) * 1e-2
    scale = errors.range_scale_cm_per_m * 1e-2 * even_normal(rng, n)
    return factory_dl - far + errors.far_point_m * scale, scale, errors.far_point_m


def position_errors(world: World, scanner: str, position: str) -> Array:
    """Range errors that stay with a position, metres, shape (36000, n) over raw azimuth.

    A shift per laser, and a fixed pattern along azimuth: white noise smoothed by a Gaussian
    kernel and scaled to its size per laser.
    """
    errors = world.scanner(scanner).errors
    rng = world.rng("position", scanner, position)
    n = SCANNERS[scanner].n_lasers
    shift = errors.shift_mean_cm.get(position, 0.0) + rng.normal(0.0, errors.shift_cm, n)
    # Smooth on a ring of 0.1 degree by Fourier transformation, then interpolate linearly.
    coarse = AZIMUTH_TICKS // 10
    size = errors.pattern_median_cm * np.exp(errors.pattern_log * even_normal(rng, n))
    white = rng.standard_normal((coarse, n))
    frequency = np.fft.rfftfreq(coarse, d=360.0 / coarse)
    kernel = np.exp(-2.0 * (np.pi * frequency * errors.pattern_kernel_deg) ** 2)
    smooth = np.fft.irfft(np.fft.rfft(white, axis=0) * kernel[:, None], n=coarse, axis=0)
    pattern = smooth / smooth.std(axis=0) * size
    fraction = (np.arange(AZIMUTH_TICKS) % 10)[:, None] / 10.0
    left = np.repeat(pattern, 10, axis=0)
    right = np.repeat(np.roll(pattern, -1, axis=0), 10, axis=0)
    return np.asarray((left + fraction * (right - left) + shift) * 1e-2)


@dataclass(frozen=True)
class Drift:
    """Range drift of a sample.

    The sum of a constant of the sample, of values at beginning, middle and end with straight lines
    between them, and of the effect of the scanner's temperature.

    Attributes
    ----------
    world : World
        Gives the temperature.
    sample : str
    steady : ndarray, shape (n,)
        Constant per laser, metres.
    windows : ndarray, shape (3, n)
        Per laser at beginning, middle and end of the experiment, metres.
    per_kelvin : ndarray, shape (n,)
        Change of the distances with temperature per laser, metres per kelvin.
    """

    world: World
    sample: str
    steady: Array
    windows: Array
    per_kelvin: Array

    def at(self, time_s: Array) -> Array:
        """Drift of all lasers, metres, shape (len(time_s), n).

        Parameters
        ----------
        time_s : ndarray
            Seconds since the start of the experiment, see `World.represented_s`.
        """
        place = np.clip(2.0 * time_s / self.world.warmth.duration_s, 0.0, 2.0)
        windows = np.maximum(1.0 - np.abs(place[:, None] - np.arange(3)), 0.0)
        warmth = self.world.temperature_k(self.sample, time_s)
        shares = np.column_stack([windows, np.ones_like(place), warmth])
        return np.asarray(shares @ np.vstack([self.windows, self.steady, self.per_kelvin]))


def drift(world: World, scanner: str, sample: str) -> Drift:
    """Draw the range drift of a sample."""
    errors = world.scanner(scanner).errors
    rng = world.rng("drift", scanner, sample)
    n = SCANNERS[scanner].n_lasers
    steady = rng.normal(0.0, errors.drift_common_cm) + rng.normal(0.0, errors.drift_laser_cm, n)
    windows = rng.normal(0.0, errors.drift_window_cm, (3, n))
    per_kelvin = world.rng("thermal", scanner).normal(
        errors.thermal_cm_per_k, errors.thermal_laser_cm_per_k, n
    )
    return Drift(world, sample, steady * 1e-2, windows * 1e-2, per_kelvin * 1e-2)
