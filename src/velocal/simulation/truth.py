"""Truth of the simulated world: drawn from the seed, the same wherever it is needed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.parameters import ParameterSet, nominal
from velocal.sensors import AZIMUTH_TICKS, SCANNERS
from velocal.simulation.world import World

Array = NDArray[np.float64]


def factory_parameters(world: World, scanner: str) -> ParameterSet:
    """Parameters that the factory states for the simulated unit."""
    design = nominal(SCANNERS[scanner])
    model = world.scanner(scanner).factory
    if model is None:
        return design
    rng = world.rng("factory", scanner)
    n = len(design)
    return design.corrected(
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


@dataclass(frozen=True)
class UnitTruth:
    """True properties of a unit.

    Attributes
    ----------
    parameters : ParameterSet
        True dl, alpha, v, voff, hoff.
    range_scale : ndarray, shape (n,)
        Share of the range that is measured too long.
    noise_m : ndarray, shape (n,)
        Standard deviation of a single shot.
    """

    parameters: ParameterSet
    range_scale: Array
    noise_m: Array


def unit_truth(world: World, scanner: str) -> UnitTruth:
    """Draw the true parameters of a unit about its factory values."""
    errors = world.scanner(scanner).errors
    factory = factory_parameters(world, scanner)
    rng = world.rng("unit", scanner)
    n = len(factory)
    true = factory.corrected(
        {
            # The factory's distances come out too long by the mean: the true correction is less.
            "dl": -rng.normal(errors.dl_mean_cm, errors.dl_cm, n) * 1e-2,
            "alpha": np.deg2rad(rng.normal(0.0, errors.alpha_deg, n)),
            "v": np.deg2rad(rng.normal(0.0, errors.v_deg, n)),
        }
    )
    scale = rng.normal(0.0, errors.range_scale_cm_per_m * 1e-2, n)
    noise = errors.noise_median_cm * 1e-2 * np.exp(rng.normal(0.0, errors.noise_log, n))
    return UnitTruth(true, scale, noise)


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
    size = errors.pattern_median_cm * np.exp(rng.normal(0.0, errors.pattern_log, n))
    white = rng.standard_normal((coarse, n))
    frequency = np.fft.rfftfreq(coarse, d=360.0 / coarse)
    kernel = np.exp(-2.0 * (np.pi * frequency * errors.pattern_kernel_deg) ** 2)
    smooth = np.fft.irfft(np.fft.rfft(white, axis=0) * kernel[:, None], n=coarse, axis=0)
    pattern = smooth / smooth.std(axis=0) * size
    fraction = (np.arange(AZIMUTH_TICKS) % 10)[:, None] / 10.0
    left = np.repeat(pattern, 10, axis=0)
    right = np.repeat(np.roll(pattern, -1, axis=0), 10, axis=0)
    return np.asarray((left + fraction * (right - left) + shift) * 1e-2)


def drift(world: World, scanner: str, sample: str) -> Array:
    """Range drift at beginning, middle and end of a sample, metres, shape (3, n)."""
    errors = world.scanner(scanner).errors
    rng = world.rng("drift", scanner, sample)
    n = SCANNERS[scanner].n_lasers
    steady = rng.normal(0.0, errors.drift_common_cm) + rng.normal(0.0, errors.drift_laser_cm, n)
    return np.asarray((steady + rng.normal(0.0, errors.drift_window_cm, (3, n))) * 1e-2)
