"""Residuals with a pattern that is correlated along azimuth, to check tests of statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array

#: Azimuths at which a pattern is drawn; between them it is constant.
_BINS = 14400


@dataclass(frozen=True, kw_only=True)
class Residuals:
    """Population of the residuals of a laser: shift, pattern along azimuth, independent noise.

    Attributes
    ----------
    kind : {"smooth", "rough"}
        Correlation of the pattern at a difference d of azimuth: exp(-d^2 / 4 length^2), as that of
        the simulated world, or exp(-d / length), which is an autoregression of first order.
    length_deg : float
    white : float
        Share of independent noise in the variance about the shift.
    shift : float
        Share of the squared shift in the mean square.
    """

    kind: str
    length_deg: float
    white: float = 0.05
    shift: float = 0.0

    def draw(
        self, rng: np.random.Generator, phi: Array, laser_id: NDArray[np.integer], n_lasers: int
    ) -> Array:
        """Draw residuals whose mean square is 1 for every laser.

        Parameters
        ----------
        rng : Generator
        phi, laser_id : ndarray, shape (n,)
            Rotational angle (radians) and laser of every residual.
        n_lasers : int

        Returns
        -------
        ndarray, shape (n,)
        """
        apart = np.arange(_BINS) * 360.0 / _BINS
        apart = np.minimum(apart, 360.0 - apart) / self.length_deg
        correlation = np.exp(-apart if self.kind == "rough" else -(apart**2) / 4.0)
        root = np.sqrt(np.maximum(np.fft.rfft(correlation).real, 0.0))
        noise = np.fft.rfft(rng.standard_normal((n_lasers, _BINS)), axis=1)
        pattern = np.fft.irfft(noise * root, _BINS, axis=1)
        azimuth_bin = (np.mod(phi, 2.0 * np.pi) * (_BINS / (2.0 * np.pi))).astype(np.int64)
        s = np.sqrt(1.0 - self.white) * pattern[laser_id, azimuth_bin % _BINS]
        s += np.sqrt(self.white) * rng.standard_normal(len(phi))
        shift = np.sqrt(self.shift) * rng.choice([-1.0, 1.0], n_lasers)
        return np.asarray(shift[laser_id] + np.sqrt(1.0 - self.shift) * s)
