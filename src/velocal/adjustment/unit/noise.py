"""Noise of the bins of each laser: a pattern along azimuth and white noise, by REML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array

#: Correlation lengths that are tried, radians.
LENGTHS = np.deg2rad([0.3, 0.6, 1.2, 2.4, 4.8, 9.6])
#: Length before it is estimated, radians.
FIRST_LENGTH = float(np.deg2rad(1.0))
#: Groups of bins from which the length is estimated; more would not change it.
GROUPS_FOR_LENGTH = 12
#: A group with fewer degrees of freedom has the median noise of the unit.
LEAST_DOF = 12
#: Logarithmic grid of the standard deviations, relative to the spread of the residuals.
_STEPS = np.log(np.geomspace(0.03, 3.0, 24))
#: Standard deviation of the logarithm of the noise over the groups, as a weak prior.
_LOG_STD = 1.0


def matern(apart: Array, length: float) -> Array:
    """Matern correlation of smoothness 3/2.

    Parameters
    ----------
    apart : ndarray
        Angular distances, radians.
    length : float
        Correlation length, radians.
    """
    scaled = np.sqrt(3.0) * np.abs(apart) / length
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def correlation(phi: Array, length: float) -> Array:
    """Correlation of the pattern between the angles of one laser at one station, (n, n)."""
    turned = np.mod(phi, 2.0 * np.pi)
    apart = np.abs(turned[:, None] - turned)
    return matern(np.minimum(apart, 2.0 * np.pi - apart), length)


@dataclass(frozen=True)
class Group:
    """The bins of one laser at one station.

    Attributes
    ----------
    phi, count, z : ndarray, shape (n,)
        Angle, number of observations, and z of `model.Linearised`.
    design : ndarray, shape (n, c)
        What is projected out: columns of the parameters and of the planes.
    """

    phi: Array
    count: Array
    z: Array
    design: Array


@dataclass(frozen=True)
class Spectrum:
    """A group in coordinates in which its noise is independent.

    Attributes
    ----------
    values : ndarray, shape (dof,)
        Eigenvalues of the projected correlation of the pattern.
    square : ndarray, shape (dof,)
        Squared coordinates of z, square metres.
    """

    values: Array
    square: Array


@dataclass(frozen=True)
class Noise:
    """Noise of all groups.

    Attributes
    ----------
    tau, omega : ndarray, shape (groups,)
        Standard deviations of the pattern, and of the white noise of one observation, metres.
    length : float
        Correlation length of the pattern, radians.
    estimated : ndarray of bool, shape (groups,)
        False where the medians of the other groups were taken.
    """

    tau: Array
    omega: Array
    length: float
    estimated: Array

    def covariance(self, group: int, phi: Array, count: Array) -> Array:
        """Covariance of the bins of one group, shape (n, n)."""
        found = self.tau[group] ** 2 * correlation(phi, self.length)
        found[np.diag_indices(len(phi))] += self.omega[group] ** 2 / count
        return np.asarray(found)


def spectrum(group: Group, length: float) -> Spectrum:
    """Project out the design, and diagonalise the correlation of the pattern."""
    weight = np.sqrt(group.count)
    design = group.design * weight[:, None]
    size = np.sqrt((design**2).sum(axis=0))
    u, s, _ = np.linalg.svd(design[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    gone = u[:, s > 1e-9 * s[:1].sum()]
    kernel = correlation(group.phi, length) * weight[:, None] * weight
    # The columns of the design become the eigenvectors of one value above all others, and are
    # left out. A basis of what remains would cost two products of large matrices.
    through = kernel @ gone
    above = 2.0 * np.trace(kernel) * np.eye(gone.shape[1])
    half = through - 0.5 * gone @ (gone.T @ through + above)
    kernel -= half @ gone.T
    kernel -= gone @ half.T
    values, vectors = np.linalg.eigh(kernel)
    kept = len(values) - gone.shape[1]
    projected = vectors[:, :kept].T @ (weight * group.z)
    return Spectrum(np.maximum(values[:kept], 0.0), projected**2)


def minus_2_log(of: Spectrum, log_tau: Array, log_omega: Array) -> Array:
    """Minus twice the restricted log-likelihood, without constants.

    Parameters
    ----------
    of : Spectrum
    log_tau, log_omega : ndarray
        Logarithms of the standard deviations, metres; of any shapes that fit each other.
    """
    log_tau, log_omega = np.broadcast_arrays(log_tau, log_omega)
    # Both sums depend on the ratio only, of which a grid has few values.
    ratio, place = np.unique(np.round(log_tau - log_omega, 12), return_inverse=True)
    variance = 1.0 + np.exp(2.0 * ratio)[:, None] * of.values
    logs, squares = np.log(variance).sum(axis=1), (of.square / variance).sum(axis=1)
    place = place.reshape(log_tau.shape)
    found = 2.0 * len(of.values) * log_omega + logs[place]
    return np.asarray(found + np.exp(-2.0 * log_omega) * squares[place])


def _best(of: Spectrum, centre: tuple[float, float] | None) -> tuple[float, float, float]:
    """Most likely log tau and log omega, and the minimum; with a weak prior about `centre`."""
    mean = max(float(of.values.mean()), 1e-30)
    scale = 0.5 * np.log(max(float(of.square.mean()), 1e-16))
    tau, omega = scale - 0.5 * np.log(mean) + _STEPS, scale + _STEPS
    span = float(_STEPS[1] - _STEPS[0])

    def value(a: Array, b: Array) -> Array:
        found = minus_2_log(of, a, b)
        if centre is not None:
            found = found + ((a - centre[0]) / _LOG_STD) ** 2 + ((b - centre[1]) / _LOG_STD) ** 2
        return found

    for _ in range(4):
        a, b = np.meshgrid(tau, omega, indexing="ij")
        grid = value(a, b)
        i, j = np.unravel_index(int(np.argmin(grid)), grid.shape)
        best = float(tau[i]), float(omega[j]), float(grid[i, j])
        fine = np.linspace(-1.0, 1.0, 7) * span
        tau, omega, span = best[0] + fine, best[1] + fine, span / 3.0
    return best


def estimate(groups: Sequence[Group | None], length: float | None = None) -> Noise:
    """Estimate the noise of all groups, and the length that they have in common.

    Parameters
    ----------
    groups : sequence of Group or None
        None where a laser was not observed at a station.
    length : float, optional
        Correlation length where it is known already, radians.

    Returns
    -------
    Noise
        Without any group that is large enough, the noise is the spread of all z: nothing else is
        known.
    """
    usable = [
        number
        for number, group in enumerate(groups)
        if group is not None and len(group.z) - group.design.shape[1] >= LEAST_DOF
    ]
    tau, omega = np.full(len(groups), np.nan), np.full(len(groups), np.nan)
    if not usable:
        seen = [group.z for group in groups if group is not None and len(group.z)]
        spread = max(float(np.std(np.concatenate(seen))) if seen else 0.0, 1e-3)
        known = np.zeros(len(groups), dtype=bool)
        return Noise(np.full(len(groups), spread), np.full(len(groups), spread), LENGTHS[2], known)
    if length is None:
        length = _length(groups, usable[:: max(1, len(usable) // GROUPS_FOR_LENGTH)])
    spectra = {number: spectrum(_known(groups[number]), length) for number in usable}
    free = np.array([_best(spectra[number], None)[:2] for number in usable])
    centre = float(np.median(free[:, 0])), float(np.median(free[:, 1]))
    for number in usable:
        tau[number], omega[number], _ = _best(spectra[number], centre)
    estimated = np.isfinite(tau)
    tau[~estimated], omega[~estimated] = centre
    return Noise(np.exp(tau), np.exp(omega), length, estimated)


def _length(groups: Sequence[Group | None], chosen: Sequence[int]) -> float:
    """Length with the largest likelihood of some groups; a parabola through its neighbours."""
    values = np.array(
        [
            sum(_best(spectrum(_known(groups[number]), length), None)[2] for number in chosen)
            for length in LENGTHS
        ]
    )
    best = int(np.argmin(values))
    if best in (0, len(LENGTHS) - 1):
        return float(LENGTHS[best])
    left, middle, right = values[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(LENGTHS[best] * (LENGTHS[1] / LENGTHS[0]) ** shift)


def _known(group: Group | None) -> Group:
    assert group is not None
    return group
