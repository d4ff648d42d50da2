"""Noise of the bins of each laser: a pattern along azimuth and white noise, by REML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dsytrd

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
    # In place: temporary matrices would take as long as their numbers.
    scaled = np.abs(apart)
    scaled *= np.sqrt(3.0) / length
    found = np.negative(scaled)
    np.exp(found, out=found)
    scaled += 1.0
    found *= scaled
    return np.asarray(found)


def correlation(phi: Array, length: float) -> Array:
    """Correlation of the pattern between the angles of one laser at one station, (n, n)."""
    turned = np.mod(phi, 2.0 * np.pi)
    apart = turned[:, None] - turned
    np.abs(apart, out=apart)
    np.minimum(apart, 2.0 * np.pi - apart, out=apart)
    return matern(apart, length)


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
class Reduced:
    """Groups in coordinates of which only the first contains z, with tridiagonal correlations.

    The correlation of the pattern is ``Q T Q'`` with a tridiagonal T, and z is the first column of
    Q times a number. Shorter groups are filled up with zeros.

    Attributes
    ----------
    diagonal, beside : ndarray, shape (n, groups), (n - 1, groups)
        Of T, weighted with the numbers of observations, and without the design.
    square : ndarray, shape (groups,)
        Squared length of z, weighted and without the design, square metres.
    dof : ndarray, shape (groups,)
        Degrees of freedom.
    """

    diagonal: Array
    beside: Array
    square: Array
    dof: Array


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


def reduced(groups: Sequence[Group], length: float) -> Reduced:
    """Project out the designs, and make the correlations of the pattern tridiagonal.

    An eigendecomposition would serve the same purpose, but takes four times as long.
    """
    longest = max(len(group.z) for group in groups)
    diagonal, beside = (np.zeros((n, len(groups))) for n in (longest, longest - 1))
    square, dof = np.zeros((2, len(groups)))
    for number, group in enumerate(groups):
        n = len(group.z)
        weight = np.sqrt(group.count)
        design = group.design * weight[:, None]
        size = np.sqrt((design**2).sum(axis=0))
        u, s, _ = np.linalg.svd(design[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        gone = u[:, s > 1e-9 * s[:1].sum()]
        z = weight * group.z
        z -= gone @ (gone.T @ z)
        kernel = correlation(group.phi, length)
        kernel *= weight[:, None]
        kernel *= weight
        _transform(kernel, gone, 1.0)
        square[number], dof[number] = z @ z, n - gone.shape[1]
        # Reflect z into the first coordinate, which the tridiagonal form then keeps.
        mirror = z
        mirror[0] += np.copysign(np.sqrt(square[number]), z[0])
        mirror /= max(float(np.linalg.norm(mirror)), 1e-300)
        _transform(kernel, mirror[:, None], 2.0)
        _, d, e, _, _ = dsytrd(kernel.T, lower=1, lwork=32 * n, overwrite_a=1)
        diagonal[:n, number], beside[: n - 1, number] = d, e
    return Reduced(diagonal, beside, square, dof)


def _transform(kernel: Array, u: Array, factor: float) -> None:
    """Replace K by ``(I - f u u') K (I - f u u')``: a projection if f is 1, a reflection if 2.

    The columns of u have unit length and are orthogonal to each other. Two products with large
    matrices would take longer.
    """
    through = kernel @ u
    half = factor * (through - 0.5 * factor * u @ (u.T @ through))
    kernel -= np.hstack([half, u]) @ np.hstack([u, half]).T


def minus_2_log(of: Reduced, log_tau: Array, log_omega: Array) -> Array:
    """Minus twice the restricted log-likelihood on grids, without constants.

    Parameters
    ----------
    of : Reduced
    log_tau, log_omega : ndarray, shape (groups, k)
        Logarithms of the standard deviations, metres, all in the same equal steps.

    Returns
    -------
    ndarray, shape (groups, k, k)
        By tau and omega.
    """
    # Determinant and sum of squares depend on the ratio only, which is the same along a diagonal.
    ratio = np.hstack([log_tau[:, :1] - log_omega[:, ::-1], log_tau[:, 1:] - log_omega[:, :1]])
    k = log_tau.shape[1]
    diagonal = np.arange(k)[:, None] - np.arange(k) + k - 1
    logs, squares = (part[:, diagonal] for part in _of_ratio(of, np.exp(2.0 * ratio)))
    log_omega = log_omega[:, None]
    found = 2.0 * of.dof[:, None, None] * log_omega + logs
    return np.asarray(found + np.exp(-2.0 * log_omega) * squares)


def _of_ratio(of: Reduced, ratio: Array) -> tuple[Array, Array]:
    """Determinant and sum of squares for ratios of the variances tau^2 and omega^2.

    Parameters
    ----------
    of : Reduced
    ratio : ndarray, shape (groups, k)

    Returns
    -------
    logs : ndarray, shape (groups, k)
        ``log |I + ratio T|``.
    squares : ndarray, shape (groups, k)
        ``z' (I + ratio T)^-1 z``, square metres.
    """
    # Elimination from the last row to the first: what is left of each diagonal element.
    left, logs = np.ones_like(ratio), np.zeros_like(ratio)
    beside = np.concatenate([of.beside, np.zeros((1, len(of.dof)))])
    for d, e in zip(of.diagonal[::-1, :, None], beside[::-1, :, None], strict=True):
        left = 1.0 + ratio * (d - ratio * e**2 / left)
        logs += np.log(left)
    return logs, of.square[:, None] / left


def _best(of: Reduced, centre: tuple[float, float] | None) -> tuple[Array, Array, Array]:
    """Most likely log tau and log omega, and the minimum; with a weak prior about `centre`."""
    mean = np.maximum(of.diagonal.sum(axis=0) / of.dof, 1e-30)
    omega = 0.5 * np.log(np.maximum(of.square / of.dof, 1e-16))
    tau, steps, span = omega - 0.5 * np.log(mean), _STEPS, _STEPS[1] - _STEPS[0]
    every = np.arange(len(omega))
    for _ in range(4):
        a, b = tau[:, None] + steps, omega[:, None] + steps
        grid = minus_2_log(of, a, b)
        if centre is not None:
            grid += ((a[:, :, None] - centre[0]) / _LOG_STD) ** 2
            grid += ((b[:, None, :] - centre[1]) / _LOG_STD) ** 2
        least = grid.reshape(len(every), -1).argmin(axis=1)
        i, j = np.unravel_index(least, grid.shape[1:])
        tau, omega, value = a[every, i], b[every, j], grid[every, i, j]
        steps, span = np.linspace(-1.0, 1.0, 7) * span, span / 3.0
    return tau, omega, value


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
    usable = {
        number: group
        for number, group in enumerate(groups)
        if group is not None and len(group.z) - group.design.shape[1] >= LEAST_DOF
    }
    tau, omega = np.full(len(groups), np.nan), np.full(len(groups), np.nan)
    if not usable:
        seen = [group.z for group in groups if group is not None and len(group.z)]
        spread = max(float(np.std(np.concatenate(seen))) if seen else 0.0, 1e-3)
        known = np.zeros(len(groups), dtype=bool)
        return Noise(np.full(len(groups), spread), np.full(len(groups), spread), LENGTHS[2], known)
    numbers, chosen = list(usable), list(usable.values())
    if length is None:
        length = _length(chosen[:: max(1, len(chosen) // GROUPS_FOR_LENGTH)])
    of = reduced(chosen, length)
    free_tau, free_omega, _ = _best(of, None)
    centre = float(np.median(free_tau)), float(np.median(free_omega))
    tau[numbers], omega[numbers], _ = _best(of, centre)
    estimated = np.isfinite(tau)
    tau[~estimated], omega[~estimated] = centre
    return Noise(np.exp(tau), np.exp(omega), length, estimated)


def _length(groups: Sequence[Group]) -> float:
    """Length with the largest likelihood of some groups; a parabola through its neighbours."""
    values: dict[int, float] = {}
    best, following = -1, len(LENGTHS) // 2
    while best != following:  # lengths that are far from the best are not tried
        best = following
        for number in {best - 1, best, best + 1}.intersection(range(len(LENGTHS))) - set(values):
            values[number] = float(_best(reduced(groups, LENGTHS[number]), None)[2].sum())
        following = min(values, key=values.__getitem__)
    if best in (0, len(LENGTHS) - 1):
        return float(LENGTHS[best])
    left, middle, right = (values[number] for number in (best - 1, best, best + 1))
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(LENGTHS[best] * (LENGTHS[1] / LENGTHS[0]) ** shift)
