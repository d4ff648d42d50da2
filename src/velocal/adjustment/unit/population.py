"""Standard deviations of a unit: which there are, their hyperprior, mode and integration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.unit.marginal import Posterior
from velocal.adjustment.unit.model import UNKNOWNS, WITH_MEAN
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.sums import Layout, Sums
from velocal.arrays import Array

Found = TypeVar("Found")

#: Degrees of freedom of the half-t hyperprior.
_DOF = 3.0
#: Standard deviations that no unit has at zero. Their prior density is zero there, and not largest:
#: it is that of the half-t times sigma, with its tail.
_NEVER_ZERO = ("dl", "alpha", "v")
#: Prior standard deviations of the means over the lasers: wide, as nothing is known.
MEAN_STD = {"dl": 0.05, "alpha": float(np.deg2rad(1.0)), "v": float(np.deg2rad(1.0)), "scale": 1e-3}
#: Scales of the hyperprior. Its tails are wide, so that data decide; without data (v, where only
#: walls are seen) a unit is taken to be as good as usual, and its lasers are not moved by noise.
SCALES = {
    "dl": 0.02,
    "alpha": float(np.deg2rad(0.07)),
    "v": float(np.deg2rad(0.07)),
    "scale": 1e-3,
    "shift": 0.01,
    "plane": 0.001,
    "common": 0.005,
}


#: Share of the shift of a laser at a single station that the model knows. A single station cannot
#: tell the shift from dl: if the lasers do not shift, shrinking dl by the whole of it would do
#: harm; if they do, by half of it is nearly as good as by the whole. The stated covariance
#: contains the whole.
SHRINKING = 0.5


@dataclass(frozen=True)
class Size:
    """One standard deviation of the unit.

    Attributes
    ----------
    name : str
        Of the unknowns that it belongs to: a parameter, ``shift``, ``plane``, ``common`` or
        ``relief``.
    unit : str
    scale : float
        Of the half-t hyperprior; the value itself where it is fixed.
    fixed : bool
        Whether it is given and not learnt.
    own, common : ndarray of int
        Random and common unknowns that it belongs to.
    """

    name: str
    unit: str
    scale: float
    fixed: bool
    own: NDArray[np.int64]
    common: NDArray[np.int64]


@dataclass(frozen=True)
class Population:
    """All standard deviations of a unit, as functions of the logarithms of those learnt.

    Attributes
    ----------
    layout : Layout
    sizes : tuple of Size
    far : bool
        Whether the scale is the correction at a far point, metres.
    """

    layout: Layout
    sizes: tuple[Size, ...]
    far: bool

    @classmethod
    def of(
        cls, layout: Layout, settings: UnitSettings, relief: NDArray[np.integer] | None = None
    ) -> Population:
        """Say what is learnt and what is given.

        Parameters
        ----------
        layout : Layout
        settings : UnitSettings
        relief : ndarray of int, optional
            Places of the relief of all surfaces among the common unknowns; used if its size is
            learnt (`UnitSettings.learn_relief`).
        """
        none = np.zeros(0, dtype=np.int64)
        # The data hardly tell voff from v: a spread that is learnt from the little that they say
        # runs away with any small fault of the model, and takes v along.
        prior = {"voff": settings.offset_m} | dict(settings.prior or {})
        far = settings.far_point_m is not None
        sizes = []
        for place, name in enumerate(UNKNOWNS):
            unit = "m" if name in ("dl", "voff", "hoff") or (far and name == "scale") else "rad"
            unit = "1" if name == "scale" and not far else unit
            own = np.array([place])
            if name in prior:
                sizes.append(Size(name, unit, prior[name], True, own, none))
            else:
                scales = SCALES | {"hoff": settings.offset_m}
                scale = settings.far_std_m if far and name == "scale" else scales[name]
                sizes.append(Size(name, unit, scale, False, own, none))
        shifts = np.array([layout.shift(p) for p in range(layout.stations)])
        planes = np.concatenate([np.r_[layout.plane(p)] for p in range(layout.stations)])
        common = np.r_[layout.common_shift]
        one = layout.stations == 1
        shift, both = SHRINKING * settings.shift_m, settings.common_shift_m
        sizes.append(Size("shift", "m", shift if one else SCALES["shift"], one, shifts, none))
        sizes.append(Size("plane", "m", SCALES["plane"], False, planes.astype(np.int64), none))
        sizes.append(Size("common", "m", both if one else SCALES["common"], one, none, common))
        if settings.learn_relief and relief is not None and len(relief):
            sizes.append(Size("relief", "1", 1.0, False, none, np.asarray(relief, dtype=np.int64)))
        return cls(layout, tuple(sizes), far)

    @property
    def learnt(self) -> list[Size]:
        """Standard deviations that are estimated."""
        return [size for size in self.sizes if not size.fixed]

    def values(self, log: Array) -> Array:
        """All standard deviations in the order of `sizes`."""
        found, free = np.empty(len(self.sizes)), iter(np.exp(log))
        for number, size in enumerate(self.sizes):
            found[number] = size.scale if size.fixed else next(free)
        return found

    def posterior(self, sums: Sums, log: Array) -> Posterior:
        """Posterior for the logarithms of the learnt standard deviations."""
        std, common = np.ones(self.layout.own), np.ones(self.layout.common)
        for place, name in enumerate(UNKNOWNS[:WITH_MEAN]):
            common[place] = 0.01 if self.far and name == "scale" else MEAN_STD[name]
        for size, value in zip(self.sizes, self.values(log), strict=True):
            std[size.own] = value
            common[size.common] = value
        return Posterior(sums, std, common)

    def minus_2_log_prior(self, log: Array) -> tuple[float, Array]:
        """Minus twice the log density of the logarithms under the hyperprior, and its gradient."""
        scales = np.array([size.scale for size in self.learnt])
        power = np.array([2.0 if size.name in _NEVER_ZERO else 1.0 for size in self.learnt])
        ratio = np.exp(2.0 * log) / (_DOF * scales**2)
        value = (_DOF + power) * np.log1p(ratio) - 2.0 * power * log
        slope = 2.0 * (_DOF + power) * ratio / (1.0 + ratio) - 2.0 * power
        return float(value.sum()), slope

    def minus_2_log(self, posterior: Posterior, log: Array) -> float:
        """Minus twice the log density of the logarithms, plus a constant; with their posterior."""
        return posterior.minus_2_log + self.minus_2_log_prior(log)[0]

    def gradient(self, posterior: Posterior, log: Array) -> Array:
        """Derivative of `minus_2_log` by the logarithms."""
        learnt = self.learnt
        of_data = posterior.gradient(
            [size.own for size in learnt], [size.common for size in learnt]
        )
        return of_data + self.minus_2_log_prior(log)[1]


@dataclass(frozen=True)
class Integrated(Generic[Found]):
    """The distribution of the standard deviations as weighted points.

    Attributes
    ----------
    weight : ndarray, shape (points,)
        Their sum is 1.
    found : tuple
        What the caller wanted to know of the posterior at every point.
    """

    weight: Array
    found: tuple[Found, ...]


def find_mode(population: Population, sums: Sums, start: Array | None = None) -> Array:
    """Most probable logarithms of the learnt standard deviations."""
    learnt = population.learnt
    if not learnt:
        return np.zeros(0)
    scales = np.log([size.scale for size in learnt])

    from scipy.optimize import minimize  # here: most scripts that import this module adjust no unit

    def value(log: Array) -> tuple[float, Array]:
        posterior = population.posterior(sums, log)
        return population.minus_2_log(posterior, log), population.gradient(posterior, log)

    bounds = [(s - 8.0, s + 4.0) for s in scales]
    begin = scales - 0.7 if start is None else start
    found = minimize(
        value, begin, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": 60, "ftol": 1e-10, "gtol": 1e-3},
    )  # fmt: skip
    return np.asarray(found.x)


def integrate(
    population: Population,
    sums: Sums,
    mode: Array,
    points: int,
    describe: Callable[[Posterior, Array], Found],
) -> Integrated[Found]:
    """Spread points about the mode by Laplace's approximation, and weight them exactly.

    Parameters
    ----------
    population : Population
    sums : Sums
    mode : ndarray
        See `find_mode`.
    points : int
        1 for the mode alone; otherwise the least number of points.
    describe : callable
        What is wanted of the posterior at every point, which itself is not kept, and the
        values of all standard deviations.

    Notes
    -----
    The density of the logarithms falls more slowly on one side of the mode than on the other, and
    what is wanted depends much on some of them (the mean of dl on the size of the common shift).
    So each axis of the approximation has a width of its own to either side, such that the density
    is right at one standard deviation: Rue, Martino & Chopin (2009), Approximate Bayesian
    inference for latent Gaussian models by using integrated nested Laplace approximations, Journal
    of the Royal Statistical Society B 71(2), section 6.5. The points are those of turned axes,
    both ways, on a sphere: Genz & Monahan (1998), Stochastic integration rules for infinite
    regions, SIAM Journal on Scientific Computing 19(2). Their common distance from the mode is the
    one that is typical of a normal distribution; weights of points at other distances would differ
    by large factors.
    """
    at_mode = population.posterior(sums, mode)
    if not population.learnt or points == 1:
        return Integrated(np.ones(1), (describe(at_mode, population.values(mode)),))

    def gradient(log: Array) -> Array:
        return population.gradient(population.posterior(sums, log), log)

    step, d = 0.1, len(mode)
    # At the mode itself the gradient is zero, except where a limit of the search was reached.
    here = population.gradient(at_mode, mode)
    hessian = np.stack([(gradient(mode + e) - here) / step for e in step * np.eye(d)])
    values, vectors = np.linalg.eigh(0.25 * (hessian + hessian.T))
    # Of the half-t prior alone the logarithm has a standard deviation near 1.
    axes = (vectors / np.sqrt(np.maximum(values, 0.5))).T
    lowest = population.minus_2_log(at_mode, mode)
    rise = [
        population.minus_2_log(population.posterior(sums, log), log) - lowest
        for log in mode + np.concatenate([axes, -axes])
    ]
    above, below = np.clip(rise, 0.25, 4.0).reshape(2, d) ** -0.5
    # On a sphere of one or two dimensions, all points would have nearly the same coordinates: there
    # they are the first coordinates of points on a sphere of three.
    dimensions = max(d, 3)
    # The same turned axes each time, so that the result is the same.
    shape = (-(-points // (2 * dimensions)), dimensions, dimensions)
    turned, _ = np.linalg.qr(np.random.default_rng(1).normal(size=shape))
    half = np.sqrt(dimensions) * turned.reshape(-1, dimensions)[:, :d]
    placed = np.concatenate([half, -half])
    width = np.where(placed > 0.0, above, below)
    found, exponent = [], 0.5 * (lowest + (placed**2).sum(axis=1)) + np.log(width).sum(axis=1)
    for number, log in enumerate(mode + (width * placed) @ axes):
        posterior = population.posterior(sums, log)
        found.append(describe(posterior, population.values(log)))
        exponent[number] -= 0.5 * population.minus_2_log(posterior, log)
    weight = np.exp(exponent - exponent.max())
    return Integrated(weight / weight.sum(), tuple(found))


def quantiles(values: Array, weight: Array, shares: Sequence[float]) -> Array:
    """Quantiles of weighted values."""
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.interp(shares, reached, values[order])
